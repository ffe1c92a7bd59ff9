"""Indexes for what items are asked for and sorted by: class and name of the road, slope, steepest stretch, last change.

Of a million segments each is made in about a second, during which nobody writes to the table. Adds only: programs of
the revision before go on.
"""

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0017"
branch_labels = None
depends_on = None

oldest_program = down_revision

_OF_SLOPES = ("slope_percent", "steepest_percent", "updated_at")


def upgrade() -> None:
    """Apply."""
    op.create_index("ix_segments_highway", "segments", ["highway"])
    op.create_index("ix_segments_name", "segments", ["name"], postgresql_where=sa.text("name IS NOT NULL"))
    for column in _OF_SLOPES:
        op.create_index(f"ix_segment_slopes_{column}", "segment_slopes", [column])


def downgrade() -> None:
    """Take back."""
    for column in _OF_SLOPES:
        op.drop_index(f"ix_segment_slopes_{column}", table_name="segment_slopes")
    op.drop_index("ix_segments_name", table_name="segments")
    op.drop_index("ix_segments_highway", table_name="segments")
