"""Surveyed heights, one at a place."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "control_points",
        sa.Column("lon_deg", sa.Double(), primary_key=True),
        sa.Column("lat_deg", sa.Double(), primary_key=True),
        sa.Column("height_m", sa.Double(), nullable=False),
        sa.Column("sigma_m", sa.Double(), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("imported_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.CheckConstraint("sigma_m > 0", name=op.f("ck_control_points_sigma")),
    )


def downgrade() -> None:
    """Take back. Heights that rest on the points change when their roads are solved again (``versant rebuild``)."""
    op.drop_table("control_points")
