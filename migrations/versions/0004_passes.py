"""Passes are the truth: factors that hang together through their drive, and nothing condensed from them.

What was stored for the former model cannot be read any more, so every drive that had factors waits for another run;
the workers give it a job (``app.drives.renewal``). What is published stays until that run, or what runs beside it,
puts another slope in its place. Heights of the elevation model are filled in by the workers, too.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

_OF_NETWORK = (
    "driven_share",
    "height_from_m",
    "height_to_m",
    "height_sigma_m",
    "steepest_percent",
    "steepest_from_m",
    "steepest_to_m",
)

# A worker that runs one of them just now finds by the generation that its result is unwanted.
_ASK_ANEW = """
    UPDATE drives
    SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, generation = generation + 1, queued_at = now(), started_at = NULL, finished_at = NULL
    WHERE id IN (SELECT drive_id FROM drive_passes UNION SELECT drive_id FROM drive_segments WHERE in_network)
"""

# The former code gives no job to a drive that waits for none.
_STOP_WAITING = """
    UPDATE drives AS d
    SET status = 'failed', failure_kind = 'interrupted', finished_at = now(),
        failure_reason = 'The service went back to a former version before this drive ran again. Ask for it again.'
    WHERE d.status = 'queued' AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j
        WHERE j.status IN ('todo', 'doing') AND j.args ->> 'drive_id' = CAST(d.id AS text)
            AND CAST(j.args ->> 'generation' AS integer) = d.generation)
"""

_CLEAR_PUBLISHED = "DELETE FROM segment_slopes WHERE segment_id IN (SELECT segment_id FROM network_slopes)"


def upgrade() -> None:
    """Apply."""
    op.execute(_ASK_ANEW)
    op.execute("DELETE FROM network_slopes")
    op.drop_table("segment_evidence")
    op.drop_table("drive_passes")
    _create_passes(
        sa.Column("sequence", sa.Integer(), nullable=False),
        sa.Column("entered_s", sa.Double(), nullable=False),
    )
    op.create_index(
        "ix_drive_passes_segment_id_entered_s",
        "drive_passes",
        ["segment_id", "entered_s"],
        postgresql_include=["drive_id"],
    )
    op.create_table(
        "drive_constants",
        sa.Column("drive_id", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("passes", sa.Integer(), nullable=False),
        sa.Column("said", sa.LargeBinary(), nullable=False),
        sa.Column("measurements", sa.Integer(), nullable=False),
        sa.Column("epoch_s", sa.LargeBinary(), nullable=False),
    )
    for table in ("network_slopes", "segment_slopes"):
        for name in _OF_NETWORK:
            op.add_column(table, sa.Column(name, sa.Double(), nullable=True))
    op.add_column("segments", sa.Column("dem_heights_m", postgresql.ARRAY(sa.Double()), nullable=True))
    op.add_column(
        "drives",
        sa.Column("same_as", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="SET NULL"), nullable=True),
    )
    op.create_index(
        "ix_drives_same_as", "drives", ["same_as"], postgresql_where=sa.text("same_as IS NOT NULL")
    )
    op.create_index(
        "ix_segments_without_heights",
        "segments",
        ["id"],
        postgresql_where=sa.text("dem_slope_percent IS NOT NULL AND dem_heights_m IS NULL"),
    )


def downgrade() -> None:
    """Take back. Slopes in which the network had a part are gone until a drive over them runs again."""
    op.execute(_STOP_WAITING)
    op.execute("DELETE FROM drive_segments WHERE in_network")
    op.execute(_CLEAR_PUBLISHED)
    op.execute("DELETE FROM network_slopes")
    op.drop_index("ix_segments_without_heights", "segments")
    op.drop_index("ix_drives_same_as", "drives")
    op.drop_column("drives", "same_as")
    op.drop_column("segments", "dem_heights_m")
    for table in ("segment_slopes", "network_slopes"):
        for name in reversed(_OF_NETWORK):
            op.drop_column(table, name)
    op.drop_table("drive_constants")
    op.drop_table("drive_passes")
    _create_passes(
        sa.Column("segments", postgresql.ARRAY(sa.BigInteger()), nullable=False),
        sa.Column("slope_percent", sa.Double(), nullable=False),
        sa.Column("slope_sigma_percent", sa.Double(), nullable=False),
    )
    op.create_index(
        "ix_drive_passes_conditional",
        "drive_passes",
        ["id"],
        postgresql_where=sa.text("cardinality(segments) > 1"),
    )
    op.create_table(
        "segment_evidence",
        sa.Column(
            "segment_id",
            sa.BigInteger(),
            sa.ForeignKey("segments.id", ondelete="CASCADE"),
            primary_key=True,
            autoincrement=False,
        ),
        sa.Column("evidence", sa.LargeBinary(), nullable=False),
    )
    op.execute("ALTER TABLE segment_evidence ALTER COLUMN evidence SET STORAGE EXTERNAL")


def _create_passes(*columns: sa.Column) -> None:
    """The table of passes with those ``columns`` that are not the same in both models."""
    op.create_table(
        "drive_passes",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("drive_id", sa.Uuid(), sa.ForeignKey("drives.id", ondelete="CASCADE"), nullable=False),
        sa.Column(
            "segment_id", sa.BigInteger(), sa.ForeignKey("segments.id", ondelete="CASCADE"), nullable=False
        ),
        *columns,
        sa.Column("factor", sa.LargeBinary(), nullable=False),
        sa.Column("accepted", sa.Boolean(), nullable=False),
    )
    op.create_index("ix_drive_passes_drive_id", "drive_passes", ["drive_id"])
    op.create_index(
        "ix_drive_passes_segment_id",
        "drive_passes",
        ["segment_id", "drive_id"],
        postgresql_include=["accepted"],
    )
    # Doubles do not compress, so that trying to would cost time on every write.
    op.execute("ALTER TABLE drive_passes ALTER COLUMN factor SET STORAGE EXTERNAL")
