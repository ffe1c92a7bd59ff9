"""Following the map: one history of the numbers of transactions, and who is told of changes.

A database that is made from another's copy begins a history of its own (``app.changes.store``). Adds only: programs of
the revision before go on.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

oldest_program = down_revision


def _moment(name: str, *, now: bool = False, nullable: bool = False) -> sa.Column[sa.DateTime]:
    default = sa.func.now() if now else None
    return sa.Column(name, sa.DateTime(timezone=True), server_default=default, nullable=nullable)


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "change_epoch",
        sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("epoch", sa.String(), nullable=False),
        sa.Column("place", sa.String(), nullable=False),
        sa.Column("xid", sa.BigInteger(), nullable=False),
        sa.Column("pruned_xid", sa.BigInteger(), server_default="0", nullable=False),
        _moment("begun_at", now=True),
        sa.CheckConstraint("id = 1", name="singleton"),
    )
    op.create_table(
        "webhooks",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("url", sa.String(), nullable=False),
        sa.Column("secret", sa.String(), nullable=False),
        sa.Column("events", postgresql.ARRAY(sa.TEXT()), nullable=False),
        sa.Column("bbox", postgresql.ARRAY(sa.Double())),
        sa.Column("active", sa.Boolean(), server_default=sa.text("true"), nullable=False),
        sa.Column("off_reason", sa.String()),
        sa.Column("told", sa.String()),
        sa.Column("failures", sa.Integer(), server_default="0", nullable=False),
        _moment("failing_since", nullable=True),
        _moment("last_success_at", nullable=True),
        _moment("next_at", now=True),
        _moment("claimed_until", nullable=True),
        _moment("created_at", now=True),
    )
    _deliveries()


def _deliveries() -> None:
    op.create_table(
        "webhook_deliveries",
        sa.Column("id", sa.Uuid(), primary_key=True),
        sa.Column("webhook_id", sa.Uuid(), sa.ForeignKey("webhooks.id", ondelete="CASCADE"), nullable=False),
        sa.Column("event", sa.String(), nullable=False),
        sa.Column("data", postgresql.JSONB(), nullable=False),
        _moment("created_at", now=True),
        sa.Column("state", sa.String(), server_default="waiting", nullable=False),
        sa.Column("attempts", sa.Integer(), server_default="0", nullable=False),
        _moment("due_at", now=True),
        _moment("ended_at", nullable=True),
        sa.Column("status", sa.Integer()),
        sa.Column("problem", sa.String()),
        sa.CheckConstraint("state IN ('waiting', 'taken', 'given up')", name="state"),
    )
    waiting = sa.text("state = 'waiting'")
    op.create_index(
        "ix_webhook_deliveries_waiting",
        "webhook_deliveries",
        ["webhook_id", "due_at"],
        postgresql_where=waiting,
    )
    op.create_index("ix_webhook_deliveries_created_at", "webhook_deliveries", ["webhook_id", "created_at"])
    ended = sa.text("ended_at IS NOT NULL")
    op.create_index(
        "ix_webhook_deliveries_ended_at", "webhook_deliveries", ["ended_at"], postgresql_where=ended
    )


def downgrade() -> None:
    """Take back."""
    op.drop_table("webhook_deliveries")
    op.drop_table("webhooks")
    op.drop_table("change_epoch")
