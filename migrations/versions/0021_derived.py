"""How far ways and drawn pieces are derived from segments (``app.map.derived``).

Everything is still to be derived: workers begin with the first change that is noted. Adds only: programs of the
revision before go on, and derive nothing.
"""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "derived_upto",
        sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("xid", sa.BigInteger(), nullable=False),
        sa.Column("segment_id", sa.BigInteger(), nullable=False),
        sa.Column("turn", sa.BigInteger(), nullable=False),
        sa.Column("written_xid", sa.BigInteger(), nullable=False),
        sa.CheckConstraint("id = 1", name="one"),
    )
    op.execute(
        "INSERT INTO derived_upto (id, xid, segment_id, turn, written_xid) VALUES (1, 0, 0, 0, versant_xid())"
    )
    op.create_table(
        "derived_segments",
        sa.Column("segment_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("osm_way_id", sa.BigInteger(), nullable=False),
        sa.Column("cell", sa.Integer(), nullable=False),
    )
    op.create_table(
        "squares_to_draw",
        sa.Column("level", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("square", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("since", sa.DateTime(timezone=True), server_default=sa.text("now()"), nullable=False),
    )


def downgrade() -> None:
    """Take back: what was derived stays, and is followed by nobody."""
    op.drop_table("squares_to_draw")
    op.drop_table("derived_segments")
    op.drop_table("derived_upto")
