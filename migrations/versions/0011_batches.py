"""Batches of drives that are asked for anew, counts of drives that are kept as they change, indexes of a long queue.

Counts are rows that are only ever added, by triggers, so that no two workers write the same one; the workers' chore
adds them up (``app.drives.batches.store``).
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

_COUNT = """
    INSERT INTO drive_counts (day, status, failure_kind, batch_id, drives, distance_m, size_bytes)
    SELECT day, status, failure_kind, batch_id, sum(drives), sum(distance_m), sum(size_bytes) FROM ({rows}) AS changed
    GROUP BY day, status, failure_kind, batch_id
    HAVING sum(drives) <> 0 OR sum(distance_m) <> 0 OR sum(size_bytes) <> 0
"""
_ROWS = """
    SELECT CAST(created_at AT TIME ZONE 'UTC' AS date) AS day, status, failure_kind, batch_id, {sign} 1 AS drives,
           {sign} coalesce(distance_m, 0) AS distance_m, {sign} size_bytes AS size_bytes
    FROM {table}
"""
_CAME, _WENT = _ROWS.format(sign="+", table="came"), _ROWS.format(sign="-", table="went")

_FUNCTION = f"""
    CREATE FUNCTION count_drives() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        IF TG_OP = 'INSERT' THEN {_COUNT.format(rows=_CAME)};
        ELSIF TG_OP = 'DELETE' THEN {_COUNT.format(rows=_WENT)};
        ELSE {_COUNT.format(rows=f"{_CAME} UNION ALL {_WENT}")};
        END IF;
        RETURN NULL;
    END $$
"""
_TRIGGERS = {
    "INSERT": "NEW TABLE AS came",
    "UPDATE": "NEW TABLE AS came OLD TABLE AS went",
    "DELETE": "OLD TABLE AS went",
}

# Fetching a job asks for each candidate whether another of its lock goes first: without the first index that reads
# the whole queue. The second finds the job of a drive.
_WAITING = "WHERE status IN ('todo', 'doing')"
_QUEUE_INDEXES = {
    "ix_procrastinate_jobs_lock": "(lock)",
    "ix_procrastinate_jobs_drive_id": "((args ->> 'drive_id'))",
}


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "batches",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("asked_at", sa.DateTime(timezone=True), server_default=sa.func.now(), nullable=False),
        sa.Column("selection", postgresql.JSONB(), nullable=False),
        sa.Column("method", sa.String()),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("drives", sa.Integer(), server_default="0", nullable=False),
        sa.Column("after_created_at", sa.DateTime(timezone=True)),
        sa.Column("after_id", sa.Uuid()),
        sa.CheckConstraint("state IN ('enqueuing', 'enqueued', 'cancelled')", name=op.f("ck_batches_state")),
    )
    op.create_index(
        "uq_batches_enqueuing",
        "batches",
        ["selection", sa.text("coalesce(method, '')")],
        unique=True,
        postgresql_where=sa.text("state = 'enqueuing'"),
    )
    target = sa.ForeignKey("batches.id", ondelete="SET NULL", name=op.f("fk_drives_batch_id_batches"))
    op.add_column("drives", sa.Column("batch_id", sa.BigInteger(), target))
    op.add_column("drives", sa.Column("before_batch", postgresql.JSONB()))
    op.create_index(
        "ix_drives_queued_at", "drives", ["queued_at"], postgresql_where=sa.text("status = 'queued'")
    )
    _count_drives()
    op.add_column("road_versions", sa.Column("length_m", sa.Double()))
    op.execute(
        "UPDATE road_versions SET length_m = (SELECT coalesce(sum(length_m), 0) FROM segments) "
        "WHERE id = (SELECT max(id) FROM road_versions)"
    )
    for name, columns in _QUEUE_INDEXES.items():
        op.execute(f"CREATE INDEX {name} ON procrastinate_jobs {columns} {_WAITING}")


def downgrade() -> None:
    """Take back. What batches took into the queue stays there."""
    for name in _QUEUE_INDEXES:
        op.drop_index(name, "procrastinate_jobs")
    op.drop_column("road_versions", "length_m")
    for event in _TRIGGERS:
        op.execute(f"DROP TRIGGER count_drives_{event.lower()} ON drives")
    op.execute("DROP FUNCTION count_drives")
    op.drop_table("drive_counts")
    op.drop_index("ix_drives_queued_at", "drives")
    op.drop_column("drives", "before_batch")
    op.drop_column("drives", "batch_id")
    op.drop_table("batches")


def _count_drives() -> None:
    op.create_table(
        "drive_counts",
        sa.Column("id", sa.BigInteger(), sa.Identity(), primary_key=True),
        sa.Column("day", sa.Date(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("failure_kind", sa.String()),
        sa.Column("batch_id", sa.BigInteger()),
        sa.Column("drives", sa.Integer(), nullable=False),
        sa.Column("distance_m", sa.Double(), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
    )
    op.execute(_FUNCTION)
    # The triggers first: from here on no other transaction changes a drive until this one commits.
    for event, rows in _TRIGGERS.items():
        op.execute(
            f"CREATE TRIGGER count_drives_{event.lower()} AFTER {event} ON drives REFERENCING {rows} "
            "FOR EACH STATEMENT EXECUTE FUNCTION count_drives()"
        )
    op.execute(_COUNT.format(rows=_ROWS.format(sign="+", table="drives")))
