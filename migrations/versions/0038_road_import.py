"""What an import of roads copies stands in two tables instead of temporary ones, which are a connection's.

An import takes several transactions, and a pooler gives each to another connection. One import runs at a time (its
claim), so the tables are its own; they are not logged, and empty between imports. Adds only: programs of the revision
before make temporary tables of the same names, which come first for them.
"""

import sqlalchemy as sa
from alembic import op
from geoalchemy2 import Geometry

revision = "0038"
down_revision = "0037"
branch_labels = None
depends_on = None

oldest_program = down_revision


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "road_import",
        sa.Column("n", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("osm_way_id", sa.BigInteger(), nullable=False),
        sa.Column("from_node", sa.BigInteger(), nullable=False),
        sa.Column("to_node", sa.BigInteger(), nullable=False),
        sa.Column("geom", Geometry("LINESTRING", srid=4326, spatial_index=False), nullable=False),
        sa.Column("geom_3857", Geometry("LINESTRING", srid=3857, spatial_index=False), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.Column("tag", sa.Integer(), nullable=False),
        sa.Column("oneway", sa.SmallInteger(), nullable=False),
        sa.Column("bridge", sa.Boolean(), nullable=False),
        sa.Column("tunnel", sa.Boolean(), nullable=False),
        sa.Column("layer", sa.SmallInteger(), nullable=False),
        sa.Column("dem_slope_percent", sa.Double(), nullable=False),
        sa.Column("dem_heights_m", sa.ARRAY(sa.Double()), nullable=False),
        sa.PrimaryKeyConstraint("n", name=op.f("pk_road_import")),
        prefixes=["UNLOGGED"],
    )
    op.create_table(
        "road_import_tags",
        sa.Column("tag", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("highway", sa.String(), nullable=False),
        sa.Column("name", sa.String()),
        sa.PrimaryKeyConstraint("tag", name=op.f("pk_road_import_tags")),
        prefixes=["UNLOGGED"],
    )


def downgrade() -> None:
    """Take back: an import that runs just now fails, and can be begun again."""
    op.drop_table("road_import_tags")
    op.drop_table("road_import")
