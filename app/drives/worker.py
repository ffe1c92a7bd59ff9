"""The worker: takes drives from the queue and processes them, and sees to what an update or a crash left.

How a drive is computed is ``process``'s to know; how jobs are taken, cut off and taken up again is ``app.jobs``'s.
"""

from __future__ import annotations

import functools
import logging
import threading
import uuid
from contextlib import closing
from datetime import timedelta

from app.changes import pages as changes
from app.changes.store import begin_epoch
from app.changes.webhooks import telling
from app.changes.webhooks.telling import Teller
from app.core.db import make_engine, session_factory
from app.core.settings import Settings
from app.core.telemetry import audit
from app.core.telemetry.ledger import FOLD_AFTER_S, WRITE_EVERY_S, Ledger, counting
from app.drives import claims, intake, publishing
from app.drives.batches import enqueuing
from app.drives.batches.removing import removing_task
from app.drives.batches.touched import queue_touched
from app.drives.process import Workbench, give_up, process_drive
from app.drives.queue import BEHIND, PROCESS_DRIVE, REMOVE_DRIVE, SOLVE, enqueue_solve
from app.drives.renewal import HeightFiller, renew
from app.drives.trials.run import tend as tend_trials
from app.drives.trials.run import trial_task
from app.exports.run import export_task, sweep_files
from app.exports.run import tend as tend_exports
from app.jobs.memory import limit_growth
from app.jobs.task import Task, Work
from app.jobs.worker import Chore, Worker, in_thread
from app.map.derived import following
from app.map.statistics import figures, growth
from app.operations.run import operation_task
from app.operations.run import tend as tend_operations
from app.roads import retired
from app.terrain.files import sweep_rasters

logger = logging.getLogger(__name__)

SWEEP_EVERY_S = 3600.0
"""How often the blob store is cleared of what nobody refers to, seconds."""

PUBLISH_LOOK_EVERY_S = 1.0
"""How often a worker looks whether squares are due that nobody was asked to solve, seconds."""

DERIVE_LOOK_EVERY_S = 1.0
"""How often a worker looks whether ways and drawn pieces are to follow what changed of segments, seconds."""

SETTLE_LOOK_EVERY_S = 60.0
"""How often a worker looks whether squares are to be settled, seconds."""

EPOCH_LOOK_EVERY_S = 30.0
"""How often a worker looks whether the database was restored beneath it, seconds."""

RENEW_EVERY_S = 600.0
"""How often a worker looks for what an update of the service left to be done, seconds."""


def run_worker(
    settings: Settings,
    *,
    wait: bool = True,
    stop_event: threading.Event | None = None,
    with_chores: bool = True,
    process: str = "worker",
    renewed: bool = False,
) -> bool:
    """Process drives, one after the other, until SIGTERM or SIGINT (in the main thread) or ``stop_event``.

    With ``wait=False`` it returns as soon as the queue is empty and what follows from it is derived. May run in any
    thread. Asked to stop it ends within ``settings.grace_s``; in the main thread whatever its drive does, for then the
    process is taken to be its own.
    Without ``with_chores`` another worker of this machine sees to what is done beside the drives. What it counts is
    written under the name ``process``. ``renewed``: another process takes the place of this one when it ends; it may
    take so much memory as the settings say, and returns True where it ended for having grown.
    """
    if settings.database_url is None:
        raise ValueError("the worker needs settings.database_url")
    if renewed:
        limit_growth(settings.lane_memory_bytes)
    engine = make_engine(settings.database_url, pool_size=2, max_overflow=6, behind=True)
    try:
        bench = Workbench.of(settings, session_factory(engine))
        worker = Worker(settings, engine, bench.sessions, tasks_of(bench, settings))
        with counting(bench.sessions, process) as ledger, closing(Teller(bench.sessions, settings)) as teller:
            written = in_thread(ledger.write, "what was counted could not be written")
            chores = _chores(bench, settings, ledger, teller) if with_chores else ()
            every = ((written, WRITE_EVERY_S), *chores)
            again = worker.run(every, wait=wait, stop_event=stop_event, renewed=renewed)
            if not wait:
                following.follow_all(bench.sessions, stop_event)
            return again
    finally:
        engine.dispose()


def tasks_of(bench: Workbench, settings: Settings) -> tuple[Task, ...]:
    """Everything that a worker can be asked for: one line a task."""
    return (
        _drive_task(bench),
        _removal_task(bench),
        _solver_task(bench),
        export_task(settings, bench.sessions),
        removing_task(bench.sessions),
        operation_task(settings, bench.sessions, queue_touched),
        trial_task(bench),
    )


def _drive_task(bench: Workbench) -> Task:
    def run(work: Work, *, drive_id: str, generation: int) -> str:
        return process_drive(
            bench,
            uuid.UUID(drive_id),
            generation,
            should_stop=work.should_stop,
            behind=work.priority <= BEHIND // 2,
            computing=work.computing,
        ).value

    def fail(kind: str, reason: str, *, drive_id: str, generation: int) -> None:
        give_up(bench, uuid.UUID(drive_id), generation, kind, reason)

    def put_back(*, drive_id: str, generation: int) -> None:
        with bench.sessions.begin() as session:
            claims.mark_queued(session, uuid.UUID(drive_id), generation)

    advice = "Split the log into shorter drives."
    return Task(PROCESS_DRIVE, run, fail, put_back, subject="drive", advice=advice)


def _removal_task(bench: Workbench) -> Task:
    def run(work: Work, *, drive_id: str, generation: int) -> str:
        publishing.remove(bench.sessions, bench.blobs, uuid.UUID(drive_id), generation)
        return "taken back"

    def put_back(*, drive_id: str, generation: int) -> None:
        """The drive stays cancelled, and its job goes back by itself."""

    def fail(kind: str, reason: str, *, drive_id: str, generation: int) -> None:
        logger.error("drive %s could not be removed: %s", drive_id, reason)

    return Task(REMOVE_DRIVE, run, fail, put_back, subject="removal")


def _solver_task(bench: Workbench) -> Task:
    def run(work: Work) -> str:
        with work.computing():
            return f"{publishing.solve_some(bench.sessions, bench.blobs)} squares"

    def put_back() -> None:
        with bench.sessions.begin() as session:
            enqueue_solve(session)

    def fail(kind: str, reason: str) -> None:
        logger.error("what waits to be published could not be solved: %s", reason)

    return Task(SOLVE, run, fail, put_back, subject="part of the map")


def _chores(
    bench: Workbench, settings: Settings, ledger: Ledger, teller: Teller
) -> tuple[tuple[Chore, float], ...]:
    """What is done beside the drives, and how often, s."""
    orphan_age = timedelta(days=settings.orphan_days)
    heights = HeightFiller(bench.sessions, bench.dem_dir)
    renewed, swept = (
        functools.partial(renew, bench.sessions),
        functools.partial(_sweep, bench, settings, orphan_age),
    )
    tended = functools.partial(enqueuing.tend, bench.sessions)
    expired = functools.partial(tend_exports, settings, bench.sessions)
    unplanned = functools.partial(tend_operations, settings, bench.sessions)
    forgotten = functools.partial(tend_trials, bench.sessions)
    published = functools.partial(publishing.look_after, bench.sessions, bench.blobs)
    settled = functools.partial(publishing.settle_quietly, bench.sessions)
    figured = functools.partial(figures.renew_one, bench.sessions)
    grown = functools.partial(growth.note_today, bench.sessions)
    numbered = functools.partial(begin_epoch, bench.sessions)
    derived = publishing.Deriver(bench.sessions).piece
    return (
        (in_thread(numbered, "changes could not be numbered anew"), EPOCH_LOOK_EVERY_S),
        (in_thread(published, "what waits to be published could not be seen to"), PUBLISH_LOOK_EVERY_S),
        (in_thread(teller.look, "nobody could be told of events"), telling.LOOK_EVERY_S),
        (in_thread(derived, "what is derived from segments could not follow"), DERIVE_LOOK_EVERY_S),
        (in_thread(settled, "no square could be settled"), SETTLE_LOOK_EVERY_S),
        (in_thread(renewed, "what an update left could not be seen to"), RENEW_EVERY_S),
        (in_thread(tended, "batches could not be gone on with"), enqueuing.TEND_EVERY_S),
        (in_thread(expired, "old exports could not be removed"), RENEW_EVERY_S),
        (in_thread(unplanned, "plans that nobody wanted could not be forgotten"), RENEW_EVERY_S),
        (in_thread(forgotten, "old trials could not be forgotten"), RENEW_EVERY_S),
        (in_thread(heights.piece, "heights could not be filled in"), RENEW_EVERY_S),
        (in_thread(figured, "figures of the map could not be made"), figures.LOOK_EVERY_S),
        (in_thread(grown, "what is driven by now could not be noted"), growth.LOOK_EVERY_S),
        (in_thread(ledger.fold, "totals could not be added up"), FOLD_AFTER_S / 4),
        (in_thread(swept, "what nobody needs any more could not be swept"), SWEEP_EVERY_S),
    )


def _sweep(bench: Workbench, settings: Settings, older_than: timedelta) -> None:
    """Clear the blob store, the attic of roads that are gone and, where no other database uses them, rasters."""
    if gone := retired.prune(bench.sessions, settings.keep_dropped_days):
        logger.info("let go what was measured on %d roads that are gone", gone)
    if gone := changes.prune(bench.sessions, settings.changes_kept_days):
        logger.info("%d segments that went or moved long ago are not told as changes any more", gone)
    telling.prune(bench.sessions)
    with bench.sessions.begin() as session:
        audit.prune(session)
    if files := sweep_files(settings, bench.sessions):
        logger.info("removed %d files that no export refers to", len(files))
    found = intake.sweep_blobs(bench.sessions, bench.blobs, older_than)
    if found.removed:
        logger.info("removed %d blobs that no drive refers to", found.removed)
    if (
        settings.keeps_files_together
        and not found.strangers
        and (rasters := sweep_rasters(bench.sessions, bench.dem_dir, older_than))
    ):
        logger.info("removed %d elevation rasters that are in no use any more", len(rasters))
