"""The map has names: places, waters and numbers of roads come with each import of roads.

Adds a table only: programs of the revision before run beside it. Regions that were imported before have no names until
they are imported again.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry

revision = "0045"
down_revision = "0044"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "map_names",
        sa.Column("layer", sa.String(), nullable=False),
        sa.Column("osm_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("population", sa.BigInteger(), nullable=True),
        sa.Column("from_zoom", sa.SmallInteger(), nullable=False),
        sa.Column("regions", sa.ARRAY(sa.SmallInteger()), nullable=False),
        sa.Column("geom_3857", Geometry("GEOMETRY", srid=3857, spatial_index=False), nullable=False),
        sa.PrimaryKeyConstraint("layer", "osm_id", name=op.f("pk_map_names")),
    )
    op.create_index(op.f("ix_map_names_geom_3857"), "map_names", ["geom_3857"], postgresql_using="gist")
    op.create_index(
        "ix_map_names_far",
        "map_names",
        ["geom_3857"],
        postgresql_using="gist",
        postgresql_where=sa.text("from_zoom <= 10"),
    )


def downgrade() -> None:
    """Take back."""
    op.drop_table("map_names")
