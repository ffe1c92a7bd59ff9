"""The first schema: roads, elevation, drives, estimates, and the queue.

Revision: 0001.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry
from procrastinate.schema import SchemaManager
from sqlalchemy.dialects import postgresql

from app.core.schema import comment_on_queue, queue_files

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

_TABLES = (
    "data_version",
    "segment_slopes",
    "drive_tracks",
    "drive_segments",
    "provenances",
    "drives",
    "segments",
    "dem_versions",
    "road_versions",
)

# procrastinate ships no way back: everything of its is called procrastinate_*.
_DROP_QUEUE = """
DO $$
DECLARE thing text;
BEGIN
    FOR thing IN SELECT oid::regclass::text FROM pg_class
        WHERE relkind = 'r' AND relnamespace = current_schema()::regnamespace
            AND relname LIKE 'procrastinate\\_%'
    LOOP EXECUTE 'DROP TABLE ' || thing || ' CASCADE'; END LOOP;
    FOR thing IN SELECT oid::regprocedure::text FROM pg_proc
        WHERE pronamespace = current_schema()::regnamespace AND proname LIKE 'procrastinate\\_%'
    LOOP EXECUTE 'DROP FUNCTION ' || thing || ' CASCADE'; END LOOP;
    FOR thing IN SELECT oid::regtype::text FROM pg_type
        WHERE typtype IN ('e', 'c') AND typnamespace = current_schema()::regnamespace
            AND typname LIKE 'procrastinate\\_%'
    LOOP EXECUTE 'DROP TYPE ' || thing || ' CASCADE'; END LOOP;
END $$
"""


def _now(name: str) -> sa.Column:
    return sa.Column(name, sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False)


def _time(name: str) -> sa.Column:
    return sa.Column(name, sa.DateTime(timezone=True))


def _drive_fk(**options: bool) -> sa.Column:
    target = sa.ForeignKey("drives.id", ondelete="CASCADE")
    return sa.Column("drive_id", sa.Uuid(), target, nullable=False, **options)


def _segment_fk(**options: bool) -> sa.Column:
    target = sa.ForeignKey("segments.id", ondelete="CASCADE")
    return sa.Column("segment_id", sa.BigInteger(), target, nullable=False, **options)


def upgrade() -> None:
    """Apply."""
    op.execute("CREATE EXTENSION IF NOT EXISTS postgis")
    _create_versions()
    _create_segments()
    _create_drives()
    _create_estimates()
    op.create_table(
        "data_version",
        sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("version", sa.BigInteger(), nullable=False),
        _now("updated_at"),
        sa.CheckConstraint("id = 1", name="singleton"),
    )
    op.execute("INSERT INTO data_version (id, version) VALUES (1, 1)")
    queue = op.get_bind().connection.driver_connection
    # The driver's own execute: SQLAlchemy's would take a per cent sign in the script for a parameter.
    queue.execute(SchemaManager.get_schema())
    comment_on_queue(queue, queue_files()[-1])


def downgrade() -> None:
    """Take back everything but the postgis extension, which others may use."""
    op.execute(_DROP_QUEUE)
    for table in _TABLES:
        op.drop_table(table)


def _create_versions() -> None:
    op.create_table(
        "road_versions",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("source_name", sa.String(), nullable=False),
        sa.Column("sha256", sa.String(), nullable=False),
        _now("imported_at"),
        *(
            sa.Column(name, sa.Integer(), nullable=False)
            for name in ("segments", "kept", "moved", "dropped", "added")
        ),
    )
    op.create_table(
        "dem_versions",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("sources", postgresql.JSONB(), nullable=False),
        sa.Column("datum", sa.String(), nullable=False),
        _now("imported_at"),
        sa.Column("active", sa.Boolean(), nullable=False),
    )
    op.create_index(
        "uq_dem_versions_active", "dem_versions", ["active"], unique=True, postgresql_where=sa.text("active")
    )


def _create_segments() -> None:
    op.create_table(
        "segments",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("osm_way_id", sa.BigInteger(), nullable=False),
        sa.Column("from_node", sa.BigInteger(), nullable=False),
        sa.Column("to_node", sa.BigInteger(), nullable=False),
        sa.Column("geom", Geometry("LINESTRING", srid=4326, spatial_index=False), nullable=False),
        sa.Column("geom_3857", Geometry("LINESTRING", srid=3857, spatial_index=False), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.Column("highway", sa.String(), nullable=False),
        sa.Column("name", sa.String()),
        sa.Column("oneway", sa.SmallInteger(), nullable=False),
        sa.Column("bridge", sa.Boolean(), nullable=False),
        sa.Column("tunnel", sa.Boolean(), nullable=False),
        sa.Column("layer", sa.SmallInteger(), nullable=False),
        sa.Column("dem_slope_percent", sa.Double()),
        sa.Column("road_version_id", sa.BigInteger(), sa.ForeignKey("road_versions.id"), nullable=False),
        sa.UniqueConstraint("osm_way_id", "from_node", "to_node"),
        sa.CheckConstraint("oneway IN (-1, 0, 1)", name="oneway"),
    )
    for column in ("geom", "geom_3857"):
        op.create_index(f"ix_segments_{column}", "segments", [column], postgresql_using="gist")


def _create_drives() -> None:
    op.create_table(
        "drives",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("sha256", sa.String(), nullable=False, unique=True),
        sa.Column("filename", sa.String(), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
        sa.Column("blob_key", sa.String(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("stage", sa.String()),
        sa.Column("progress", sa.Double(), server_default="0", nullable=False),
        sa.Column("failure_kind", sa.String()),
        sa.Column("failure_reason", sa.String()),
        sa.Column("failure_where", sa.String()),
        sa.Column("method", sa.String(), nullable=False),
        sa.Column("options", postgresql.JSONB(), nullable=False),
        sa.Column("generation", sa.Integer(), server_default="1", nullable=False),
        sa.Column("report", postgresql.JSONB()),
        sa.Column("bounds", Geometry("POLYGON", srid=4326, spatial_index=False)),
        sa.Column("epochs", sa.Integer()),
        sa.Column("distance_m", sa.Double()),
        _time("drive_time"),
        _now("created_at"),
        _now("queued_at"),
        _time("started_at"),
        _time("finished_at"),
        sa.CheckConstraint("status IN ('queued', 'running', 'done', 'failed', 'cancelled')", name="status"),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )
    op.create_index("ix_drives_created_at_id", "drives", ["created_at", "id"])
    op.create_index("ix_drives_status_created_at_id", "drives", ["status", "created_at", "id"])


def _create_estimates() -> None:
    op.create_table(
        "provenances",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        _drive_fk(index=True),
        sa.Column("method", sa.String(), nullable=False),
        sa.Column("options", postgresql.JSONB(), nullable=False),
        sa.Column("code_version", sa.String(), nullable=False),
        sa.Column("road_version_id", sa.BigInteger(), sa.ForeignKey("road_versions.id"), nullable=False),
        sa.Column("dem_version_id", sa.BigInteger(), sa.ForeignKey("dem_versions.id")),
        _now("created_at"),
    )
    op.create_table(
        "drive_segments",
        _drive_fk(primary_key=True),
        _segment_fk(primary_key=True, index=True),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
        sa.Column("observations", sa.Integer(), nullable=False),
        sa.Column("passes", sa.Integer(), nullable=False),
        sa.Column("first_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("last_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column(
            "provenance_id",
            sa.BigInteger(),
            sa.ForeignKey("provenances.id", ondelete="CASCADE"),
            nullable=False,
            index=True,
        ),
        sa.CheckConstraint("slope_sigma_percent > 0", name="sigma"),
    )
    op.create_table(
        "drive_tracks",
        _drive_fk(primary_key=True),
        sa.Column("track", sa.LargeBinary(), nullable=False),
    )
    op.create_table(
        "segment_slopes",
        _segment_fk(primary_key=True, autoincrement=False),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("observations", sa.Integer(), nullable=False),
        _now("updated_at"),
    )
