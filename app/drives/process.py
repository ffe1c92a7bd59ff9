"""One drive through the library: blob -> log -> positions -> roads and elevation around it -> estimates -> database.

All that the drive says is written in one transaction at the end, with marks of what has to be solved for it
(``publishing``), so that a run may be cut off at any moment and repeated. A run belongs to a generation of its drive:
when the drive was deleted or asked for anew meanwhile, the result is discarded. Knows no HTTP.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import Enum
from typing import Any, Protocol

import numpy as np

from app.changes.webhooks.store import DRIVE_FAILED, announce_drive
from app.core.telemetry import tracing
from app.core.telemetry.events import Stages
from app.core.telemetry.logs import about, tell
from app.core.version import code_version
from app.drives import claims, publishing, queue, tracks
from app.drives.documents import Drive
from app.drives.faults import NoRoadsError, ProcessingError, fault_of
from app.drives.lags import with_settled_lag
from app.drives.progress import (
    RunProgress,
    shown_on,
    tell_discarded,
    tell_failed,
    tell_put_back,
    tell_started,
)
from app.jobs.context import JobContext
from app.jobs.requests.pieces import never
from app.jobs.requests.run import Discarded
from app.jobs.task import Interrupted, is_connection_loss
from app.network import results as slopes
from app.network.cell_roads import Roads, roads_in
from app.network.marks import MarkedBy
from app.network.road_states import road_states
from app.roads import store as road_store
from app.terrain import store as dem
from app.terrain.heights import fill_heights_along, open_dem
from app.terrain.store import DemSet
from fusion.formats import read_log
from fusion.formats.base import NO_DATE
from fusion.gnss.positioning import Positioned
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, positions_of, road_boxes, run_drive
from fusion.roads.table import RoadTable, rows_of
from fusion.types import DriveLog, Ints, Progress

logger = logging.getLogger(__name__)

MAX_ROAD_CHANGES = 20
"""Times that a drive is estimated anew because roads changed under it: an import takes several steps over a place."""

Computing = Callable[[], AbstractContextManager[None]]
"""To be held around the computation proper (``app.jobs.task.Work``)."""


class Outcome(Enum):
    """How a run ended."""

    DONE = "done"
    """All is said; solvers publish it."""
    FAILED = "failed"
    DISCARDED = "discarded"


@dataclass(frozen=True)
class Surroundings:
    """Roads and elevation around a log, as they were at one moment."""

    roads: Roads
    version_id: int
    dem: DemSet | None

    @property
    def dem_version_id(self) -> int | None:
        """Of the elevation; None where there is none."""
        return None if self.dem is None else self.dem.version_id


class Asked(Protocol):
    """A log and how it is to be computed: of a drive, or of a trial of one."""

    @property
    def blob_key(self) -> str:
        """Of the log."""

    @property
    def method(self) -> str:
        """The estimator."""

    @property
    def options(self) -> Mapping[str, Any]:
        """Those of its options that are not the defaults."""


@dataclass(frozen=True)
class Computed:
    """What came of a log: the result, the roads that it refers to, and the database's id of each of them."""

    log: DriveLog
    around: Surroundings
    ids: Ints
    roads: RoadTable
    result: DriveResult

    def report(self) -> dict[str, Any]:
        """What the result reports, and by which code, roads and elevation it was made."""
        versions = {"road_version": self.around.version_id, "dem_version": self.around.dem_version_id}
        return {**self.result.report, "code_version": code_version(), **versions}


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
        tell_started(drive)
        stages = Stages(drive.method)
        run = RunProgress(shown_on(context.sessions, drive, should_stop), stages)
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
        tell_discarded(drive)
        return Outcome.DISCARDED
    except Interrupted:
        with context.sessions.begin() as session:
            claims.mark_queued(session, drive.id, drive.generation)
        tell_put_back(drive, run.stage)
        raise
    except Exception as error:
        stages.end(error)
        if is_connection_loss(error):
            raise
        return _fail(context, drive, run.stage, error)
    return Outcome.DONE


def give_up(context: JobContext, drive_id: uuid.UUID, generation: int, kind: str, reason: str) -> None:
    """Fail a drive that is not run again: it must not take worker after worker along, or keep one for ever."""
    with context.sessions.begin() as session:
        drive = claims.mark_running(session, drive_id, generation)
        if drive is None:
            return
        if claims.mark_failed(session, drive_id, generation, kind=kind, reason=reason, stage=None):
            announce_drive(session, DRIVE_FAILED, drive_id, {"kind": kind, "reason": reason})
    with about(drive=drive_id):
        tell_failed(drive, kind, reason, None)


def _run(
    context: JobContext, drive: Drive, run: RunProgress, stages: Stages, computing: Computing, *, behind: bool
) -> None:
    def note_bounds(log: DriveLog) -> None:
        with context.sessions.begin() as session:
            claims.note_bounds(session, drive.id, drive.generation, log.bounds_deg())

    def publish(computed: Computed) -> bool:
        result, ids = computed.result, computed.ids
        if result.factors:
            driven = computed.roads.subset(np.unique([f.segment for f in result.factors]))
            fill_heights_along(context.sessions, context.dem_dir, driven)
        settled = replace(computed, result=with_settled_lag(context.sessions, drive.id, ids, result))
        run.begin("saving")
        return _append(context, drive, settled, behind=behind)

    computed = compute(context, drive, run, computing, note_bounds, publish)
    stages.end()
    sizes: dict[str, Any] = {"epochs": len(computed.result.track), "segments": len(computed.result.slopes)}
    tell(logger, "drive computed", method=drive.method, **sizes | stages.seconds)


def compute(
    context: JobContext,
    asked: Asked,
    run: RunProgress,
    computing: Computing,
    located: Callable[[DriveLog], None],
    save: Callable[[Computed], bool],
) -> Computed:
    """The library's way through a log, for a drive or a trial of one: what differs is what becomes of the result.

    ``located`` is told the log with its positions. ``save`` returns False where the roads changed since they were read:
    then all after the positions is done again.
    """
    run.begin("reading")
    with computing():
        options = parse_options(asked.method, asked.options)
        log = read_drive(context, asked.blob_key, options.columns, run.part("reading"))
        run.begin("positioning")
        positioned = positions_of(log, options, run.part("positioning"))
    located(positioned.log)
    for _ in range(MAX_ROAD_CHANGES):
        run.begin("roads")
        with computing():
            around = surroundings_of(context, positioned.log)
        run.begin("estimating")
        with computing():
            computed = estimate(positioned, around, asked, run.part("estimating"))
        if save(computed):
            return computed
        tell(logger, "drive estimated again", reason="the roads were imported anew meanwhile")
    raise ProcessingError(
        f"The roads around this drive changed {MAX_ROAD_CHANGES} times while it was processed. "
        "Ask for it again when the import is over."
    )


def read_drive(
    context: JobContext, blob_key: str, columns: Mapping[str, str], progress: Progress
) -> DriveLog:
    """The log of a drive; ``ProcessingError`` where its file is lost."""
    try:
        file = context.blobs.open(blob_key)
    except FileNotFoundError as error:
        raise ProcessingError(
            "The uploaded file is no longer in the service's storage. Delete the drive and upload it again."
        ) from error
    with file:
        return read_log(file, columns=columns, max_bytes=context.settings.max_log_bytes, progress=progress)


def surroundings_of(context: JobContext, log: DriveLog) -> Surroundings:
    """What lies around a log; ``NoRoadsError`` where there are no roads at all."""
    with context.sessions() as session:
        # One snapshot, so that the roads are those of the version that is noted beside them.
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        version = road_store.current_road_version(session)
        if version is None:
            raise NoRoadsError(
                "No roads have been imported yet. Import them (`versant import-roads FILE`): then the drive is "
                "computed by itself."
            )
        roads = roads_in(session, road_boxes(log))
        return Surroundings(roads, version.id, dem.current_dem(session, context.dem_dir))


def estimate(positioned: Positioned, around: Surroundings, asked: Asked, progress: Progress) -> Computed:
    """The result on these roads. Writes nothing."""
    with ExitStack() as stack:
        terrain = None if around.dem is None else stack.enter_context(open_dem(around.dem))
        network, result = run_drive(
            positioned,
            around.roads.table,
            terrain,
            method=asked.method,
            options=asked.options,
            progress=progress,
        )
    ids = around.roads.ids[rows_of(around.roads.table, network.table)]
    return Computed(positioned.log, around, ids, network.table, result)


def _append(context: JobContext, drive: Drive, computed: Computed, *, behind: bool) -> bool:
    """Write all that the drive says in one transaction; False when the roads around it changed since they were read."""
    around, ids, result = computed.around, computed.ids, computed.result
    provenance = slopes.RunProvenance(
        method=drive.method,
        options=parse_options(drive.method, drive.options).model_dump(mode="json"),
        code_version=code_version(),
        road_version_id=around.version_id,
        road_state=max(around.roads.states.values(), default=0),
        dem_version_id=around.dem_version_id,
    )
    with context.sessions.begin() as session:
        slopes.begin_change(session, drive.id, slopes.in_database(result.factors, ids))
        if not claims.lock_running(session, drive.id, drive.generation):
            raise Discarded
        if road_states(session, around.roads.states) != around.roads.states:
            return False
        tracks.save_track(session, drive.id, result.track, ids, result.measurements)
        slopes.append_result(
            session,
            MarkedBy(drive.id, drive.generation),
            ids,
            result.slopes,
            provenance,
            result.factors,
            computed.log.fix.time_s,
            delay_s=publishing.patience_s(session, context.settings.publish_every_s, behind=behind),
        )
        claims.mark_publishing(
            session,
            drive.id,
            report=computed.report(),
            bounds=computed.log.bounds_deg(),
            epochs=len(result.track),
            distance_m=result.report["distance_m"],
            drive_time=drive_time(computed.log),
        )
        queue.enqueue_solve(session)
    return True


def drive_time(log: DriveLog) -> datetime | None:
    """When the recording begins; None where the log has no date and its times were placed somewhere."""
    return None if NO_DATE in log.repaired else datetime.fromtimestamp(float(log.fix.time_s[0]), UTC)


def _fail(context: JobContext, drive: Drive, stage: str, error: Exception) -> Outcome:
    kind, reason, where = fault_of(error, "drive", drive.id, stage)
    with context.sessions.begin() as session:
        mine = claims.mark_failed(
            session, drive.id, drive.generation, kind=kind, reason=reason, stage=stage, where=where
        )
        if mine:
            announce_drive(session, DRIVE_FAILED, drive.id, {"kind": kind, "reason": reason})
    if not mine:
        tell_discarded(drive)
        return Outcome.DISCARDED
    tell_failed(drive, kind, reason, stage)
    return Outcome.FAILED
