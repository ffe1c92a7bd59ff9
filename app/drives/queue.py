"""The job queue inside the database (procrastinate): a drive's row and its job commit together."""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from typing import Any

from sqlalchemy.orm import Session

from app.jobs.task import FORMATTER as _FORMATTER
from app.jobs.task import QUEUE, Kind, add_job

TASK = "process_drive"
PROCESS_DRIVE = Kind(TASK)

BEHIND = -100
"""Priority of drives that are processed again by the thousand: uploads go first."""


def enqueue(session: Session, drive_id: uuid.UUID, generation: int) -> None:
    """Add the drive's job in the session's transaction: a rollback drops it, a commit wakes a worker.

    Jobs of one drive run one after the other: a job for an older generation ends at its next sign of
    progress.
    """
    add_job(session, PROCESS_DRIVE, lock=str(drive_id), drive_id=str(drive_id), generation=generation)


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
