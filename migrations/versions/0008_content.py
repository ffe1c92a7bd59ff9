"""What an upload unpacks to is its identity: a gzipped copy is the same drive. Drives from before keep their bytes'."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply. The former code goes on beside it: it leaves the column empty."""
    op.add_column("drives", sa.Column("content_sha256", sa.String(), nullable=True))
    op.create_unique_constraint(op.f("uq_drives_content_sha256"), "drives", ["content_sha256"])


def downgrade() -> None:
    """Take back."""
    op.drop_column("drives", "content_sha256")
