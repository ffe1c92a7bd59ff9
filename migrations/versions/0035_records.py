"""The records of logs are counted for an owner and a day, and there are quotas of them.

Adds only: programs of the revision before count no records and know no quota of them. A drive that they compute is
counted when it is computed anew, as are those from before.
"""

import sqlalchemy as sa
from alembic import op

revision = "0035"
down_revision = "0034"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.add_column("owners", sa.Column("quota_records", sa.BigInteger()))
    op.add_column("owner_use", sa.Column("records", sa.BigInteger(), nullable=False, server_default="0"))
    op.add_column("drives", sa.Column("records", sa.BigInteger()))


def downgrade() -> None:
    """Take back: no records are counted."""
    op.drop_column("drives", "records")
    op.drop_column("owner_use", "records")
    op.drop_column("owners", "quota_records")
