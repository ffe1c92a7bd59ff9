"""Drives know with which import of a batch's folder they came, so that all of one import can be removed.

Adds a column only: programs of the revision before run beside it.
"""

import sqlalchemy as sa
from alembic import op

revision = "0042"
down_revision = "0041"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.add_column(
        "drives",
        sa.Column("import_id", sa.BigInteger(), sa.ForeignKey("batches.id", ondelete="SET NULL")),
    )
    op.create_index(
        op.f("ix_drives_import_id"),
        "drives",
        ["import_id"],
        postgresql_where=sa.text("import_id IS NOT NULL"),
    )


def downgrade() -> None:
    """Take back."""
    op.drop_index(op.f("ix_drives_import_id"), table_name="drives")
    op.drop_column("drives", "import_id")
