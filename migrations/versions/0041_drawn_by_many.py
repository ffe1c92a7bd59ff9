"""A tile of the finest level waits to be drawn together with its block, by whose row one lane knows of another.

Programs of the revision before draw alone and would not see it: stop them before the migration.
"""

from alembic import op

revision = "0041"
down_revision = "0040"
branch_labels = None
depends_on = None

# The block of a tile of zoom 14, x << 14 | y, is the one of zoom 12 that it lies in.
_BLOCKS = """
    INSERT INTO {}.cells_to_draw (level, cell, since)
    SELECT 10, ((cell >> 16) << 12) | ((cell & 16383) >> 2), min(since) FROM {}.cells_to_draw WHERE level = 12
    GROUP BY 2
    ON CONFLICT (level, cell) DO NOTHING
"""


def upgrade() -> None:
    """Apply."""
    schema = op.get_bind().exec_driver_sql("SELECT current_schema()").scalar_one()
    for name in (schema, "edition"):
        op.execute(_BLOCKS.format(name, name))


def downgrade() -> None:
    """Take back: former programs draw a block that waits as another tile."""
    schema = op.get_bind().exec_driver_sql("SELECT current_schema()").scalar_one()
    for name in (schema, "edition"):
        op.execute(f"DELETE FROM {name}.cells_to_draw WHERE level = 10")  # noqa: S608 - constants
