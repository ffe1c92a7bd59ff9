"""Editions of the map for the public: what may be told, the network solved from that alone, and what is served of it.

Two schemas beside the live tables. ``told`` has the passes that may be told and their network; ``edition`` has what the
public reads, under the names that it has in the live map, so that the same statements read either. A later migration
that changes a table which is copied here changes its copies too: a test compares them. Adds only: programs of the
revision before make no editions and serve none.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import ARRAY, JSONB

from app.core.schema import ensure_roles

revision = "0033"
down_revision = "0032"
branch_labels = None
depends_on = None

oldest_program = down_revision

IN_TOLD = (
    "drive_passes",
    "condensed_passes",
    "rejected_passes",
    "drive_constants",
    "drive_segments",
    "network_marks",
    "network_slopes",
    "segment_slopes",
    "cells",
)
IN_EDITION = (
    "segment_slopes",
    "cells",
    "segment_changes",
    "change_epoch",
    "ways",
    "drawn_pieces",
    "derived_upto",
    "derived_segments",
    "cells_to_draw",
    "stored_tiles",
    "tile_epoch",
)
IS_OWNERS = "owner_id = (SELECT nullif(current_setting('versant.owner', true), '')::bigint)"
_TRIGGERS = """
    SELECT pg_get_triggerdef(oid) FROM pg_trigger WHERE tgrelid = CAST(:table AS regclass) AND NOT tgisinternal
"""


def upgrade() -> None:
    """Apply."""
    ensure_roles(op.get_bind())
    for schema, tables in (("told", IN_TOLD), ("edition", IN_EDITION)):
        op.execute(f"CREATE SCHEMA {schema}")
        for table in tables:
            _copy(schema, table)
    _of_releases()
    op.execute("INSERT INTO edition.derived_upto SELECT 1, 0, 0, 0, versant_xid()")
    op.execute("INSERT INTO edition.tile_epoch SELECT 1, replace(CAST(gen_random_uuid() AS text), '-', '')")
    _editions()
    _zones()


def _copy(schema: str, table: str) -> None:
    """The table without its rows, and with its triggers: they write to what is called so in the same schema."""
    kind = "UNLOGGED TABLE" if table == "stored_tiles" else "TABLE"
    op.execute(f"CREATE {kind} {schema}.{table} (LIKE {table} INCLUDING ALL)")
    for (trigger,) in op.get_bind().execute(sa.text(_TRIGGERS), {"table": table}).all():
        op.execute(trigger.replace(f" ON public.{table} ", f" ON {schema}.{table} "))
    if table == "stored_tiles":
        op.execute("ALTER TABLE edition.stored_tiles SET (toast_tuple_target = 128)")


def _of_releases() -> None:
    """What only releases know. No role of the API may look into ``told``."""
    op.create_table(
        "drives",  # as solvers ask for them: the live row may go meanwhile, and nobody waits for it
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("owner_id", sa.BigInteger(), nullable=False),
        sa.Column("duplicate_of", sa.Uuid()),
        sa.Column("report", JSONB()),
        schema="told",
    )
    op.create_table(
        "places",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("owner_id", sa.BigInteger(), nullable=False),
        sa.Column("lon_deg", sa.Double(), nullable=False),
        sa.Column("lat_deg", sa.Double(), nullable=False),
        sa.Column("radius_m", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(["owner_id"], ["owners.id"], ondelete="CASCADE"),
        schema="told",
    )
    op.create_index("ix_places_owner_id", "places", ["owner_id"], schema="told")
    op.create_table(
        "examined",
        sa.Column("drive_id", sa.Uuid(), primary_key=True),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("hidden", ARRAY(sa.Integer()), nullable=False),
        sa.ForeignKeyConstraint(["drive_id"], ["drives.id"], ondelete="CASCADE"),
        schema="told",
    )
    op.create_table(
        "standing",
        sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("secret", sa.LargeBinary(), nullable=False),
        sa.Column("road_version_id", sa.BigInteger(), nullable=False),
        schema="told",
    )
    op.execute("""
        INSERT INTO told.standing
        SELECT 1, decode(replace(CONCAT(gen_random_uuid(), gen_random_uuid()), '-', ''), 'hex'), 0
    """)


def _editions() -> None:
    op.create_table(
        "editions",
        sa.Column("number", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("owners", sa.Integer(), nullable=False),
        sa.Column("owners_needed", sa.Integer(), nullable=False),
        sa.Column("segments", sa.BigInteger(), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.Column("withheld_share", sa.Double()),
        sa.Column("withheld_length_share", sa.Double()),
        sa.Column("files", JSONB(), server_default=sa.text("'[]'"), nullable=False),
    )


def _zones() -> None:
    op.create_table(
        "owner_zones",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column(
            "owner_id", sa.BigInteger(), sa.ForeignKey("owners.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("lon_deg", sa.Double(), nullable=False),
        sa.Column("lat_deg", sa.Double(), nullable=False),
        sa.Column("radius_m", sa.Double(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.CheckConstraint("radius_m > 0", name="radius"),
    )
    op.create_index("ix_owner_zones_owner_id", "owner_zones", ["owner_id"])
    op.execute("ALTER TABLE owner_zones ENABLE ROW LEVEL SECURITY")
    op.execute("CREATE POLICY versant_operator ON owner_zones TO versant_operator USING (true)")
    op.execute(f"CREATE POLICY versant_owner ON owner_zones TO versant_owner USING ({IS_OWNERS})")


def downgrade() -> None:
    """Take back: there are no editions, and what was told has to be told anew from the first one on."""
    op.drop_table("owner_zones")
    op.drop_table("editions")
    op.execute("DROP SCHEMA edition CASCADE")
    op.execute("DROP SCHEMA told CASCADE")
