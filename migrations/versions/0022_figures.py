"""Figures of the whole map that take a look at every segment, kept with the time of their making.

Adds only: programs of the revision before neither need nor notice it.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "kept_figures",
        sa.Column("name", sa.String(), primary_key=True),
        sa.Column("rows", postgresql.JSONB(), nullable=False),
        sa.Column("made_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("took_s", sa.Double(), nullable=False),
        sa.Column("of_state", sa.String(), nullable=False),
    )


def downgrade() -> None:
    """Take back."""
    op.drop_table("kept_figures")
