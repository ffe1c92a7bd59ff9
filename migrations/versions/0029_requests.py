"""Exports, operations and trials have the same columns for how far they are (``app.core.tables.requests``).

Programs of the revision before neither read nor write the new columns.
"""

import sqlalchemy as sa
from alembic import op

revision = "0029"
down_revision = "0027"
branch_labels = None
depends_on = None

oldest_program = down_revision

_ADDED = {"exports": ("stage", "failure_where"), "operations": ("failure_where",)}


def upgrade() -> None:
    """Apply."""
    for table, columns in _ADDED.items():
        for column in columns:
            op.add_column(table, sa.Column(column, sa.String()))
    op.add_column("drive_trials", sa.Column("yields", sa.SmallInteger(), nullable=False, server_default="0"))


def downgrade() -> None:
    """Take back."""
    op.drop_column("drive_trials", "yields")
    for table, columns in _ADDED.items():
        for column in columns:
            op.drop_column(table, column)
