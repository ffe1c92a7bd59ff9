"""Drives of a batch are found by an index: of a batch that no drive names any more nobody needs to know for ever.

Adds only: programs of the revision before run beside it.
"""

import sqlalchemy as sa
from alembic import op

revision = "0040"
down_revision = "0039"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    condition = sa.text("batch_id IS NOT NULL")
    op.create_index(op.f("ix_drives_batch_id"), "drives", ["batch_id"], postgresql_where=condition)


def downgrade() -> None:
    """Take back."""
    op.drop_index(op.f("ix_drives_batch_id"), "drives")
