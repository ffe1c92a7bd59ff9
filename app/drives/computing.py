"""A log through the library: log -> positions -> roads and elevation around it -> estimates.

For a drive, which publishes the result (``app.drives.process``), and for a trial of one, which does not
(``app.drives.trials.run``). Writes nothing.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Any

from app.core.db import Bounds
from app.core.messages import say
from app.core.telemetry.events import Stages
from app.core.telemetry.logs import tell
from app.core.version import code_version
from app.drives.documents import Drive
from app.drives.log_facts import LogFacts
from app.drives.trials.documents import Trial
from app.jobs import memory
from app.jobs.context import JobContext
from app.jobs.requests.store import Failure
from app.network.extracts import Roads, roads_in
from app.roads import store as road_store
from app.roads.named_extracts import extract_words
from app.terrain import store as dem
from app.terrain.heights import open_dem
from app.terrain.store import DemSet
from fusion.errors import FusionError, NoMatchError
from fusion.formats import read_log
from fusion.gnss.positioning import Positioned
from fusion.messages import Message, message_of
from fusion.methods.base import DriveResult
from fusion.pipeline import MIN_FIXES, parse_options, positions_of, road_boxes, run_drive
from fusion.roads.table import RoadTable, rows_of
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Ints, Progress

logger = logging.getLogger(__name__)

MAX_ROAD_CHANGES = 20
"""Times that a drive is estimated anew because roads changed under it: an import takes several steps over a place."""

Computing = Callable[[], AbstractContextManager[None]]
"""To be held around the computation proper (``app.jobs.task.Work``)."""


PARTS = {
    "reading": (0.0, 0.05),
    "positioning": (0.05, 0.05),
    "roads": (0.05, 0.07),
    "estimating": (0.07, 0.85),
    "saving": (0.85, 1.0),
}
"""The parts of a run and the shares of the whole at which they begin and end: about those of the time that they take,
as a log of a million positions shows."""
POSITIONED_PARTS = PARTS | {
    "positioning": (0.05, 0.4),
    "roads": (0.4, 0.42),
    "estimating": (0.42, 0.95),
    "saving": (0.95, 1.0),
}
"""The same where positions have to be computed first."""


Look = Callable[[DriveLog], object]


class ProcessingError(FusionError):
    """The service, not the log, is the reason that a drive fails."""

    kind = "processing-failed"


class NoRoadsError(ProcessingError):
    """There are no roads at all yet."""

    kind = "no-roads"


class NoRoadsThereError(ProcessingError):
    """There are roads, and none where the drive was."""

    kind = NoMatchError.kind


class RunProgress:
    """How far a run of a drive, or of a trial of it, is; ``show`` shows a stage and the share of the whole, 0..1."""

    def __init__(self, show: Callable[[str, float], object], stages: Stages | None = None) -> None:
        """``stages`` measures how long each part takes."""
        self._show, self._stages = show, stages
        self._share, self._parts = 0.0, PARTS
        self.stage = "reading"

    def part(self, part: str) -> Callable[[str, float], None]:
        """A ``Progress`` for one part of the run; it names its own stages and counts from 0 to 1."""
        start, end = self._parts[part]

        def progress(stage: str, share: float) -> None:
            self.show(stage, start + (end - start) * min(max(share, 0.0), 1.0))

        return progress

    def begin(self, part: str) -> None:
        """A part of the run begins."""
        if self._stages is not None:
            self._stages.begin(part)
        self.show(part, self._parts[part][0])

    def computes_positions(self) -> None:
        """That part will take its time."""
        self._parts = POSITIONED_PARTS

    def show(self, stage: str, share: float) -> None:
        """Show stage and share (it never falls); raises when the run is to end."""
        if stage != self.stage:
            memory.trim()
        self.stage, self._share = stage, max(self._share, min(share, 1.0))
        self._show(stage, self._share)


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


@dataclass(frozen=True)
class Computed:
    """What came of a log: the result, the roads that it refers to, and the database's id of each of them."""

    facts: LogFacts
    around: Surroundings
    ids: Ints
    roads: RoadTable
    result: DriveResult

    def report(self) -> dict[str, Any]:
        """What the result reports, and by which code, roads and elevation it was made."""
        versions = {"road_version": self.around.version_id, "dem_version": self.around.dem_version_id}
        return {**self.result.report, "code_version": code_version(), **versions}


def compute(
    context: JobContext,
    asked: Drive | Trial,
    run: RunProgress,
    computing: Computing,
    save: Callable[[Computed], bool],
    *,
    read: Look = lambda _: None,
    located: Look = lambda _: None,
) -> Computed:
    """The library's way through a log, for a drive or a trial of one: what differs is what becomes of the result.

    ``save`` returns False where the roads changed since they were read: then all after the positions is done again.
    ``read`` is told the log as it was read, ``located`` the log with its positions.
    """
    run.begin("reading")
    with computing():
        options = parse_options(asked.method, asked.options)
        log = read_drive(context, asked.blob_key, options.columns, run.part("reading"))
    read(log)
    if log.raw is not None:
        run.computes_positions()
    run.begin("positioning")
    with computing():
        positioned = positions_of(log, options, run.part("positioning"))
    located(positioned.log)
    for _ in range(MAX_ROAD_CHANGES):
        run.begin("roads")
        with computing():
            around = surroundings_of(context, road_boxes(positioned.log))
            if not len(around.roads.ids) and len(positioned.log.fix) >= MIN_FIXES:
                raise NoRoadsThereError(_none_there(positioned.log.bounds_deg()))
        run.begin("estimating")
        with ExitStack() as stack:  # factors may be made anew until they are saved
            with computing():
                terrain = None if around.dem is None else stack.enter_context(open_dem(around.dem))
                computed = estimate(positioned, around, terrain, asked, run.part("estimating"))
            if save(computed):
                return computed
        tell(logger, "drive estimated again", reason="the roads were imported anew meanwhile")
    raise ProcessingError(say("processing.roads_changed", n=MAX_ROAD_CHANGES))


def read_drive(
    context: JobContext, blob_key: str, columns: Mapping[str, str], progress: Progress
) -> DriveLog:
    """The log of a drive; ``ProcessingError`` where its file is lost."""
    try:
        file = context.blobs.open(blob_key)
    except FileNotFoundError as error:
        raise ProcessingError(say("processing.file_lost")) from error
    with file:
        return read_log(file, columns=columns, max_bytes=context.settings.max_log_bytes, progress=progress)


def surroundings_of(context: JobContext, boxes_deg: Floats) -> Surroundings:
    """What lies around a log, in ``road_boxes`` (m, 4); ``NoRoadsError`` where there are no roads at all."""
    with context.sessions() as session:
        # One snapshot, so that the roads are those of the version that is noted beside them.
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        version = road_store.current_road_version(session)
        if version is None:
            low, high = boxes_deg.min(axis=0).tolist(), boxes_deg.max(axis=0).tolist()
            wanted = extract_words((low[0], low[1], high[2], high[3]))
            raise NoRoadsError(say("processing.no_roads", wanted=wanted))
        roads = roads_in(session, boxes_deg)
        return Surroundings(roads, version.id, dem.current_dem(session, context.dem_dir))


def _none_there(box: Bounds) -> Message:
    west, south, east, north = box
    wanted = extract_words(box)
    return say("processing.no_roads_there", south=south, north=north, west=west, east=east, wanted=wanted)


def estimate(
    positioned: Positioned,
    around: Surroundings,
    terrain: Dem | None,
    asked: Drive | Trial,
    progress: Progress,
) -> Computed:
    """The result on these roads, and on this terrain, which is to be open as long as it is used. Writes nothing."""
    network, result = run_drive(
        positioned,
        around.roads.table,
        terrain,
        method=asked.method,
        options=asked.options,
        progress=progress,
    )
    ids = around.roads.ids[rows_of(around.roads.table, network.table)]
    return Computed(LogFacts.of(positioned.log), around, ids, network.table, result)


def failure_of(error: Exception, what: str, number: uuid.UUID, stage: str) -> Failure:
    """What is said of an error in a run of ``what`` (drive, trial); what is the service's fault is logged as well."""
    if isinstance(error, FusionError):
        return Failure(error.kind, message_of(error), error.where, stage)
    if isinstance(error, MemoryError):
        logger.error("%s %s: out of memory in stage %s", what, number, stage, exc_info=error)
        memory.forget(error)
        reason = say("processing.drive_needs_memory", more=memory.MORE_MEMORY)
        return Failure("out-of-memory", reason, stage=stage)
    logger.error("%s %s failed unexpectedly in stage %s", what, number, stage, exc_info=error)
    reason = say("processing.fault_in_stage", stage=stage, error=type(error).__name__, what=what)
    return Failure("internal", reason, stage=stage)
