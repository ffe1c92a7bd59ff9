"""What changed when: of each segment the transaction that changed it last, of each square too; ways and drawn pieces.

Triggers write it down, whatever program changes a segment: no way round them exists, so who follows changes misses
none. Every segment that is there counts as changed by this migration. ``ways`` and ``drawn_pieces`` are derived from
segments by workers and are empty at first. Adds only: programs of the revision before go on.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry

from app.core.tables import SRID_DEGREES, SRID_TILES

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None

oldest_program = down_revision

# 64 bits, never reused within one server; another server counts anew (``app.changes``).
_XID = """
    CREATE FUNCTION versant_xid() RETURNS bigint
    LANGUAGE sql STABLE PARALLEL UNSAFE
    RETURN CAST(CAST(pg_current_xact_id() AS text) AS bigint)
"""

_CELL_CHANGED = """
    CREATE FUNCTION versant_cell_changed() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        NEW.changed_xid := CAST(CAST(pg_current_xact_id() AS text) AS bigint);
        RETURN NEW;
    END $$
"""
_CELL_TRIGGERS = (
    """
    CREATE TRIGGER versant_changed_insert BEFORE INSERT ON cells
    FOR EACH ROW EXECUTE FUNCTION versant_cell_changed()
    """,
    """
    CREATE TRIGGER versant_changed_update BEFORE UPDATE ON cells FOR EACH ROW
    WHEN (NEW.version <> OLD.version OR NEW.drawn_version <> OLD.drawn_version)
    EXECUTE FUNCTION versant_cell_changed()
    """,
)

# One statement, one note: the last change of a segment counts, and whether it is still there when that ends. Places are
# added up: who follows a part of the map is told of what has left it, however often it went on from there.
_NOTE = """
    INSERT INTO segment_changes AS c (segment_id, xid, changed_at, gone, was)
    SELECT id, CAST(CAST(pg_current_xact_id() AS text) AS bigint), clock_timestamp(), {gone}, was FROM {which}
    ORDER BY id
    ON CONFLICT (segment_id) DO UPDATE SET xid = excluded.xid, changed_at = excluded.changed_at, gone = excluded.gone,
        was = CASE WHEN excluded.was IS NULL THEN c.was WHEN c.was IS NULL THEN excluded.was
              ELSE ST_Envelope(ST_Collect(c.was, excluded.was)) END;
"""
_SHOWN = ("osm_way_id", "from_node", "to_node", "length_m", "highway", "name", "oneway", "bridge", "tunnel")
_OF_SLOPES = (
    "slope_percent",
    "slope_sigma_percent",
    "drives",
    "observations",
    "driven_share",
    "height_from_m",
    "height_to_m",
    "height_sigma_m",
    "steepest_percent",
    "steepest_from_m",
    "steepest_to_m",
    "updated_at",
)


def _row(name: str, columns: tuple[str, ...]) -> str:
    return ", ".join(f"{name}.{column}" for column in columns)


_SEGMENTS_CHANGED = f"""
    SELECT n.id, CASE WHEN n.geom::bytea <> o.geom::bytea THEN o.geom END AS was
    FROM new_rows AS n JOIN old_rows AS o ON o.id = n.id
    WHERE ({_row("n", (*_SHOWN, "dem_slope_percent"))}) IS DISTINCT FROM ({_row("o", (*_SHOWN, "dem_slope_percent"))})
        OR n.geom::bytea <> o.geom::bytea
"""  # noqa: S608 - constants
_SLOPES_CHANGED = f"""
    SELECT n.segment_id AS id, CAST(NULL AS geometry) AS was
    FROM new_rows AS n JOIN old_rows AS o ON o.segment_id = n.segment_id
    WHERE ({_row("n", _OF_SLOPES)}) IS DISTINCT FROM ({_row("o", _OF_SLOPES)})
"""  # noqa: S608 - constants

# A slope that goes with its segment is noted before or after it: what counts is whether that is there.
_GONE = "NOT EXISTS (SELECT FROM segments AS s WHERE s.id = which.id)"
_STAYS = "(SELECT {id} AS id, CAST(NULL AS geometry) AS was FROM {rows}) AS which"

_FUNCTIONS = {
    ("segments", "insert"): (_STAYS.format(id="id", rows="new_rows"), "false"),
    ("segments", "update"): (f"({_SEGMENTS_CHANGED}) AS which", "false"),
    ("segments", "delete"): ("(SELECT id, geom AS was FROM old_rows) AS which", "true"),
    ("segment_slopes", "insert"): (_STAYS.format(id="segment_id", rows="new_rows"), "false"),
    ("segment_slopes", "update"): (f"({_SLOPES_CHANGED}) AS which", "false"),
    ("segment_slopes", "delete"): (_STAYS.format(id="segment_id", rows="old_rows"), _GONE),
}
_TABLES = {
    "insert": "REFERENCING NEW TABLE AS new_rows",
    "update": "REFERENCING OLD TABLE AS old_rows NEW TABLE AS new_rows",
    "delete": "REFERENCING OLD TABLE AS old_rows",
}

# Nobody is handed the rows of a table that is emptied at once. Every segment that is there has a note, and those that
# are emptied with their slopes go last.
_EMPTIED = {
    ("segments", "AFTER"): """
        UPDATE segment_changes SET xid = CAST(CAST(pg_current_xact_id() AS text) AS bigint),
            changed_at = clock_timestamp(), gone = true
        WHERE NOT gone;
    """,
    ("segment_slopes", "BEFORE"): _NOTE.format(
        which=_STAYS.format(id="segment_id", rows="segment_slopes"),
        gone="false",
    ),
}


def upgrade() -> None:
    """Apply."""
    op.execute(_XID)
    op.add_column(
        "cells", sa.Column("changed_xid", sa.BigInteger(), server_default=sa.text("0"), nullable=False)
    )
    op.add_column(
        "cells", sa.Column("drawn_version", sa.BigInteger(), server_default=sa.text("0"), nullable=False)
    )
    op.create_index("ix_cells_changed_xid", "cells", ["changed_xid"])
    op.execute(_CELL_CHANGED)
    for trigger in _CELL_TRIGGERS:
        op.execute(trigger)
    _changes()
    _ways()
    _pieces()


def _changes() -> None:
    op.create_table(
        "segment_changes",
        sa.Column("segment_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("xid", sa.BigInteger(), nullable=False),
        sa.Column("changed_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("gone", sa.Boolean(), nullable=False),
        sa.Column("was", Geometry("GEOMETRY", srid=SRID_DEGREES, spatial_index=False)),
    )
    op.execute(
        """
        INSERT INTO segment_changes (segment_id, xid, changed_at, gone)
        SELECT s.id, versant_xid(), coalesce(a.updated_at, now()), false
        FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id ORDER BY s.id
        """
    )
    op.create_index("ix_segment_changes_xid", "segment_changes", ["xid", "segment_id"])
    op.create_index("ix_segment_changes_changed_at", "segment_changes", ["changed_at"])
    left = sa.text("gone OR was IS NOT NULL")
    op.create_index("ix_segment_changes_left", "segment_changes", ["changed_at"], postgresql_where=left)
    for (table, event), (which, gone) in _FUNCTIONS.items():
        name = f"versant_{table}_{event}"
        body = _NOTE.format(which=which, gone=gone)
        op.execute(
            f"CREATE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN {body} RETURN NULL; END $$"
        )
        op.execute(
            f"CREATE TRIGGER versant_noted_{event} AFTER {event} ON {table} {_TABLES[event]} "
            f"FOR EACH STATEMENT EXECUTE FUNCTION {name}()"
        )
    for (table, when), body in _EMPTIED.items():
        name = f"versant_{table}_truncate"
        op.execute(
            f"CREATE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN {body} RETURN NULL; END $$"
        )
        op.execute(
            f"CREATE TRIGGER versant_noted_truncate {when} TRUNCATE ON {table} "
            f"FOR EACH STATEMENT EXECUTE FUNCTION {name}()"
        )


def _ways() -> None:
    lines = {"spatial_index": False}
    double = sa.Double()
    op.create_table(
        "ways",
        sa.Column("id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("osm_way_id", sa.BigInteger(), nullable=False),
        sa.Column("from_node", sa.BigInteger(), nullable=False),
        sa.Column("to_node", sa.BigInteger(), nullable=False),
        sa.Column("segments", sa.Integer(), nullable=False),
        sa.Column("length_m", double, nullable=False),
        sa.Column("highway", sa.String(), nullable=False),
        sa.Column("name", sa.String()),
        sa.Column("oneway", sa.SmallInteger(), nullable=False),
        sa.Column("bridge", sa.Boolean(), nullable=False),
        sa.Column("tunnel", sa.Boolean(), nullable=False),
        sa.Column("slope_percent", double),
        sa.Column("slope_sigma_percent", double),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("observations", sa.Integer(), nullable=False),
        sa.Column("dem_slope_percent", double),
        sa.Column("updated_at", sa.DateTime(timezone=True)),
        sa.Column("measured_share", double, nullable=False),
        sa.Column("steepest_percent", double),
        sa.Column("steepest_from_m", double),
        sa.Column("steepest_to_m", double),
        sa.Column("geom", Geometry("LINESTRING", srid=SRID_DEGREES, **lines), nullable=False),
        sa.Column("geom_3857", Geometry("LINESTRING", srid=SRID_TILES, **lines), nullable=False),
    )
    op.create_index("ix_ways_osm_way_id", "ways", ["osm_way_id"])
    op.create_index("ix_ways_geom", "ways", ["geom"], postgresql_using="gist")
    op.create_index("ix_ways_geom_3857", "ways", ["geom_3857"], postgresql_using="gist")


def _pieces() -> None:
    op.create_table(
        "drawn_pieces",
        sa.Column("level", sa.SmallInteger(), nullable=False),
        sa.Column("square", sa.Integer(), nullable=False),
        sa.Column("segment_id", sa.BigInteger(), nullable=False),
        sa.Column("rank", sa.SmallInteger(), nullable=False),
        sa.Column("highway", sa.String(), nullable=False),
        sa.Column("oneway", sa.SmallInteger(), nullable=False),
        sa.Column("slope_percent", sa.Double()),
        sa.Column("slope_sigma_percent", sa.Double()),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.Column("geom_3857", Geometry("LINESTRING", srid=SRID_TILES, spatial_index=False), nullable=False),
        sa.PrimaryKeyConstraint("level", "square", "segment_id"),
    )
    for level in (12, 10, 8, 6):
        op.create_index(
            f"ix_drawn_pieces_{level}",
            "drawn_pieces",
            ["geom_3857"],
            postgresql_using="gist",
            postgresql_where=sa.text(f"level = {level}"),
        )


def downgrade() -> None:
    """Take back."""
    op.drop_table("drawn_pieces")
    op.drop_table("ways")
    emptied = [(table, "truncate") for table, _ in _EMPTIED]
    for table, event in (*_FUNCTIONS, *emptied):
        op.execute(f"DROP TRIGGER versant_noted_{event} ON {table}")
        op.execute(f"DROP FUNCTION versant_{table}_{event}()")
    op.drop_table("segment_changes")
    op.execute("DROP TRIGGER versant_changed_insert ON cells")
    op.execute("DROP TRIGGER versant_changed_update ON cells")
    op.execute("DROP FUNCTION versant_cell_changed()")
    op.drop_index("ix_cells_changed_xid", table_name="cells")
    op.drop_column("cells", "drawn_version")
    op.drop_column("cells", "changed_xid")
    op.execute("DROP FUNCTION versant_xid()")
