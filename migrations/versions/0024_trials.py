"""Trials: drives computed by another method for a look at them, kept for some days.

Adds only: programs of the revision before go on. Backups leave them out.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0024"
down_revision = "0022"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    moment = sa.DateTime(timezone=True)
    op.create_table(
        "drive_trials",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("drive_id", sa.Uuid(), nullable=False),
        sa.Column("method", sa.String(), nullable=False),
        sa.Column("options", postgresql.JSONB(), nullable=False),
        sa.Column("asked_sha256", sa.String(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("stage", sa.String()),
        sa.Column("progress", sa.Double(), server_default="0", nullable=False),
        sa.Column("run", sa.Integer(), server_default="0", nullable=False),
        sa.Column("failure_kind", sa.String()),
        sa.Column("failure_reason", sa.String()),
        sa.Column("failure_where", sa.String()),
        sa.Column("report", postgresql.JSONB()),
        sa.Column("track", sa.LargeBinary()),
        sa.Column("measurements", sa.LargeBinary()),
        sa.Column("slopes", sa.LargeBinary()),
        sa.Column("created_at", moment, server_default=sa.func.now(), nullable=False),
        sa.Column("started_at", moment),
        sa.Column("finished_at", moment),
        sa.PrimaryKeyConstraint("id"),
        sa.ForeignKeyConstraint(["drive_id"], ["drives.id"], ondelete="CASCADE"),
        sa.UniqueConstraint("drive_id", "asked_sha256"),
        sa.CheckConstraint("status IN ('queued', 'running', 'done', 'failed')", name="status"),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )
    op.create_index("ix_drive_trials_finished_at", "drive_trials", ["finished_at"])


def downgrade() -> None:
    """Take back."""
    op.drop_table("drive_trials")
