"""The job queue inside the database (procrastinate): a drive's row and its job commit together."""

from __future__ import annotations

import uuid
from typing import Any

import procrastinate
from sqlalchemy.orm import Session

QUEUE = "drives"
TASK = "process_drive"

BEHIND = -100
"""Priority of drives that are processed again by the thousand: uploads go first."""

# Of rows that each have a drive's id, generation and created_at: their jobs, oldest upload first; null of no rows. They
# have no lock: what a lock spares is a run of an older generation, and that ends at its next sign of progress.
JOBS_BEHIND = f"""
    procrastinate_defer_jobs_v1(array_agg(
        CAST(ROW('{QUEUE}', '{TASK}', {BEHIND}, NULL, NULL,
                 jsonb_build_object('drive_id', id, 'generation', generation), NULL) AS procrastinate_job_to_defer_v1)
        ORDER BY created_at, id))
"""
"""SQL that adds the jobs of many drives, behind those of uploads; the ids of the jobs. They never leave the server."""

# Never opened: it only formats jobs, which are written on the session's own connection.
_FORMATTER = procrastinate.App(connector=procrastinate.SyncPsycopgConnector())


def enqueue(session: Session, drive_id: uuid.UUID, generation: int) -> None:
    """Add the drive's job in the session's transaction: a rollback drops it, a commit wakes a worker.

    Jobs of one drive run one after the other: a job for an older generation ends at its next sign of
    progress.
    """
    connection: Any = session.connection().connection.driver_connection
    job = _FORMATTER.configure_task(TASK, queue=QUEUE, lock=str(drive_id), connection=connection)
    job.defer(drive_id=str(drive_id), generation=generation)
