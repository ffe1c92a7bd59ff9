"""Exports that the service makes and keeps for some days.

Adds only: programs of the revision before go on. The files lie in the blob store; backups leave both out.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    moment = sa.DateTime(timezone=True)
    op.create_table(
        "exports",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("request", postgresql.JSONB(), nullable=False),
        sa.Column("request_sha256", sa.String(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("progress", sa.Double(), server_default="0", nullable=False),
        sa.Column("run", sa.Integer(), server_default="0", nullable=False),
        sa.Column("yields", sa.SmallInteger(), server_default="0", nullable=False),
        sa.Column("data_version", sa.String()),
        sa.Column("provenance", postgresql.JSONB()),
        sa.Column("companions", postgresql.JSONB(), server_default=sa.text("'{}'"), nullable=False),
        sa.Column("notes", postgresql.JSONB(), server_default=sa.text("'{}'"), nullable=False),
        sa.Column("entries", sa.BigInteger()),
        sa.Column("file_name", sa.String(), nullable=False),
        sa.Column("media_type", sa.String(), nullable=False),
        sa.Column("blob_key", sa.String()),
        sa.Column("sha256", sa.String()),
        sa.Column("size_bytes", sa.BigInteger()),
        sa.Column("failure_kind", sa.String()),
        sa.Column("failure_reason", sa.String()),
        sa.Column("created_at", moment, server_default=sa.func.now(), nullable=False),
        sa.Column("started_at", moment),
        sa.Column("finished_at", moment),
        sa.Column("expires_at", moment),
        sa.PrimaryKeyConstraint("id"),
        sa.CheckConstraint("status IN ('queued', 'running', 'done', 'failed', 'cancelled')", name="status"),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )
    op.create_index("ix_exports_request_sha256", "exports", ["request_sha256"])
    op.create_index("ix_exports_created_at_id", "exports", ["created_at", "id"])
    op.create_index("ix_exports_expires_at", "exports", ["expires_at"])


def downgrade() -> None:
    """Take back."""
    op.drop_table("exports")
