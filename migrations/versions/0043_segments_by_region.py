"""Segments are found by their regions, so that an import reads what is near its file and not the whole table.

Adds an index only: programs of the revision before run beside it. Imports wait while it is made, 10 s for ten million
segments.
"""

from alembic import op

revision = "0043"
down_revision = "0042"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_index(op.f("ix_segments_regions"), "segments", ["regions"], postgresql_using="gin")


def downgrade() -> None:
    """Take back."""
    op.drop_index(op.f("ix_segments_regions"), table_name="segments")
