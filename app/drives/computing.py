"""A log through the library: log -> positions -> roads and elevation around it -> estimates.

For a drive, which publishes the result (``app.drives.process``), and for a trial of one, which does not
(``app.drives.trials.run``). Writes nothing.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from typing import Any, Protocol

from app.core.telemetry.logs import tell
from app.core.version import code_version
from app.drives.faults import NoRoadsError, ProcessingError
from app.drives.progress import RunProgress
from app.jobs.context import JobContext
from app.network.extracts import Roads, roads_in
from app.roads import store as road_store
from app.terrain import store as dem
from app.terrain.heights import open_dem
from app.terrain.store import DemSet
from fusion.formats import read_log
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
