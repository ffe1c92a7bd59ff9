"""A trial by a worker: the drive's log through the library by another method, its result kept beside the drive.

It takes the same steps as a drive (``app.drives.process``) up to the result and none of those after it: no pass, no
mark, no slope is written, so that nothing of it can reach the map. A run may be cut off at any moment and repeated.
Whoever removes the trial or its drive takes it away from its run. Knows no HTTP.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable

from app.core.db import Sessions
from app.core.telemetry import tracing
from app.core.telemetry.logs import about, tell
from app.drives import tracks
from app.drives.faults import fault_of
from app.drives.process import (
    Computing,
    estimate,
    full_report,
    read_drive,
    surroundings_of,
)
from app.drives.progress import PARTS, PROGRESS_EVERY_S, Discarded
from app.drives.trials import store
from app.drives.trials.documents import Trial
from app.drives.trials.results import encode_slopes
from app.jobs.context import JobContext
from app.jobs.task import Interrupted, Task, Work, is_connection_loss
from fusion.pipeline import parse_options, positions_of
from fusion.types import Progress

logger = logging.getLogger(__name__)


def trial_task(context: JobContext) -> Task:
    """What a worker does for a trial."""

    def run(work: Work, *, trial_id: str) -> str:
        return run_trial(context, uuid.UUID(trial_id), work.should_stop, work.computing)

    def fail(kind: str, reason: str, *, trial_id: str) -> None:
        with context.sessions.begin() as session:
            store.fail(session, uuid.UUID(trial_id), kind, reason)

    def put_back(*, trial_id: str) -> None:
        with context.sessions.begin() as session:
            store.let_wait(session, uuid.UUID(trial_id))

    advice = "Choose a method or options that take less, or split the log into shorter drives."
    return Task(store.TRY_DRIVE, run, fail, put_back, subject="trial", advice=advice)


def run_trial(
    context: JobContext, trial_id: uuid.UUID, should_stop: Callable[[], bool], computing: Computing
) -> str:
    """Compute the trial; a word on how it ended. Safe to call twice, also at the same time.

    What the log or the method is to blame for ends as a failed trial with a sentence. Raises ``Interrupted`` where
    another run is to compute it, and SQLAlchemy's error when the database cannot be reached.
    """
    with about(trial=trial_id):
        with context.sessions.begin() as session:
            trial = store.claim(session, trial_id)
        if trial is None:
            return "unwanted"
        with about(drive=trial.drive_id), tracing.span("trial", method=trial.method) as span:
            outcome = _tried(context, trial, _Look(context.sessions, trial, should_stop), computing)
            span.note(outcome=outcome)
            return outcome


class _Look:
    """How a run shows how far it is, and learns that it is to end."""

    def __init__(self, sessions: Sessions, trial: Trial, should_stop: Callable[[], bool]) -> None:
        self._sessions, self._trial, self._should_stop = sessions, trial, should_stop
        self._written_s, self._share = -float("inf"), 0.0
        self.stage = "reading"

    def part(self, part: str) -> Progress:
        """A ``Progress`` for one part of the run, which begins."""
        start, end = PARTS[part]

        def progress(stage: str, share: float) -> None:
            self.show(stage, start + (end - start) * min(max(share, 0.0), 1.0))

        progress(part, 0.0)
        return progress

    def show(self, stage: str, share: float) -> None:
        """Note stage and share (it never falls); raises when the run is to end."""
        self.stage, self._share = stage, max(self._share, share)
        if self._should_stop():
            raise Interrupted
        now_s = time.monotonic()
        if now_s - self._written_s < PROGRESS_EVERY_S:
            return
        self._written_s = now_s
        with self._sessions.begin() as session:
            if not store.set_progress(session, self._trial, stage, self._share):
                raise Discarded


def _tried(context: JobContext, trial: Trial, look: _Look, computing: Computing) -> str:
    began_s = time.monotonic()
    try:
        if not _computed(context, trial, look, computing):
            return "unwanted"
    except Discarded:
        tell(logger, "trial discarded", reason="it or its drive was removed while it was computed")
        return "unwanted"
    except Interrupted:
        with context.sessions.begin() as session:
            store.let_wait(session, trial.id)
        raise
    except Exception as error:
        if is_connection_loss(error):
            raise
        return _failed(context, trial, look.stage, error)
    tell(logger, "trial done", method=trial.method, seconds=round(time.monotonic() - began_s, 3))
    return "done"


def _computed(context: JobContext, trial: Trial, look: _Look, computing: Computing) -> bool:
    """Compute it and keep what it yields; False: nobody wants that any more."""
    with computing():
        options = parse_options(trial.method, trial.options)
        log = read_drive(context, trial.blob_key, options.columns, look.part("reading"))
        found = positions_of(log, options, look.part("positioning"))
        look.part("roads")
        around = surroundings_of(context, found.log)
        ids, _, result = estimate(found, around, trial.method, trial.options, look.part("estimating"))
        look.part("saving")
        said = result.measurements
        kept = store.Result(
            tracks.encode(result.track, ids),
            None if said is None else tracks.encode_measurements(said),
            encode_slopes(result.slopes, ids),
        )
    dem_version = None if around.dem is None else around.dem.version_id
    with context.sessions.begin() as session:
        return store.finish(session, trial, full_report(result, around.version_id, dem_version), kept)


def _failed(context: JobContext, trial: Trial, stage: str, error: Exception) -> str:
    kind, reason, where = fault_of(error, "trial", trial.id, stage)
    with context.sessions.begin() as session:
        store.fail(session, trial.id, kind, reason, stage=stage, where=where, run=trial.run)
    tell(logger, "trial failed", method=trial.method, kind=kind, stage=stage)
    return "failed"


def tend(sessions: Sessions) -> None:
    """A worker's part: forget what ended long ago; what waits without a job gets one."""
    with sessions.begin() as session:
        store.give_jobs(session)
        forgotten = store.forget_old(session)
    if forgotten:
        logger.info("%d trials are forgotten: they ended a week ago", forgotten)
