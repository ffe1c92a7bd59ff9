"""Drives contribute factors: their passes, the evidence of each segment, the slopes of the whole network.

What was published before stays as it is: estimates of drives that were processed without factors are slope-only.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

_TABLES = ("network_slopes", "segment_evidence", "drive_passes")


def upgrade() -> None:
    """Apply."""
    op.add_column(
        "drive_segments",
        sa.Column("in_network", sa.Boolean(), server_default=sa.text("false"), nullable=False),
    )
    op.create_index(
        "ix_drive_segments_slope_only",
        "drive_segments",
        ["segment_id"],
        postgresql_where=sa.text("NOT in_network"),
    )
    _create_passes()
    op.create_table(
        "segment_evidence", _segment_id(), sa.Column("evidence", sa.LargeBinary(), nullable=False)
    )
    op.create_table(
        "network_slopes",
        _segment_id(),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("observations", sa.Integer(), nullable=False),
    )
    # Doubles do not compress, so that trying to would cost time on every write.
    op.execute("ALTER TABLE drive_passes ALTER COLUMN factor SET STORAGE EXTERNAL")
    op.execute("ALTER TABLE segment_evidence ALTER COLUMN evidence SET STORAGE EXTERNAL")


def downgrade() -> None:
    """Take back the network. Slopes in which it had a part are gone until a drive over them runs again."""
    op.execute("DELETE FROM drive_segments WHERE in_network")
    op.execute("DELETE FROM segment_slopes WHERE segment_id IN (SELECT segment_id FROM network_slopes)")
    op.drop_index("ix_drive_segments_slope_only", "drive_segments")
    op.drop_column("drive_segments", "in_network")
    for table in _TABLES:
        op.drop_table(table)


def _segment_id() -> sa.Column:
    target = sa.ForeignKey("segments.id", ondelete="CASCADE")
    return sa.Column("segment_id", sa.BigInteger(), target, primary_key=True, autoincrement=False)


def _create_passes() -> None:
    op.create_table(
        "drive_passes",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("drive_id", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="CASCADE"), nullable=False),
        sa.Column(
            "segment_id", sa.BigInteger(), sa.ForeignKey("segments.id", ondelete="CASCADE"), nullable=False
        ),
        sa.Column("segments", postgresql.ARRAY(sa.BigInteger()), nullable=False),
        sa.Column("factor", sa.LargeBinary(), nullable=False),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
        sa.Column("accepted", sa.Boolean(), nullable=False),
    )
    op.create_index("ix_drive_passes_drive_id", "drive_passes", ["drive_id"])
    op.create_index(
        "ix_drive_passes_segment_id",
        "drive_passes",
        ["segment_id", "drive_id"],
        postgresql_include=["accepted"],
    )
    op.create_index(
        "ix_drive_passes_conditional",
        "drive_passes",
        ["id"],
        postgresql_where=sa.text("cardinality(segments) > 1"),
    )
