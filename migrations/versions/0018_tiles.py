"""Vector tiles that are kept compressed, and the epoch of the versions of squares.

The tiles can be built again: they are in no log, no dump and no standby. Squares that are deleted begin a new epoch:
whoever keeps versions of squares reads all of them anew. Adds only: programs of the revision before go on.
"""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

oldest_program = down_revision

_NEW = "replace(CAST(gen_random_uuid() AS text), '-', '')"

_BEGIN_ANEW = f"""
    CREATE FUNCTION versant_cells_gone() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        UPDATE tile_epoch SET epoch = {_NEW};
        RETURN NULL;
    END $$
"""  # noqa: S608 - a constant


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "stored_tiles",
        sa.Column("layer", sa.String(), nullable=False),
        sa.Column("z", sa.SmallInteger(), nullable=False),
        sa.Column("x", sa.Integer(), nullable=False),
        sa.Column("y", sa.Integer(), nullable=False),
        sa.Column("tag", sa.String(), nullable=False),
        sa.Column("size_bytes", sa.Integer(), nullable=False),
        sa.Column("asked", sa.BigInteger(), server_default=sa.text("1"), nullable=False),
        sa.Column("asked_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("body", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("layer", "z", "x", "y"),
        prefixes=["UNLOGGED"],
        postgresql_with={"toast_tuple_target": "128"},  # who looks through the table reads no bodies
    )
    op.execute("ALTER TABLE stored_tiles ALTER COLUMN body SET STORAGE EXTERNAL")  # it is compressed
    op.create_table(
        "tile_epoch",
        sa.Column("id", sa.SmallInteger(), primary_key=True, autoincrement=False),
        sa.Column("epoch", sa.String(), nullable=False),
    )
    op.execute(f"INSERT INTO tile_epoch (id, epoch) VALUES (1, {_NEW})")  # noqa: S608 - a constant
    op.execute(_BEGIN_ANEW)
    op.execute(
        """
        CREATE TRIGGER versant_cells_gone AFTER DELETE OR TRUNCATE ON cells
        FOR EACH STATEMENT EXECUTE FUNCTION versant_cells_gone()
        """
    )


def downgrade() -> None:
    """Take back."""
    op.execute("DROP TRIGGER versant_cells_gone ON cells")
    op.execute("DROP FUNCTION versant_cells_gone()")
    op.drop_table("tile_epoch")
    op.drop_table("stored_tiles")
