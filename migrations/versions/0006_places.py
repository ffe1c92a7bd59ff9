"""Passes speak of where the vehicle was: what was stored says nothing of it and cannot be read any more.

Every drive that has passes waits for another run, which the workers see to (``app.drives.renewal``). What is published
stays until then.
"""

from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# A worker that runs one of them just now finds by the generation that its result is unwanted.
_ASK_ANEW = """
    UPDATE drives
    SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, generation = generation + 1, queued_at = now(), started_at = NULL, finished_at = NULL
    WHERE id IN (SELECT drive_id FROM drive_passes)
"""


def upgrade() -> None:
    """Apply."""
    op.execute(_ASK_ANEW)
    op.execute("TRUNCATE network_slopes, drive_constants, drive_passes")  # passes may be a hundred million


def downgrade() -> None:
    """Take back: the former code computes the drives again in its own way."""
    upgrade()
