"""What the sensors said along a drive, for the picture of its profile; drives processed before have none."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("drive_tracks", sa.Column("measurements", sa.LargeBinary(), nullable=True))


def downgrade() -> None:
    """Take back. Processing a drive again brings its measurements back."""
    op.drop_column("drive_tracks", "measurements")
