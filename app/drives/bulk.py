"""Many drives at once in the database: asked for anew, followed, and found where they wait for nothing.

Callers own the transaction and enqueue the jobs (``app.drives.intake``, ``app.drives.renewal``).
"""

from __future__ import annotations

import uuid
from datetime import datetime

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.drives.documents import Batch
from app.drives.queue import TASK
from app.drives.store import ASK_ANEW

# In the order of ids, so that two who ask at once do not wait for each other.
_LOCK_OTHERS = text(
    """
    SELECT id FROM drives
    WHERE status IN ('done', 'failed') AND method <> :method
        AND (CAST(:from_method AS text) IS NULL OR method = :from_method)
    ORDER BY id FOR UPDATE
    """
)

_MOMENT = text("SELECT now()")  # the transaction's: one for all drives of a batch
_BATCH = text(
    """
    SELECT count(*) AS drives, count(*) FILTER (WHERE status = 'queued') AS queued,
           count(*) FILTER (WHERE status = 'running') AS running,
           count(*) FILTER (WHERE status = 'done') AS done,
           count(*) FILTER (WHERE status IN ('failed', 'cancelled')) AS failed,
           coalesce(avg(CASE WHEN status = 'queued' THEN 0 WHEN status = 'running' THEN progress ELSE 1 END), 1)
               AS progress
    FROM drives WHERE queued_at = ANY(CAST(:moments AS timestamptz[]))
    """
)

# Moments at which drives under way were asked for: uploads one by one, batches all at once.
_MOMENTS_UNDER_WAY = text("SELECT DISTINCT queued_at FROM drives WHERE status IN ('queued', 'running')")

# A drive and its job commit together; only what a migration asks for anew has no job. Two that look at once may both
# find a drive: the second of its jobs finds it done.
_WITHOUT_JOB = text(
    """
    SELECT d.id, d.generation FROM drives AS d
    WHERE d.status = 'queued' AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j
        WHERE j.task_name = :task AND j.status IN ('todo', 'doing')
            AND j.args ->> 'drive_id' = CAST(d.id AS text)
            AND CAST(j.args ->> 'generation' AS integer) = d.generation)
    ORDER BY d.created_at, d.id FOR UPDATE OF d SKIP LOCKED
    """
)


def request_batch(
    session: Session, method: str, from_method: str | None = None
) -> tuple[datetime, list[tuple[uuid.UUID, int]]]:
    """Queue all finished drives that are not of ``method`` (and are of ``from_method``) again, with its defaults.

    Returns the batch's moment, and drive and generation of each. The caller enqueues the jobs in the same
    transaction (``app.drives.intake.reprocess_all``).
    """
    moment = session.execute(_MOMENT).scalar_one()
    ids = list(session.execute(_LOCK_OTHERS, {"method": method, "from_method": from_method}).scalars())
    values = {"ids": ids, "method": method, "options": "{}", "queued_at": moment}
    return moment, [(row.id, row.generation) for row in session.execute(ASK_ANEW, values)]


def batch_progress(session: Session, queued_at: datetime | None = None) -> Batch:
    """How far the batch of that moment is; drives that were deleted or asked for anew since are no longer of it.

    Without a moment: all that is under way, batches with what is done of them.
    """
    moments = [queued_at] if queued_at else list(session.execute(_MOMENTS_UNDER_WAY).scalars())
    return Batch(**session.execute(_BATCH, {"moments": moments}).one()._mapping)


def drives_without_job(session: Session) -> list[tuple[uuid.UUID, int]]:
    """Drives that wait although no job is theirs, and their generation; their rows are held."""
    return [(row.id, row.generation) for row in session.execute(_WITHOUT_JOB, {"task": TASK})]
