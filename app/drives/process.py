"""One drive through the library: blob -> log -> roads and elevation around it -> estimates -> database.

All that is published is written in one transaction at the end, so that a run may be cut off at any moment and
repeated. A run belongs to a generation of its drive: when the drive was deleted or asked for anew meanwhile,
the result is discarded. Knows no queue and no HTTP.
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from typing import Any

import numpy as np
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import FilePlace, Settings
from app.core.version import code_version
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive
from app.drives.lags import with_settled_lag
from app.drives.outputs.track import track_length_m
from app.drives.progress import Discarded, Interrupted, RunProgress, never
from app.network import extracts, passes
from app.network import results as slopes
from app.network import versions as locks
from app.network.extracts import StoredRoads
from app.roads import store as road_store
from app.terrain import store as dem
from app.terrain.imports import fill_heights_along
from app.terrain.store import DemSet
from fusion.errors import FusionError
from fusion.formats import read_log
from fusion.formats.base import NO_DATE
from fusion.methods.base import DriveResult
from fusion.pipeline import ROAD_MARGIN_M, parse_options, run_drive
from fusion.roads.table import rows_of
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Ints

logger = logging.getLogger(__name__)

MAX_ROAD_CHANGES = 5
"""A drive is estimated so many times, each time because roads were imported meanwhile; then it fails."""
REJECTED_SHARE = 1 / 3
"""A drive that contradicts the others on more of its segments than this gets a warning."""
_LOOK_EVERY_S = 0.5
"""How often a drive that waits for another one looks whether it is to end, seconds."""

# The compiled loops use all cores by themselves, and numba's plainest threading layer must not be entered by
# two threads: within a process drives are estimated one at a time, while others are read and saved.
_ESTIMATING = threading.Lock()


class Outcome(Enum):
    """How a run ended."""

    DONE = "done"
    FAILED = "failed"
    DISCARDED = "discarded"


class ProcessingError(FusionError):
    """The service, not the log, is the reason that a drive fails."""

    kind = "processing-failed"


@dataclass(frozen=True)
class Workbench:
    """What a run works with."""

    sessions: Sessions
    blobs: BlobStore
    dem_dir: FilePlace
    max_log_bytes: int = 512 * 2**20

    @classmethod
    def of(cls, settings: Settings, sessions: Sessions) -> Workbench:
        """The workbench that the settings describe."""
        blobs = BlobStore(settings.blob_store_url)
        return cls(sessions, blobs, settings.dem_dir, settings.max_log_bytes)


@dataclass(frozen=True)
class _Surroundings:
    """Roads and elevation around a log, as they were at one moment."""

    roads: StoredRoads
    dem: DemSet | None


def process_drive(
    bench: Workbench, drive_id: uuid.UUID, generation: int, *, should_stop: Callable[[], bool] = never
) -> Outcome:
    """Run the drive to its end. Safe to call twice, also at the same time: estimates are replaced, not added.

    What the log or the method is to blame for ends as a failed drive with a sentence; so does an unexpected
    error, which is logged. Raises ``Interrupted`` when ``should_stop`` turned true (the drive is queued
    again) and SQLAlchemy's error when the database cannot be reached (``is_connection_loss``): both want
    another run.
    """
    with bench.sessions.begin() as session:
        drive = drives.mark_running(session, drive_id, generation)
    if drive is None:
        return Outcome.DISCARDED
    run = RunProgress(bench.sessions, drive, should_stop)
    try:
        _run(bench, drive, run)
    except Discarded:
        return Outcome.DISCARDED
    except Interrupted:
        with bench.sessions.begin() as session:
            drives.mark_queued(session, drive_id, generation)
        raise
    except Exception as error:
        if is_connection_loss(error):
            raise
        return _fail(bench, drive, run.stage, error)
    return Outcome.DONE


def give_up(bench: Workbench, drive_id: uuid.UUID, generation: int, reason: str) -> None:
    """Fail a drive whose runs were cut off again and again: it must not take worker after worker along."""
    with bench.sessions.begin() as session:
        if drives.mark_running(session, drive_id, generation) is None:
            return
        drives.mark_failed(session, drive_id, generation, kind="interrupted", reason=reason, stage=None)


def is_connection_loss(error: BaseException) -> bool:
    """Whether the database could not be reached or cut a transaction off, so that another run may succeed."""
    if isinstance(error, OperationalError | InterfaceError | PoolTimeoutError):
        return True
    return isinstance(error, DBAPIError) and error.connection_invalidated


def _run(bench: Workbench, drive: Drive, run: RunProgress) -> None:
    run.begin("reading")
    log = _read(bench, drive, run)
    for _ in range(MAX_ROAD_CHANGES):
        run.begin("roads")
        around = _surroundings(bench, log)
        ids, result = _estimate(bench, log, around, drive, run)
        run.begin("saving")
        if _publish(bench, drive, log, around, ids, result):
            return
    raise ProcessingError(
        f"The roads were imported anew {MAX_ROAD_CHANGES} times while this drive was processed. "
        "Ask for it again when the import is over."
    )


def _read(bench: Workbench, drive: Drive, run: RunProgress) -> DriveLog:
    try:
        file = bench.blobs.open(drive.blob_key)
    except FileNotFoundError as error:
        raise ProcessingError(
            "The uploaded file is no longer in the service's storage. Delete the drive and upload it again."
        ) from error
    with file:
        return read_log(file, max_bytes=bench.max_log_bytes, progress=run.part("reading"))


def _surroundings(bench: Workbench, log: DriveLog) -> _Surroundings:
    with bench.sessions() as session:
        # One snapshot, so that the roads are those of the version that is noted beside them.
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        version = road_store.current_road_version(session)
        if version is None:
            raise ProcessingError(
                "No roads have been imported yet. Import them (`versant import-roads FILE`), then ask for "
                "this drive again."
            )
        table, ids = extracts.roads_near(session, log.bounds_deg(), ROAD_MARGIN_M)
        return _Surroundings(StoredRoads(version.id, table, ids), dem.current_dem(session, bench.dem_dir))


def _estimate(
    bench: Workbench, log: DriveLog, around: _Surroundings, drive: Drive, run: RunProgress
) -> tuple[Ints, DriveResult]:
    """The result, and the database's id of each segment of the network that it refers to."""
    run.begin("estimating")
    progress = run.part("estimating")
    with ExitStack() as stack:
        terrain = None if around.dem is None else stack.enter_context(Dem.open(around.dem.paths))
        while not _ESTIMATING.acquire(timeout=_LOOK_EVERY_S):
            progress("waiting for another drive", 0.0)
        stack.callback(_ESTIMATING.release)
        network, result = run_drive(
            log, around.roads.table, terrain, method=drive.method, options=drive.options, progress=progress
        )
        ids = around.roads.ids[rows_of(around.roads.table, network.table)]
        if result.factors:
            driven = network.table.subset(np.unique([f.segment for f in result.factors]))
            fill_heights_along(bench.sessions, bench.dem_dir, driven)
        return ids, with_settled_lag(bench.sessions, drive.id, ids, result)


def _publish(
    bench: Workbench, drive: Drive, log: DriveLog, around: _Surroundings, ids: Ints, result: DriveResult
) -> bool:
    """Write everything in one transaction; False when the roads changed since they were read."""
    provenance = slopes.RunProvenance(
        method=drive.method,
        options=parse_options(drive.method, drive.options).model_dump(mode="json"),
        code_version=code_version(),
        road_version_id=around.roads.version_id,
        dem_version_id=None if around.dem is None else around.dem.version_id,
    )
    with bench.sessions.begin() as session:
        locks.own_network(session)
        if not drives.lock_running(session, drive.id, drive.generation):
            raise Discarded
        current = road_store.current_road_version(session)
        if current is None or current.id != around.roads.version_id:
            return False
        tracks.save_track(session, drive.id, result.track, ids, result.measurements)
        heard = slopes.save_result(
            session, drive.id, ids, result.slopes, provenance, result.factors, log.fix.time_s
        )
        drives.mark_done(
            session,
            drive.id,
            report=_report(result, provenance, heard),
            bounds=log.bounds_deg(),
            epochs=len(result.track),
            distance_m=track_length_m(result.track),
            drive_time=drive_time(log),
        )
    return True


def drive_time(log: DriveLog) -> datetime | None:
    """When the recording begins; None where the log has no date and its times were placed somewhere."""
    return None if NO_DATE in log.repaired else datetime.fromtimestamp(float(log.fix.time_s[0]), UTC)


def _report(result: DriveResult, provenance: slopes.RunProvenance, heard: passes.Hearing) -> dict[str, Any]:
    return {
        **result.report,
        **hearing_report(result.report, heard),
        "code_version": provenance.code_version,
        "road_version": provenance.road_version_id,
        "dem_version": provenance.dem_version_id,
    }


def hearing_report(report: Mapping[str, Any], heard: passes.Hearing) -> dict[str, Any]:
    """What the report says on how the drive agrees with the others over the same segments."""
    warnings = list(report.get("warnings", ()))
    if heard.rejected > REJECTED_SHARE * heard.segments:
        warnings.append(
            f"This drive contradicts other drives on {heard.rejected} of {heard.segments} segments and is not heard "
            "there. Check its time, its sensors' axes and whether it is the same road; its other segments count."
        )
    return {"rejected_segments": heard.rejected, "warnings": warnings}


def _fail(bench: Workbench, drive: Drive, stage: str, error: Exception) -> Outcome:
    where = None
    if isinstance(error, FusionError):
        kind, reason, where = error.kind, str(error), error.where
    elif isinstance(error, MemoryError):
        logger.error("drive %s: out of memory in stage %s", drive.id, stage)
        kind = "out-of-memory"
        reason = "The drive needs more memory than the worker has. Split the log into shorter drives."
    else:
        logger.error("drive %s failed unexpectedly in stage %s", drive.id, stage, exc_info=error)
        kind = "internal"
        reason = (
            f"Processing failed in stage '{stage}' by a fault of the service, not of the log "
            f"({type(error).__name__}). It is in the worker's log under the drive's id; ask the operator."
        )
    with bench.sessions.begin() as session:
        mine = drives.mark_failed(
            session, drive.id, drive.generation, kind=kind, reason=reason, stage=stage, where=where
        )
    return Outcome.FAILED if mine else Outcome.DISCARDED
