"""The drives' jobs: a drive's row and its job commit together. What a job is, ``app.jobs`` knows."""

from __future__ import annotations

import uuid

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.claims import taken
from app.core.settings import Settings
from app.jobs.computations import SIGNS, Signs
from app.jobs.task import QUEUE, Kind, add_job

AHEAD = 10
"""Priority of what is short and lets others wait: solving cells, taking back what a removed drive said."""
BEHIND = -100
"""Priority of drives that are processed again by the thousand: uploads go first."""

TASK = "process_drive"
PROCESS_DRIVE = Kind(TASK)
PROCESS_BEHIND = Kind(TASK, BEHIND)
REMOVE_DRIVE = Kind("remove_drive", AHEAD)
SOLVE = Kind("solve", AHEAD)

IMPORT = "import of drives"
"""The claim of who brings drives in that are computed already (``app.drives.batches.importing``)."""

# The queue's own function raises where a job waits already, which would end the session's transaction.
_ASK_SOLVER = text("""
    INSERT INTO procrastinate_jobs (queue_name, task_name, priority, queueing_lock)
    VALUES (:queue, CAST(:task AS text), :priority, CAST(:task AS text))
    ON CONFLICT (queueing_lock) WHERE status = 'todo' DO NOTHING
""")

# Through the queue's index on priorities of waiting jobs.
_WAIT = text("""
    SELECT EXISTS (
        SELECT FROM procrastinate_jobs
        WHERE status = 'todo' AND priority >= :least AND task_name = :task
            AND (scheduled_at IS NULL OR scheduled_at <= now()))
""")


def jobs_behind(task: str) -> str:
    """SQL that adds jobs of many drives, behind those of uploads, oldest upload first; how many.

    It stands in a query on rows that each have a drive's id, generation and created_at. The jobs have no lock: what a
    lock spares is a run of an older generation, and that ends at its next sign of progress.
    """
    return f"""
    coalesce(cardinality(procrastinate_defer_jobs_v1(array_agg(
        CAST(ROW('{QUEUE}', '{task}', {BEHIND}, NULL, NULL,
                 jsonb_build_object('drive_id', id, 'generation', generation), NULL) AS procrastinate_job_to_defer_v1)
        ORDER BY created_at, id))), 0)
"""


def enqueue(session: Session, drive_id: uuid.UUID, generation: int, kind: Kind = PROCESS_DRIVE) -> None:
    """Add the drive's job in the session's transaction: a rollback drops it, a commit wakes a worker.

    Jobs of one drive run one after the other: a job for an older generation ends at its next sign of
    progress.
    """
    add_job(session, kind, lock=str(drive_id), drive_id=str(drive_id), generation=generation)


def enqueue_removal(session: Session, drive_id: uuid.UUID, generation: int) -> None:
    """Add the job that takes back what a drive said; as ``enqueue``."""
    add_job(session, REMOVE_DRIVE, drive_id=str(drive_id), generation=generation)


def enqueue_solve(session: Session) -> None:
    """Ask for a solver in the session's transaction; one that waits already will do for all that is marked by then."""
    session.execute(_ASK_SOLVER, {"queue": QUEUE, "task": SOLVE.name, "priority": SOLVE.priority})


def drives_wait(session: Session, *, behind: bool) -> bool:
    """Whether drives wait to be processed; ``behind``: also those of batches, and of an import that is under way."""
    if behind and taken(session, IMPORT):
        return True
    least = 2 * BEHIND if behind else BEHIND // 2
    return bool(session.execute(_WAIT, {"task": TASK, "least": least}).scalar_one())


def lanes_here(settings: Settings) -> int:
    """How many lanes of workers live on this machine, by signs that the kernel takes away with their processes."""
    return Signs(settings.data_dir / SIGNS).living()
