"""The worker: takes drives from the queue and processes them, and sees to what an update or a crash left.

How a drive is computed is ``process``'s to know; how jobs are taken, cut off and taken up again is ``app.jobs``'s.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import timedelta
from functools import partial
from typing import Any

from app.access import quotas
from app.changes import store as changes
from app.changes.store import begin_epoch
from app.changes.webhooks import telling
from app.changes.webhooks.telling import Teller
from app.core.blobs import EXPORTS
from app.core.db import Sessions, make_engine, session_factory
from app.core.messages import say
from app.core.settings import Settings
from app.core.settings.places import FilePlace
from app.core.telemetry import audit
from app.core.telemetry.ledger import FOLD_AFTER_S, WRITE_EVERY_S, Ledger, counting
from app.drives import claims, intake, publishing
from app.drives.batches import enqueuing
from app.drives.batches import store as batches
from app.drives.batches.removing import removing_task
from app.drives.batches.touched import queue_touched
from app.drives.live import closing as live
from app.drives.person import removal, retention
from app.drives.process import give_up, process_drive
from app.drives.queue import BEHIND, PROCESS_DRIVE, REMOVE_DRIVE, SOLVE, enqueue_solve
from app.drives.trials.run import TRIAL
from app.exports.run import EXPORT
from app.jobs import ended
from app.jobs.context import JobContext
from app.jobs.requests import upkeep
from app.jobs.requests.run import RequestKind
from app.jobs.task import Task, Work
from app.jobs.worker import Chore, Worker, in_thread
from app.map import figures
from app.map.derived import following
from app.network.marks import append_marks
from app.network.publish import left_over
from app.operations import store as operations
from app.operations.documents import Kind
from app.operations.run import OPERATION
from app.releases import run as releases
from app.roads import retired
from app.terrain.files import add_bounds, sweep_rasters
from app.terrain.heights import fill_heights, renewing

logger = logging.getLogger(__name__)

SWEEP_EVERY_S = 3600.0
"""How often the blob store is cleared of what nobody refers to, seconds."""

PUBLISH_LOOK_EVERY_S = 1.0
"""How often a worker looks whether cells are due that nobody was asked to solve, seconds."""

DERIVE_LOOK_EVERY_S = 1.0
"""How often a worker looks whether ways and drawn pieces are to follow what changed of segments, seconds."""

SETTLE_LOOK_EVERY_S = 60.0
"""How often a worker looks whether cells are to be settled, seconds."""

EPOCH_LOOK_EVERY_S = 30.0
"""How often a worker looks whether the database was restored beneath it, seconds."""

MORE_CONNECTIONS = 7
"""Beside its own one a lane may have so many, each for as long as several things need one at the same time."""

RENEW_EVERY_S = 600.0
"""How often a worker looks for what an update of the service left to be done, seconds."""


REQUESTS: tuple[RequestKind[Any], ...] = (EXPORT, OPERATION, TRIAL)
"""Everything that is asked of a worker and followed by a row of its own."""


def run_worker(
    settings: Settings,
    *,
    wait: bool = True,
    stop_event: threading.Event | None = None,
    with_chores: bool = True,
    derives: bool = False,
    process: str = "worker",
    renewed: bool = False,
    wakes: int | None = None,
) -> bool:
    """Process drives, one after the other, until SIGTERM or SIGINT (in the main thread) or ``stop_event``.

    With ``wait=False`` it returns as soon as the queue is empty and what follows from it is derived. May run in any
    thread. Asked to stop it ends within ``settings.grace_s``; in the main thread whatever its drive does, for then the
    process is taken to be its own.
    Without ``with_chores`` another worker of this machine sees to what is done beside the drives, all but what this one
    ``derives`` as well. What it counts is written under the name ``process``. ``renewed``: another process takes the
    place of this one when it ends; it may take so much memory as the settings say, and returns True where it ended for
    having grown. ``wakes``: the end of a pipe by which the machine's listener tells of jobs; without one it asks for
    them every second.
    """
    if settings.database_url is None:
        raise ValueError("the worker needs settings.database_url")
    engine = make_engine(
        settings.database_url,
        pool_size=1,
        max_overflow=MORE_CONNECTIONS,
        background=True,
        pooled=settings.database_pooled,
    )
    try:
        context = JobContext(settings, session_factory(engine), queue_touched)
        worker = Worker(settings, engine, context.sessions, tasks_of(context), wakes)
        with (
            counting(context.sessions, process) as ledger,
            closing(Teller(context.sessions, settings)) as teller,
        ):
            written = in_thread(ledger.write, "what was counted could not be written")
            deriver = publishing.Deriver(context.sessions)
            deriving = in_thread(deriver.piece, "ways and low zooms could not follow the segments")
            chores = _chores(context, ledger, teller) if with_chores else ()
            if with_chores or derives:
                chores = (*chores, (deriving, DERIVE_LOOK_EVERY_S))
            again = worker.run(
                ((written, WRITE_EVERY_S), *chores), wait=wait, stop_event=stop_event, renewed=renewed
            )
            if not wait:
                following.follow_all(context.sessions, stop_event)
            return again
    finally:
        engine.dispose()


def tasks_of(context: JobContext) -> tuple[Task, ...]:
    """Everything that a worker can be asked for: one line a task."""
    return (
        _drive_task(context),
        _removal_task(context),
        _solver_task(context),
        removing_task(context.sessions),
        *(kind.task(context) for kind in REQUESTS),
    )


def _drive_task(context: JobContext) -> Task:
    def run(work: Work, *, drive_id: str, generation: int) -> str:
        return process_drive(
            context,
            uuid.UUID(drive_id),
            generation,
            should_stop=work.should_stop,
            behind=work.priority <= BEHIND // 2,
            computing=work.computing,
        ).value

    def fail(kind: str, reason: str, *, drive_id: str, generation: int) -> None:
        give_up(context, uuid.UUID(drive_id), generation, kind, reason)

    def put_back(*, drive_id: str, generation: int) -> None:
        with context.sessions.begin() as session:
            claims.mark_queued(session, uuid.UUID(drive_id), generation)

    advice = say("processing.split")
    return Task(PROCESS_DRIVE, run, fail, put_back, subject="drive", advice=advice)


def _removal_task(context: JobContext) -> Task:
    def run(work: Work, *, drive_id: str, generation: int) -> str:
        publishing.remove(context.sessions, context.blobs, uuid.UUID(drive_id), generation)
        return "taken back"

    def fail(kind: str, reason: str, *, drive_id: str, generation: int) -> None:
        logger.error("drive %s could not be removed: %s", drive_id, reason)

    return Task(REMOVE_DRIVE, run, fail, subject="removal")  # the drive stays cancelled


def _solver_task(context: JobContext) -> Task:
    def run(work: Work) -> str:
        with work.computing():
            return f"{publishing.solve_some(context.sessions, context.blobs)} cells"

    def put_back() -> None:
        with context.sessions.begin() as session:
            enqueue_solve(session)

    def fail(kind: str, reason: str) -> None:
        logger.error("cells that wait to be published could not be solved: %s", reason)

    return Task(SOLVE, run, fail, put_back, subject="part of the map")


def _chores(context: JobContext, ledger: Ledger, teller: Teller) -> tuple[tuple[Chore, float], ...]:
    """What is done beside the drives, and how often, s."""
    sessions, blobs = context.sessions, context.blobs
    heights = HeightFiller(sessions, context.dem_dir)
    chores: list[tuple[Callable[[], bool | None], str, float]] = [
        (partial(begin_epoch, sessions), "changes could not be numbered anew", EPOCH_LOOK_EVERY_S),
        (
            partial(publishing.look_after, sessions, blobs),
            "drives could not be published",
            PUBLISH_LOOK_EVERY_S,
        ),
        (teller.look, "webhooks could not be called", telling.LOOK_EVERY_S),
        (partial(publishing.settle_quietly, sessions), "no cell could be settled", SETTLE_LOOK_EVERY_S),
        (partial(renew, sessions), "what an update left could not be done", RENEW_EVERY_S),
        (partial(enqueuing.tend, sessions), "batches could not be continued", enqueuing.TEND_EVERY_S),
        (
            partial(removal.look_after, sessions, context.part(EXPORTS)),
            "owners could not be removed",
            removal.LOOK_EVERY_S,
        ),
        (
            partial(retention.delete_due, sessions, blobs, context.settings.keep_logs_days),
            "logs that were kept long enough could not be deleted",
            retention.LOOK_EVERY_S,
        ),
        (
            live.Closer(sessions, blobs, context.settings).look,
            "drives under way could not be closed",
            live.LOOK_EVERY_S,
        ),
        (heights.piece, "heights could not be filled in", RENEW_EVERY_S),
        (
            partial(figures.renew_one, sessions),
            "figures of the map could not be made",
            figures.LOOK_EVERY_S,
        ),
        (
            partial(figures.note_today, sessions),
            "the length driven could not be noted",
            figures.NOTE_EVERY_S,
        ),
        (partial(_release_when_due, context), "the next edition could not be asked for", RENEW_EVERY_S),
        (ledger.fold, "counters could not be added up", FOLD_AFTER_S / 4),
        (
            ended.EndedJobs(sessions, context.settings.jobs_kept_days).piece,
            "jobs that ended long ago could not be removed",
            ended.LOOK_EVERY_S,
        ),
        (partial(_sweep, context), "unused files could not be removed", SWEEP_EVERY_S),
    ]
    for kind in REQUESTS:
        failed = f"{kind.store.plural} could not be looked after"
        chores.append((partial(upkeep.look_after, kind, context), failed, RENEW_EVERY_S))
    return tuple((in_thread(chore, failed), every_s) for chore, failed, every_s in chores)


def _release_when_due(context: JobContext) -> None:
    """Ask for the next edition of the public's map; where there are none, let none of what was removed be in one."""
    settings = context.settings
    if releases.is_due(context.sessions, settings) or releases.lacks_files(context.sessions, settings):
        with context.sessions.begin() as session:
            kept = settings.imports_kept_bytes
            request = {"when_due": True}
            operations.ask(session, kind=Kind.RELEASE, request=request, kept_bytes=kept, subject="map")
    releases.forget_where_removed(context.sessions, settings)


def _sweep(context: JobContext) -> None:
    """Remove files that nobody refers to, retired evidence and, where no other database uses them, rasters."""
    settings = context.settings
    if gone := retired.prune(context.sessions, settings.keep_dropped_days):
        logger.info("retired evidence of %d roads was kept long enough and is removed", gone)
    if gone := changes.prune(context.sessions, settings.changes_kept_days):
        logger.info("%d segments that went or moved long ago are not told as changes any more", gone)
    telling.prune(context.sessions)
    with context.sessions.begin() as session:
        audit.prune(session)
        for forget in (batches.forget_old, quotas.forget_use):
            forget(session, 86400.0 * settings.history_kept_days)
    for kind in REQUESTS:
        if files := upkeep.sweep_files(kind, context):
            logger.info("removed %d files that no %s refers to", len(files), kind.store.name)
    older_than = timedelta(days=settings.orphan_days)
    swept = intake.sweep_blobs(context.sessions, context.blobs, older_than)
    if swept.removed:
        logger.info("removed %d blobs that no drive refers to", swept.removed)
    if (
        settings.keeps_files_together
        and not swept.strangers
        and (rasters := sweep_rasters(context.sessions, context.dem_dir, older_than))
    ):
        logger.info("removed %d elevation rasters that are in no use any more", len(rasters))


def renew(sessions: Sessions) -> None:
    """What an update left, and takes no time to speak of: drives without a job get one, remains are cleared away.

    A migration marks what its model cannot use any more and the workers see to the rest, at their start and again and
    again. It may be cut off at any moment and done twice.
    """
    if count := enqueuing.give_jobs(sessions):
        logger.info(
            "%d drives are computed again, behind uploads; GET /v1/drives/reprocess tells how far", count
        )
    if count := clear_remains(sessions):
        logger.info("%d segments lose a slope that no drive stands behind any more", count)


class HeightFiller:
    """Fills heights of the elevation model in, a piece at each call: of a country that takes minutes.

    First those that a change of the rasters left to be renewed, whose maker may be gone, then those of before heights
    were kept. Drives do not wait for it. The roads of each are filled in before it is solved
    (``fill_heights_along``).
    """

    def __init__(self, sessions: Sessions, dem_dir: FilePlace) -> None:
        self._sessions, self._dem_dir, self._after_id = sessions, dem_dir, 0
        self._renewing: Iterator[float] = iter(())
        self._knows_bounds = False

    def piece(self) -> bool:
        """The next piece; whether there may be more."""
        if not self._knows_bounds:
            add_bounds(self._sessions, self._dem_dir)
            self._knows_bounds = True
        if next(self._renewing, None) is not None:
            return True
        self._renewing = renewing(self._sessions, self._dem_dir, wait=False)
        if next(self._renewing, None) is not None:
            return True
        last = fill_heights(self._sessions, self._dem_dir, self._after_id)
        if last is None and self._after_id:
            logger.info("heights of the elevation model are filled in")
        self._after_id = last or 0
        return last is not None


def clear_remains(sessions: Sessions) -> int:
    """Let what is published of a former model and no drive is about to say again go; of how many segments."""
    with sessions.begin() as session:
        remains = left_over(session)
        append_marks(session, (), remains)
    return len(remains)
