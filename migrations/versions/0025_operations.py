"""Operations of the operator as jobs, a log of what was asked for that destroys, and how coverage grew.

Adds only: programs of the revision before go on, and leave a region's bounds as they are.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0025"
down_revision = "0024"
branch_labels = None
depends_on = None

oldest_program = down_revision

# Of what is imported already, by one look at every segment.
_BOUNDS = """
    UPDATE regions AS r SET bounds = ARRAY[ST_XMin(e.box), ST_YMin(e.box), ST_XMax(e.box), ST_YMax(e.box)]
    FROM (SELECT region_id, ST_Extent(s.geom) AS box FROM segments AS s, unnest(s.regions) AS region_id
          GROUP BY region_id) AS e
    WHERE e.region_id = r.id
"""


def upgrade() -> None:
    """Apply."""
    moment = sa.DateTime(timezone=True)
    op.add_column("regions", sa.Column("bounds", postgresql.ARRAY(sa.Double())))
    op.execute(_BOUNDS)
    op.create_table(
        "audit_log",
        sa.Column("id", sa.BigInteger(), sa.Identity(), nullable=False),
        sa.Column("at", moment, server_default=sa.func.now(), nullable=False),
        sa.Column("action", sa.String(), nullable=False),
        sa.Column("subject", sa.String(), nullable=False),
        sa.Column("detail", postgresql.JSONB(), nullable=False),
        sa.Column("origin", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_audit_log_at_id", "audit_log", ["at", "id"])
    op.create_index(
        "ix_drives_finished_at",
        "drives",
        ["finished_at"],
        postgresql_include=["status", "distance_m"],
        postgresql_where=sa.text("finished_at IS NOT NULL"),
    )
    op.create_table(
        "driven_by_day",
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("highway", sa.String(), nullable=False),
        sa.Column("segments", sa.BigInteger(), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("day", "highway"),
    )
    op.create_table(
        "operations",
        sa.Column("id", sa.Uuid(), nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("subject", sa.String(), nullable=False),
        sa.Column("request", postgresql.JSONB(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("progress", sa.Double(), server_default="0", nullable=False),
        sa.Column("stage", sa.String()),
        sa.Column("run", sa.Integer(), server_default="0", nullable=False),
        sa.Column("yields", sa.SmallInteger(), server_default="0", nullable=False),
        sa.Column("state", postgresql.JSONB(), server_default=sa.text("'{}'"), nullable=False),
        sa.Column("approved", sa.Boolean(), server_default=sa.text("false"), nullable=False),
        sa.Column("plan", postgresql.JSONB()),
        sa.Column("result", postgresql.JSONB()),
        sa.Column("failure_kind", sa.String()),
        sa.Column("failure_reason", sa.String()),
        sa.Column("blob_key", sa.String()),
        sa.Column("created_at", moment, server_default=sa.func.now(), nullable=False),
        sa.Column("started_at", moment),
        sa.Column("planned_at", moment),
        sa.Column("finished_at", moment),
        sa.PrimaryKeyConstraint("id"),
        sa.CheckConstraint(
            "status IN ('queued', 'running', 'planned', 'done', 'failed', 'cancelled')", name="status"
        ),
        sa.CheckConstraint("progress BETWEEN 0 AND 1", name="progress"),
    )
    op.create_index("ix_operations_created_at_id", "operations", ["created_at", "id"])
    op.create_index("ix_operations_status", "operations", ["status"])


def downgrade() -> None:
    """Take back."""
    op.drop_table("operations")
    op.drop_table("driven_by_day")
    op.drop_table("audit_log")
    op.drop_index("ix_drives_finished_at", "drives")
    op.drop_column("regions", "bounds")
