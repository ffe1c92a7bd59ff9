"""What a person may do with its own data: an owner is removed and leaves a receipt, logs are kept for so many days.

Adds only. A program of the revision before would let the keys of nobody in whose owner is being removed, for they are
revoked, and would say of a drive without its log that the file is lost.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0034"
down_revision = "0033"
branch_labels = None
depends_on = None

oldest_program = down_revision

IS_OWNERS = "owner_id = (SELECT nullif(current_setting('versant.owner', true), '')::bigint)"
HAS_LOG = "log_deleted_at IS NULL"


def upgrade() -> None:
    """Apply."""
    op.add_column("owners", sa.Column("keep_logs_days", sa.Integer()))
    op.add_column("owners", sa.Column("removed_at", sa.DateTime(timezone=True)))
    op.add_column("drives", sa.Column("log_deleted_at", sa.DateTime(timezone=True)))
    op.create_index(
        "ix_drives_owner_id_finished_at",
        "drives",
        ["owner_id", "finished_at"],
        postgresql_where=sa.text(HAS_LOG),
    )
    # The receipt outlasts its owner, so that nothing refers to one.
    op.create_table(
        "owner_removals",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("owner_id", sa.BigInteger(), nullable=False, unique=True),
        sa.Column("asked_on", sa.Date(), nullable=False),
        sa.Column("ended_on", sa.Date()),
        sa.Column("counts", JSONB(), nullable=False),
    )
    op.execute("ALTER TABLE owner_removals ENABLE ROW LEVEL SECURITY")
    op.execute("CREATE POLICY versant_operator ON owner_removals TO versant_operator USING (true)")
    op.execute(f"CREATE POLICY versant_owner ON owner_removals TO versant_owner USING ({IS_OWNERS})")


def downgrade() -> None:
    """Take back: there are no receipts, and of a drive whose log was deleted it is lost."""
    op.drop_table("owner_removals")
    op.drop_index("ix_drives_owner_id_finished_at", "drives")
    op.drop_column("drives", "log_deleted_at")
    op.drop_column("owners", "removed_at")
    op.drop_column("owners", "keep_logs_days")
