"""Claims: rows with an end of their time, in place of locks that last as long as a connection.

A pooler hands connections on after each transaction, and a lock of a session would go to whoever comes next. A claim is
a row, prolonged by its holder. It is worth nothing after a crash of the server, so the table is not logged. And the
mark of a computation names the process that is at it, whose life is seen on its machine (``app.jobs.signs``), no
longer the connection that it held.

Programs of the revision before lock and do not see claims: two of them beside each other would import roads at once. So
this serves its own programs alone.
"""

import sqlalchemy as sa
from alembic import op

revision = "0037"
down_revision = "0036"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "claims",
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("key", sa.BigInteger(), nullable=False),
        sa.Column("holder", sa.Uuid(), nullable=False),
        sa.Column("process", sa.String(), nullable=False),
        sa.Column("until", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("name", "key", name=op.f("pk_claims")),
        prefixes=["UNLOGGED"],
    )
    op.execute("UPDATE computations SET since = NULL")  # marks of connections, which nobody looks at any more
    op.drop_column("computations", "backend")
    op.drop_column("computations", "backend_start")


def downgrade() -> None:
    """Take back: whoever works just now loses its claims, and what it computes counts against no job."""
    op.execute("UPDATE computations SET since = NULL")
    op.add_column("computations", sa.Column("backend", sa.Integer()))
    op.add_column("computations", sa.Column("backend_start", sa.DateTime(timezone=True)))
    op.drop_table("claims")
