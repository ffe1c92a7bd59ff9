"""Roads that change: regions side by side, what roads stand in a square, an attic for what was measured on lost roads.

Roads that are there become one region, named after the file that was imported last: importing a file of that name
updates it. No row of ``segments`` is rewritten. Programs of before take the roads for one whole that changes at once,
which it no longer does: none of them serves this schema.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry
from sqlalchemy.dialects import postgresql

from app.core.tables import SRID_DEGREES

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

# As app.roads.store.region_name has it.
_FIRST = """
    INSERT INTO regions (name, source_name, sha256, imported_at, road_version_id, segments)
    SELECT coalesce(nullif(lower(left(regexp_replace(regexp_replace(
               source_name, '(\\.(osm|pbf|osc|gz|bz2|xml|o5m))+$', '', 'i'), '[^[:alnum:]_.-]+', '-', 'g'), 100)), ''),
               'roads'),
           source_name, sha256, imported_at, id, (SELECT count(*) FROM segments)
    FROM road_versions WHERE EXISTS (SELECT FROM segments) ORDER BY id DESC LIMIT 1
"""


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "regions",
        sa.Column("id", sa.SmallInteger(), sa.Identity(), primary_key=True),
        sa.Column("name", sa.String(), nullable=False, unique=True),
        sa.Column("source_name", sa.String(), nullable=False),
        sa.Column("sha256", sa.String(), nullable=False),
        sa.Column("imported_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("road_version_id", sa.BigInteger(), sa.ForeignKey("road_versions.id"), nullable=False),
        sa.Column("segments", sa.Integer(), nullable=False),
        sa.Column("file_uri", sa.String()),
        sa.Column("file_sha256", sa.String()),
    )
    op.execute(_FIRST)
    kind = postgresql.ARRAY(sa.SmallInteger())
    op.add_column("segments", sa.Column("regions", kind, server_default="{1}", nullable=False))
    op.alter_column("segments", "regions", server_default="{}")
    op.add_column("road_versions", sa.Column("region", sa.String()))
    for name in ("road_state", "course_state"):
        op.add_column("cells", sa.Column(name, sa.BigInteger(), server_default="0", nullable=False))
    op.add_column("provenances", sa.Column("road_state", sa.BigInteger()))
    _make_attic()
    op.create_table(
        "touched_drives",
        _owner("drive_id", "drives", sa.Uuid(), primary_key=True),
        sa.Column("road_state", sa.BigInteger(), nullable=False),
        sa.Column("made_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )


def downgrade() -> None:
    """Take back. What lies in the attic goes; roads of all regions stay, as one map."""
    for table in ("touched_drives", "attic_estimates", "attic_passes", "attic_segments", "regions"):
        op.drop_table(table)
    op.drop_column("provenances", "road_state")
    for name in ("road_state", "course_state"):
        op.drop_column("cells", name)
    op.execute("DELETE FROM cells WHERE id < 0")
    op.drop_column("road_versions", "region")
    op.drop_column("segments", "regions")


def _make_attic() -> None:
    op.create_table(
        "attic_segments",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("segment_id", sa.BigInteger(), nullable=False),
        sa.Column("osm_way_id", sa.BigInteger(), nullable=False),
        sa.Column("from_node", sa.BigInteger(), nullable=False),
        sa.Column("to_node", sa.BigInteger(), nullable=False),
        sa.Column("geom", Geometry("LINESTRING", srid=SRID_DEGREES, spatial_index=False), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.Column("kept_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )
    op.create_index("ix_attic_segments_kept_at", "attic_segments", ["kept_at"])
    op.create_table(
        "attic_passes",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        _owner("attic_id", "attic_segments", sa.BigInteger()),
        _owner("drive_id", "drives", sa.Uuid()),
        sa.Column("run", sa.BigInteger()),
        sa.Column("sequence", sa.Integer(), nullable=False),
        sa.Column("entered_s", sa.Double(), nullable=False),
        sa.Column("factor", sa.LargeBinary(), nullable=False),
    )
    op.execute("ALTER TABLE attic_passes ALTER COLUMN factor SET STORAGE EXTERNAL")
    op.create_table(
        "attic_estimates",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        _owner("attic_id", "attic_segments", sa.BigInteger()),
        _owner("drive_id", "drives", sa.Uuid()),
        sa.Column("run", sa.BigInteger()),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
        sa.Column("observations", sa.Integer(), nullable=False),
        sa.Column("passes", sa.Integer(), nullable=False),
        sa.Column("first_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("last_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("in_network", sa.Boolean(), nullable=False),
    )
    for table in ("attic_passes", "attic_estimates"):
        for column in ("attic_id", "drive_id"):
            op.create_index(f"ix_{table}_{column}", table, [column])


def _owner(name: str, table: str, kind: sa.types.TypeEngine[object], **more: bool) -> sa.Column[object]:
    """A column whose row goes with the one that it names."""
    key = sa.ForeignKey(f"{table}.id", ondelete="CASCADE")
    return sa.Column(name, kind, key, nullable=False, **more)
