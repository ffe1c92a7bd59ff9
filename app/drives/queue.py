"""The job queue inside the database (procrastinate): a drive's row and its job commit together."""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from typing import Any

import procrastinate
from sqlalchemy.orm import Session

QUEUE = "drives"
TASK = "process_drive"

BEHIND = -100
"""Priority of drives that are processed again by the thousand: uploads go first."""

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


def enqueue_behind(session: Session, requests: Iterable[tuple[uuid.UUID, int]]) -> None:
    """Add the jobs of many (drive, generation) pairs in one statement, behind those of uploads."""
    connection: Any = session.connection().connection.driver_connection
    jobs = [
        _FORMATTER.configure_task(TASK, queue=QUEUE, lock=str(drive_id), priority=BEHIND).make_new_job(
            drive_id=str(drive_id), generation=generation
        )
        for drive_id, generation in requests
    ]
    if jobs:
        _FORMATTER.job_manager.batch_defer_jobs(jobs, connection=connection)
