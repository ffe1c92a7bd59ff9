"""What processes have counted and timed, for /metrics; of drives which version they failed by, when they
were computed and the trace of whoever asked.

Adds only: programs of the revision before neither need nor notice it.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "process_totals",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("process", sa.String(), nullable=False),
        sa.Column("totals", postgresql.JSONB(), nullable=False),
        sa.Column("written_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )
    op.add_column("drives", sa.Column("failure_version", sa.String()))
    op.add_column("drives", sa.Column("computed_at", sa.DateTime(timezone=True)))
    op.add_column("drives", sa.Column("traceparent", sa.String()))


def downgrade() -> None:
    """Take back."""
    for column in ("traceparent", "computed_at", "failure_version"):
        op.drop_column("drives", column)
    op.drop_table("process_totals")
