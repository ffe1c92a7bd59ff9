"""Where heights of segments are still to be renewed for the active elevation rasters.

Rasters get bounds and priorities in what lists them, which programs of before cannot read: none serves this schema but
those of this revision. Versions that are there have neither; workers add the bounds, and no priority is 0.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

_PLAIN = """
    UPDATE dem_versions AS v
    SET sources = (SELECT coalesce(jsonb_agg(s - 'priority' - 'bounds_deg' ORDER BY n), '[]')
                   FROM jsonb_array_elements(v.sources) WITH ORDINALITY AS each (s, n)),
        active = active AND v.sources <> '[]'
"""


def upgrade() -> None:
    """Apply."""
    op.add_column("dem_versions", sa.Column("pending", postgresql.JSONB(), nullable=True))


def downgrade() -> None:
    """Take back; heights that are still to be renewed stay as they are."""
    op.drop_column("dem_versions", "pending")
    op.execute(_PLAIN)
