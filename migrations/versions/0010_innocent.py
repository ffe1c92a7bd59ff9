"""Which computations run, and how often one took its process along; which programs a schema serves; the queue's files.

Adds only: programs of older revisions neither need nor notice it.
"""

import sqlalchemy as sa
from alembic import op

from app.core import schema

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

oldest_program = "0010"  # older ones demand their own revision, whatever is said here


def _of_one_row() -> tuple[sa.Column, sa.CheckConstraint]:
    number = sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False)
    return number, sa.CheckConstraint("id = 1", name="singleton")


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "computations",
        sa.Column("job_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("deaths", sa.SmallInteger(), server_default="0", nullable=False),
        sa.Column("since", sa.DateTime(timezone=True)),
        sa.Column("process", sa.String()),
        sa.Column("backend", sa.Integer()),
        sa.Column("backend_start", sa.DateTime(timezone=True)),
    )
    op.create_table(
        "schema_support", *_of_one_row(), sa.Column("oldest_program", sa.String(), nullable=False)
    )
    op.create_table(
        "queue_migrations",
        sa.Column("name", sa.String(), primary_key=True),
        sa.Column("applied_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
    )
    schema.adopt_queue(op.get_bind().connection.driver_connection)


def downgrade() -> None:
    """Take back; what the record said of the queue is kept at its table."""
    last = op.get_bind().execute(sa.text("SELECT max(name) FROM queue_migrations")).scalar_one()
    schema.comment_on_queue(op.get_bind().connection.driver_connection, last)
    for table in ("queue_migrations", "schema_support", "computations"):
        op.drop_table(table)
