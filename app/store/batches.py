"""Many drives processed again at once: a batch is known by the moment at which it was asked for."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import text
from sqlalchemy.orm import Session

# In the order of ids, so that two who ask at once do not wait for each other. now() is the transaction's: one
# moment for all of them.
_REQUEST = text(
    """
    WITH chosen AS (
        SELECT id FROM drives
        WHERE status IN ('done', 'failed') AND method <> :method
            AND (CAST(:from_method AS text) IS NULL OR method = :from_method)
        ORDER BY id FOR UPDATE
    )
    UPDATE drives AS d
    SET status = 'queued', stage = NULL, progress = 0, failure_kind = NULL, failure_reason = NULL,
        failure_where = NULL, method = :method, options = '{}', generation = d.generation + 1,
        queued_at = now(), started_at = NULL, finished_at = NULL
    FROM chosen WHERE d.id = chosen.id
    RETURNING d.id, d.generation
    """
)
_MOMENT = text("SELECT now()")

_PROGRESS = text(
    """
    SELECT count(*) AS drives, count(*) FILTER (WHERE status = 'queued') AS queued,
           count(*) FILTER (WHERE status = 'running') AS running,
           count(*) FILTER (WHERE status = 'done') AS done,
           count(*) FILTER (WHERE status IN ('failed', 'cancelled')) AS failed,
           coalesce(avg(CASE WHEN status = 'queued' THEN 0 WHEN status = 'running' THEN progress ELSE 1 END), 1)
               AS progress
    FROM drives WHERE queued_at = :queued_at
    """
)


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch is; drives that were deleted or asked for anew since are no longer of it."""

    drives: int
    queued: int
    running: int
    done: int
    failed: int
    progress: float


def request_batch(
    session: Session, method: str, from_method: str | None = None
) -> tuple[datetime, list[tuple[uuid.UUID, int]]]:
    """Queue all finished drives that are not of ``method`` (and are of ``from_method``) again, with its defaults.

    Returns the batch's moment, and drive and generation of each. The caller enqueues the jobs in the same
    transaction (``app.ingest.reprocess_all``).
    """
    moment = session.execute(_MOMENT).scalar_one()
    rows = session.execute(_REQUEST, {"method": method, "from_method": from_method})
    return moment, [(row.id, row.generation) for row in rows]


def batch_progress(session: Session, queued_at: datetime) -> BatchProgress:
    """How far the batch of that moment is."""
    row = session.execute(_PROGRESS, {"queued_at": queued_at}).one()
    return BatchProgress(row.drives, row.queued, row.running, row.done, row.failed, float(row.progress))
