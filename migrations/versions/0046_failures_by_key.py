"""Reasons of failures by their keys and parameters, so that pages can say them in their reader's language.

Adds columns only. Programs of the revision before would leave the key of an earlier failure beside the text of theirs,
so they do not run beside it.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0046"
down_revision = "0045"
branch_labels = None
depends_on = None

_TABLES = ("drives", "drive_trials", "exports", "operations")


def upgrade() -> None:
    """Apply."""
    for table in _TABLES:
        op.add_column(table, sa.Column("failure_said", JSONB()))


def downgrade() -> None:
    """Take back."""
    for table in _TABLES:
        op.drop_column(table, "failure_said")
