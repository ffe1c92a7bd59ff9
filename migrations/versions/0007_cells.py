"""Cells: marks of what waits to be solved, a version of each square of the map, and segments that know their square.

A drive's transaction appends what it says and marks the squares that it touched; solvers take the marks. The one
version of all data goes: tiles are as new as the squares below them. What was published stays as it is.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# The tile of zoom 14 that holds a place in EPSG:3857, as one number: x in the upper bits, y in the lower 14.
_CELL_AT = """
    CREATE FUNCTION versant_cell(x float8, y float8) RETURNS integer
    LANGUAGE sql IMMUTABLE PARALLEL SAFE
    RETURN (least(16383, greatest(0, floor((x + 20037508.342789244) / 2445.98490512564)::integer)) << 14)
        | least(16383, greatest(0, floor((20037508.342789244 - y) / 2445.98490512564)::integer))
"""
# All squares that a line of two points meets: for each column those from where the line enters it to where it leaves.
_CELLS_ALONG = """
    CREATE FUNCTION versant_cells_along(line geometry) RETURNS SETOF integer
    LANGUAGE sql IMMUTABLE PARALLEL SAFE STRICT
    BEGIN ATOMIC
        SELECT DISTINCT (x.n << 14) | y.n
        FROM (SELECT ST_X(ST_StartPoint(line)) AS x0, ST_Y(ST_StartPoint(line)) AS y0,
                     ST_X(ST_EndPoint(line)) AS x1, ST_Y(ST_EndPoint(line)) AS y1) AS e,
            generate_series(versant_cell(least(e.x0, e.x1), 0) >> 14,
                            versant_cell(greatest(e.x0, e.x1), 0) >> 14) AS x (n),
            LATERAL (SELECT -20037508.342789244 + x.n * 2445.98490512564 AS left) AS c,
            LATERAL (
                SELECT CASE WHEN abs(e.x1 - e.x0) < 0.001 THEN e.y0
                       ELSE e.y0 + (e.y1 - e.y0)
                           * least(1, greatest(0, (c.left - e.x0) / (e.x1 - e.x0))) END AS there,
                       CASE WHEN abs(e.x1 - e.x0) < 0.001 THEN e.y1
                       ELSE e.y0 + (e.y1 - e.y0)
                           * least(1, greatest(0, (c.left + 2445.98490512564 - e.x0) / (e.x1 - e.x0))) END AS back
            ) AS r,
            generate_series(versant_cell(0, greatest(r.there, r.back)) & 16383,
                            versant_cell(0, least(r.there, r.back)) & 16383) AS y (n);
    END
"""
_MIDDLE = """versant_cell(
    (ST_X(ST_StartPoint(geom_3857)) + ST_X(ST_EndPoint(geom_3857))) / 2,
    (ST_Y(ST_StartPoint(geom_3857)) + ST_Y(ST_EndPoint(geom_3857))) / 2)
"""

# Every square with roads is new: no tag of the former kind equals one of these.
_FILL = """
    INSERT INTO cells (id, version, driven)
    SELECT s.cell, 1, coalesce(d.driven, '{}')
    FROM (SELECT cell FROM segments
          UNION SELECT along FROM segments, versant_cells_along(geom_3857) AS along
          WHERE versant_cell(ST_X(ST_StartPoint(geom_3857)), ST_Y(ST_StartPoint(geom_3857)))
              <> versant_cell(ST_X(ST_EndPoint(geom_3857)), ST_Y(ST_EndPoint(geom_3857)))) AS s
    LEFT JOIN (
        SELECT cell, jsonb_object_agg(highway, jsonb_build_array(n, m)) AS driven
        FROM (SELECT s.cell, s.highway, count(*) AS n, sum(s.length_m) AS m
              FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id WHERE a.drives > 0
              GROUP BY 1, 2) AS by_class
        GROUP BY cell) AS d USING (cell)
"""


def upgrade() -> None:
    """Apply."""
    op.execute(_CELL_AT)
    op.execute(_CELLS_ALONG)
    op.add_column("segments", sa.Column("cell", sa.Integer(), sa.Computed(_MIDDLE, persisted=True)))
    op.create_index("ix_segments_cell", "segments", ["cell"])
    op.create_table(
        "cells",
        sa.Column("id", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("version", sa.BigInteger(), nullable=False, server_default=sa.text("0")),
        sa.Column("changed_at", sa.DateTime(timezone=True), nullable=False, server_default=sa.func.now()),
        sa.Column("unsettled_since", sa.DateTime(timezone=True), nullable=True),
        sa.Column("driven", postgresql.JSONB(), nullable=False, server_default=sa.text("'{}'")),
    )
    op.create_index(
        "ix_cells_unsettled_since",
        "cells",
        ["unsettled_since"],
        postgresql_where=sa.text("unsettled_since IS NOT NULL"),
    )
    op.create_table(
        "network_marks",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("cell", sa.Integer(), nullable=False),
        sa.Column("drive_id", sa.Uuid(), nullable=True),
        sa.Column("generation", sa.Integer(), nullable=True),
        sa.Column("touched", postgresql.ARRAY(sa.BigInteger()), nullable=False),
        sa.Column("combined", postgresql.ARRAY(sa.BigInteger()), nullable=False),
        sa.Column("due_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("tries", sa.SmallInteger(), nullable=False, server_default=sa.text("0")),
        sa.Column("made_at", sa.DateTime(timezone=True), nullable=False, server_default=sa.func.now()),
    )
    op.create_index("ix_network_marks_cell", "network_marks", ["cell"])
    op.create_index("ix_network_marks_drive_id", "network_marks", ["drive_id"])
    op.create_index("ix_network_marks_due_at", "network_marks", ["due_at"])
    op.execute(_FILL)
    op.drop_table("data_version")


def downgrade() -> None:
    """Take back. What waits to be solved waits for `versant rebuild`; drives that were being removed are gone."""
    op.create_table(
        "data_version",
        sa.Column("id", sa.SmallInteger(), autoincrement=False, nullable=False),
        sa.Column("version", sa.BigInteger(), nullable=False),
        sa.Column("updated_at", sa.DateTime(timezone=True), nullable=False, server_default=sa.func.now()),
        sa.CheckConstraint("id = 1", name="ck_data_version_singleton"),
        sa.PrimaryKeyConstraint("id", name="pk_data_version"),
    )
    op.execute("INSERT INTO data_version (id, version) SELECT 1, coalesce(sum(version), 0) FROM cells")
    op.execute(
        "UPDATE drives SET status = 'done', stage = NULL, progress = 1, finished_at = now() "
        "WHERE status = 'running' AND stage = 'publishing'"
    )
    op.execute("DELETE FROM drives WHERE status = 'cancelled' AND stage = 'removing'")
    op.drop_table("network_marks")
    op.drop_table("cells")
    op.drop_index("ix_segments_cell", "segments")
    op.drop_column("segments", "cell")
    op.execute("DROP FUNCTION versant_cells_along(geometry)")
    op.execute("DROP FUNCTION versant_cell(float8, float8)")
