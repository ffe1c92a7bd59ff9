"""Drives under way: streams of points that phones and trackers send; keys of scope ``live``, which stand in addresses.

Adds tables, and a scope of keys. Programs of the revision before refuse such keys: they run beside it as long as nobody
has made one.
"""

import sqlalchemy as sa
from alembic import op

revision = "0047"
down_revision = "0046"
branch_labels = None
depends_on = None

oldest_program = down_revision

_MEASURED = (
    "alt_msl_m",
    "height_ell_m",
    "h_acc_m",
    "v_acc_m",
    "speed_mps",
    "s_acc_mps",
    "heading_deg",
    "odo_speed_mps",
    "pressure_hpa",
)
_OWNERS = "owner_id = (SELECT nullif(current_setting('versant.owner', true), '')::bigint)"
_SENT = "key_id = (SELECT versant_key())"
_OF_A_STREAM = "EXISTS (SELECT FROM live_streams AS s WHERE s.id = stream_id)"


def upgrade() -> None:
    """Apply."""
    _set_scopes("'live', 'upload', 'own', 'operate'")
    _streams()
    op.create_table(
        "live_points",
        _stream(),
        sa.Column("time_us", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("came_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("lat_deg", sa.Double(), nullable=False),
        sa.Column("lon_deg", sa.Double(), nullable=False),
        *(sa.Column(name, sa.Double()) for name in _MEASURED),
    )
    op.create_table(
        "live_drives",
        _stream(),
        sa.Column("drive_id", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("begins_us", sa.BigInteger(), nullable=False),
        sa.Column("ends_us", sa.BigInteger(), nullable=False),
    )
    op.create_index("ix_live_drives_drive_id", "live_drives", ["drive_id"])
    op.create_index("ix_live_drives_stream_id_ends_us", "live_drives", ["stream_id", "ends_us"])
    for table, owners, senders in (
        ("live_streams", _OWNERS, _SENT),
        ("live_points", _OF_A_STREAM, _OF_A_STREAM),
        ("live_drives", _OF_A_STREAM, _OF_A_STREAM),
    ):
        op.execute(f"ALTER TABLE {table} ENABLE ROW LEVEL SECURITY")
        op.execute(f"CREATE POLICY versant_operator ON {table} TO versant_operator USING (true)")
        op.execute(f"CREATE POLICY versant_owner ON {table} TO versant_owner USING ({owners})")
        op.execute(f"CREATE POLICY versant_uploader ON {table} TO versant_uploader USING ({senders})")


def _streams() -> None:
    clock = sa.text("clock_timestamp()")
    op.create_table(
        "live_streams",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column(
            "owner_id",
            sa.BigInteger(),
            sa.ForeignKey("owners.id", ondelete="CASCADE"),
            server_default=sa.text("versant_owner()"),
            nullable=False,
        ),
        sa.Column(
            "key_id",
            sa.Uuid(),
            sa.ForeignKey("keys.id", ondelete="CASCADE"),
            server_default=sa.text("versant_key()"),
        ),
        sa.Column("sender", sa.String(), nullable=False),
        sa.Column("device", sa.String(), nullable=False),
        sa.Column("made_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("seen_at", sa.DateTime(timezone=True), server_default=clock, nullable=False),
        sa.Column("due_at", sa.DateTime(timezone=True)),
        sa.Column("unusable", sa.BigInteger(), server_default="0", nullable=False),
        sa.Column("unusable_why", sa.String()),
    )
    op.create_index("ix_live_streams_owner_id", "live_streams", ["owner_id"])
    op.create_index("ix_live_streams_key_id", "live_streams", ["key_id", "sender", "device"], unique=True)
    op.create_index(
        "ix_live_streams_keyless",
        "live_streams",
        ["owner_id", "sender", "device"],
        unique=True,
        postgresql_where=sa.text("key_id IS NULL"),
    )
    op.create_index(
        "ix_live_streams_due_at", "live_streams", ["due_at"], postgresql_where=sa.text("due_at IS NOT NULL")
    )


def _stream() -> sa.Column[int]:
    return sa.Column(
        "stream_id",
        sa.BigInteger(),
        sa.ForeignKey("live_streams.id", ondelete="CASCADE"),
        primary_key=True,
        autoincrement=False,
    )


def _set_scopes(scopes: str) -> None:
    op.drop_constraint(op.f("ck_keys_scope"), "keys", type_="check")
    op.create_check_constraint("scope", "keys", f"scope IN ({scopes})")


def downgrade() -> None:
    """Take back: what is in no log yet is lost, and addresses let nobody in."""
    for table in ("live_drives", "live_points", "live_streams"):
        op.drop_table(table)
    op.execute("DELETE FROM keys WHERE scope = 'live'")
    _set_scopes("'upload', 'own', 'operate'")
