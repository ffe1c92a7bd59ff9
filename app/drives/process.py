"""One drive: claimed, computed (``app.drives.computing``), and written to the database.

All that the drive says is written in one transaction at the end (``app.drives.writing``), so that a run may be cut off
at any moment and repeated. A run belongs to a generation of its drive:
when the drive was deleted or asked for anew meanwhile, the result is discarded. Knows no HTTP.
"""

from __future__ import annotations

import logging
import re
import uuid
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from app.changes.webhooks.store import DRIVE_FAILED, announce_drive
from app.core.telemetry import tracing
from app.core.telemetry.events import Stages
from app.core.telemetry.logs import about, blanked, tell
from app.core.telemetry.measures import DRIVES_FAILED, DRIVES_PUT_BACK, QUEUED_S
from app.drives import claims, tracks
from app.drives.computing import (
    Computed,
    Computing,
    NoRoadsError,
    NoRoadsThereError,
    RunProgress,
    compute,
    failure_of,
)
from app.drives.documents import Drive
from app.drives.log_facts import drive_time, records_of, track_of
from app.drives.writing import append, with_settled_lag
from app.jobs.context import JobContext
from app.jobs.requests.pieces import never
from app.jobs.requests.run import Discarded, Progress
from app.jobs.requests.store import Failure
from app.jobs.task import Interrupted, is_connection_loss
from app.terrain.heights import fill_heights_along
from fusion.report import track_length_m
from fusion.types import DriveLog

logger = logging.getLogger(__name__)


FAULTS = frozenset({"internal", "out-of-memory", "interrupted"})
"""Kinds of failures that are not the log's: to be seen to."""
SHORTEST_NAME = 4
"""Names of files that are no words of a reason."""


class Outcome(Enum):
    """How a run ended."""

    DONE = "done"
    """All is said; solvers publish it."""
    FAILED = "failed"
    DISCARDED = "discarded"


def process_drive(
    context: JobContext,
    drive_id: uuid.UUID,
    generation: int,
    *,
    should_stop: Callable[[], bool] = never,
    behind: bool = False,
    computing: Computing = nullcontext,
) -> Outcome:
    """Run the drive until it has said all; solvers publish it then. Safe to call twice, also at the same time.

    ``behind``: it is one of a batch, whose slopes may wait.

    What the log or the method is to blame for ends as a failed drive with a sentence; so does an unexpected
    error, which is logged. Raises ``Interrupted`` when ``should_stop`` turned true (the drive is queued
    again) and SQLAlchemy's error when the database cannot be reached (``is_connection_loss``): both want
    another run.
    """
    with about(drive=drive_id):
        with context.sessions.begin() as session:
            drive = claims.mark_running(session, drive_id, generation)
        if drive is None:
            tell(logger, "drive skipped", reason="deleted, ended or asked for anew since")
            return Outcome.DISCARDED
        _tell_started(drive)

        def show(session: Session, stage: str | None, share: float) -> bool:
            return claims.set_progress(session, drive.id, drive.generation, str(stage), share)

        stages = Stages(drive.method)
        run = RunProgress(Progress(context.sessions, should_stop, show).show, stages)
        with tracing.span("drive", parent=drive.traceparent, method=drive.method) as span:
            try:
                outcome = _attempt(context, drive, run, stages, computing, behind=behind)
            finally:
                stages.end()
            span.note(outcome=outcome.value)
            span.failed(outcome is Outcome.FAILED)
            return outcome


def _attempt(
    context: JobContext, drive: Drive, run: RunProgress, stages: Stages, computing: Computing, *, behind: bool
) -> Outcome:
    """Run a drive that is claimed, and see to whatever ends the run."""
    try:
        _run(context, drive, run, stages, computing, behind=behind)
    except Discarded:
        return _discarded(drive)
    except Interrupted:
        with context.sessions.begin() as session:
            claims.mark_queued(session, drive.id, drive.generation)
        DRIVES_PUT_BACK.count(drive.method, "stopped")
        tell(logger, "drive put back", reason="the worker stops", stage=run.stage)
        raise
    except Exception as error:
        stages.end(error)
        if is_connection_loss(error):
            raise
        return _fail(context, drive, failure_of(error, "drive", drive.id, run.stage))
    return Outcome.DONE


def give_up(context: JobContext, drive_id: uuid.UUID, generation: int, kind: str, reason: str) -> None:
    """Fail a drive that is not run again: it must not take worker after worker along, or keep one for ever."""
    failure = Failure(kind, reason)
    with context.sessions.begin() as session:
        drive = claims.mark_running(session, drive_id, generation)
        if drive is None:
            return
        _write_failure(session, drive, failure)
    with about(drive=drive_id):
        _tell_failed(drive, failure)


def _run(
    context: JobContext, drive: Drive, run: RunProgress, stages: Stages, computing: Computing, *, behind: bool
) -> None:
    def note_records(log: DriveLog) -> None:
        # By itself: what publishes the drive may wait for others, and the owner's uploads wait for what counts.
        with context.sessions.begin() as session:
            claims.note_records(session, drive.id, drive.generation, records_of(log))

    positioned: list[DriveLog] = []

    def note_bounds(log: DriveLog) -> None:
        positioned[:] = [log]
        with context.sessions.begin() as session:
            claims.note_bounds(session, drive.id, drive.generation, log.bounds_deg())

    def publish(computed: Computed) -> bool:
        result, ids = computed.result, computed.ids
        if result.factors:
            driven = computed.roads.subset(result.in_network)
            fill_heights_along(context.sessions, context.dem_dir, driven)
        progress = run.part("saving")
        settled = with_settled_lag(context.sessions, drive.id, ids, result, progress)
        run.begin("saving")
        return append(context, drive, replace(computed, result=settled), behind=behind)

    try:
        computed = compute(context, drive, run, computing, publish, read=note_records, located=note_bounds)
    except (NoRoadsError, NoRoadsThereError):
        _keep_track(context, drive, positioned[0])
        raise
    stages.end()
    sizes: dict[str, Any] = {"epochs": len(computed.result.track), "segments": len(computed.result.slopes)}
    tell(logger, "drive computed", method=drive.method, **sizes | stages.seconds)


def _keep_track(context: JobContext, drive: Drive, log: DriveLog) -> None:
    """Keep the way that the log itself tells, to be shown while the drive waits for roads; a result's stays."""
    if drive.report is not None:
        return
    track = track_of(log)
    with context.sessions.begin() as session:
        if not claims.lock_running(session, drive.id, drive.generation):
            raise Discarded
        tracks.save_track(session, drive.id, tracks.EncodedTrack.of(track, np.empty(0, np.int64)))
        claims.note_facts(
            session,
            drive.id,
            drive.generation,
            epochs=len(track),
            distance_m=track_length_m(track),
            drive_time=drive_time(log),
        )


def _fail(context: JobContext, drive: Drive, failure: Failure) -> Outcome:
    with context.sessions.begin() as session:
        mine = _write_failure(session, drive, failure)
    if not mine:
        return _discarded(drive)
    _tell_failed(drive, failure)
    return Outcome.FAILED


def _write_failure(session: Session, drive: Drive, failure: Failure) -> bool:
    """End the drive as failed, and have that announced; False: it is no longer this worker's."""
    mine = claims.mark_failed(session, drive.id, drive.generation, **failure._asdict())
    if mine:
        announce_drive(
            session, DRIVE_FAILED, drive.id, {"kind": failure.kind, "reason": blanked(failure.reason)}
        )
    return mine


def _tell_started(drive: Drive) -> None:
    """A worker has begun with the drive."""
    waited_s = 0.0 if drive.started_at is None else (drive.started_at - drive.queued_at).total_seconds()
    QUEUED_S.observe(waited_s)
    tell(logger, "drive started", method=drive.method, bytes=drive.size_bytes, waited_s=waited_s)
    tell(logger, "drive's file", level=logging.DEBUG, filename=drive.filename)


def _discarded(drive: Drive) -> Outcome:
    """What was computed is unwanted."""
    DRIVES_PUT_BACK.count(drive.method, "discarded")
    tell(logger, "drive discarded", reason="deleted or asked for anew while it was computed")
    return Outcome.DISCARDED


def _tell_failed(drive: Drive, failure: Failure) -> None:
    """It ended without a result: a log that cannot be used is news, a fault of the service an error."""
    kind, reason = failure.kind, failure.reason
    DRIVES_FAILED.count(drive.method, kind)
    for name in drive.filename.split(", "):  # it may be somebody's
        if len(name) >= SHORTEST_NAME:
            reason = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", "(file)", reason)
    level = logging.ERROR if kind in FAULTS else logging.INFO
    words = {"method": drive.method, "kind": kind, "stage": failure.stage, "reason": reason}
    tell(logger, "drive failed", level=level, **words)
