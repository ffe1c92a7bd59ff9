"""What repeats say of the sigmas of each class of devices, and what they are multiplied by (``app.network.widenings``).

Adds only: programs of the revision before neither need nor notice it, and take drives at their word.
"""

import sqlalchemy as sa
from alembic import op

revision = "0030"
down_revision = "0029"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "device_classes",
        sa.Column("name", sa.String(), primary_key=True),
        sa.Column("applied", sa.Double(), nullable=False),
        sa.Column("learned", sa.Double(), nullable=False),
        sa.Column("sigma", sa.Double(), nullable=False),
        sa.Column("pairs", sa.Integer(), nullable=False),
        sa.Column("drive_pairs", sa.Integer(), nullable=False),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("learned_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("marked_after", sa.Uuid()),
        sa.CheckConstraint("applied >= 1", name="applied"),
    )


def downgrade() -> None:
    """Take back: the next solution of each cell takes its drives at their word."""
    op.drop_table("device_classes")
