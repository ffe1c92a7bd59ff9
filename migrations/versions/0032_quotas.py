"""What an owner uploads in a day, and the quotas of that.

``drive_counts`` cannot serve: a removed drive is subtracted there, so that whoever uploads and removes in turns would
never reach a quota; and its rows are many for one day, so that no lock of one of them keeps two uploads from passing
together. Adds only: programs of the revision before count no use and know no quota.
"""

import sqlalchemy as sa
from alembic import op

revision = "0032"
down_revision = "0031"
branch_labels = None
depends_on = None

oldest_program = down_revision

QUOTAS = ("quota_drives", "quota_bytes")
IS_OWNERS = "owner_id = (SELECT nullif(current_setting('versant.owner', true), '')::bigint)"


def upgrade() -> None:
    """Apply."""
    for quota in QUOTAS:
        op.add_column("owners", sa.Column(quota, sa.BigInteger()))
    op.create_table(
        "owner_use",
        sa.Column(
            "owner_id", sa.BigInteger(), sa.ForeignKey("owners.id", ondelete="CASCADE"), primary_key=True
        ),
        sa.Column("day", sa.Date(), primary_key=True),
        sa.Column("drives", sa.BigInteger(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
    )
    op.execute("ALTER TABLE owner_use ENABLE ROW LEVEL SECURITY")
    op.execute("CREATE POLICY versant_operator ON owner_use TO versant_operator USING (true)")
    op.execute(f"CREATE POLICY versant_owner ON owner_use TO versant_owner USING ({IS_OWNERS})")


def downgrade() -> None:
    """Take back: what was uploaded today is forgotten, and there are no quotas."""
    op.drop_table("owner_use")
    for quota in reversed(QUOTAS):
        op.drop_column("owners", quota)
