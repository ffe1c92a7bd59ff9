"""Segments and ways are found by their steepness, the slope without its sign, so that the steepest come first whichever
way they are drawn.

Adds indexes only. What publishes slopes waits while they are made, some seconds for a million segments with a slope.

Programs of the revision before do not run beside it: they cannot read what drives of more than an hour say of their
constants from now on (``fusion.network.drive_constants``). After going back such drives are to be computed again.
"""

import sqlalchemy as sa
from alembic import op

revision = "0044"
down_revision = "0043"
branch_labels = None
depends_on = None

_STEEPNESS = "abs(slope_percent)"
_SCHEMAS = (None, "edition")
"""The second is what the public reads where there are editions."""


def upgrade() -> None:
    """Apply."""
    for schema in _SCHEMAS:
        op.create_index(
            "ix_segment_slopes_steepness_percent", "segment_slopes", [sa.text(_STEEPNESS)], schema=schema
        )
        op.create_index(
            "ix_ways_steepness_percent",
            "ways",
            [sa.text(_STEEPNESS)],
            schema=schema,
            postgresql_where=sa.text(f"{_STEEPNESS} IS NOT NULL"),
        )


def downgrade() -> None:
    """Take back."""
    for schema in _SCHEMAS:
        op.drop_index("ix_ways_steepness_percent", table_name="ways", schema=schema)
        op.drop_index("ix_segment_slopes_steepness_percent", table_name="segment_slopes", schema=schema)
