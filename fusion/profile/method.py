"""Method ``profile``: the whole drive matched, smoothed along its path, and handed on as factors of each pass.

Only the order of the work stands here, and the drive's own slopes, for which its factors are solved like the network's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError, NoMatchError
from fusion.matching.drive import MatchOptions
from fusion.messages import say
from fusion.methods.base import DriveResult, Options
from fusion.network.adjust import adjust, adjust_from, tasks_of
from fusion.network.blockwise.partition import bisected
from fusion.network.pass_columns import PackedPasses, table_of
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions, knot_rows
from fusion.profile.factors import DrivenPasses
from fusion.profile.inertia import Inertia, set_right
from fusion.profile.measurements import ALTITUDE, FORCE, PITCH, SENSORS, Measurements, build_measurements
from fusion.profile.model import build_smoother_epochs
from fusion.profile.noise import learn
from fusion.profile.path import DrivenPath, find_path
from fusion.profile.prior import ALTIMETER_DRIFT, RECEIVER_DRIFT, UsualDrift, prior_of, tells_drift
from fusion.profile.report import build_track, drawn_measurements, drive_report, path_report
from fusion.profile.traversals import Altimeter, SmoothedDrive
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.types import (
    CUES,
    DriveLog,
    Floats,
    GnssFix,
    Ints,
    Progress,
    SegmentSlope,
    no_progress,
    within,
)

USUAL_LAG_S = 1.5
"""How late an altimeter is where nothing is known: between none and the three seconds that slow filters take."""
COMPUTER_STEP_M = 0.2
"""Steps of heights in files of bicycle computers: FIT states altitudes in fifths of a metre. Such heights come from a
barometer behind a filter, whatever their errors look like."""
_USUAL_DRIFT = (RECEIVER_DRIFT, ALTIMETER_DRIFT)
BLOCK_SEGMENTS = 6000
"""Of a long drive so many segments are solved at once."""
SMALL_TASKS = 8
"""As if so many hands worked on the blocks: then each is a task of its own, and the drive can be stopped between."""
MATCHED, SMOOTHED, REPORTED, SUMMED = 0.03, 0.3, 0.34, 0.42
"""The shares of the work that are done then, as a million positions show. A short drive is smoothed longer than it is
solved, but nobody waits for it."""
MIN_MEASUREMENTS = 4
"""Fewer say nothing of a slope."""


class ProfileOptions(Options):
    """Options of ``profile``: which sensors to use, and how the map is matched."""

    altitude: bool = True
    """Use GNSS altitudes."""
    doppler: bool = True
    """Use Doppler vertical velocity over ground speed."""
    pitch: bool = True
    """Use the pitch of an attitude sensor."""
    force: bool = True
    """Use the accelerometer's forward axis beyond the change of speed."""
    barometer: bool = True
    """Use pressure."""
    dem: bool = True
    """Use the elevation model, away from bridges and tunnels."""
    match_radius_m: float = Field(50.0, gt=5, le=200)
    """How far from a road a position may lie, m."""

    def sensors(self) -> frozenset[int]:
        """Codes of the sensors to use (``measurements.SENSORS``)."""
        wanted = (self.altitude, self.doppler, self.pitch, self.force, self.barometer, self.dem)
        return frozenset(code for code, use in enumerate(wanted) if use)


@dataclass(frozen=True, eq=False)
class _PreparedDrive:
    """A drive on its path with its inertial data set right, and what was found wrong with them."""

    log: DriveLog
    path: DrivenPath
    inertia: Inertia | None

    @classmethod
    def of(cls, log: DriveLog, path: DrivenPath, use: frozenset[int]) -> _PreparedDrive:
        """Of sensors that are in ``use`` alone."""
        right, inertia = set_right(log) if use & {PITCH, FORCE} else (log, None)
        return cls(right, path, inertia)


@dataclass(frozen=True, eq=False)
class _LateBy:
    """``DriveResult.late_by``: no closure, so that it can be kept in a file."""

    raw: _PreparedDrive
    fix: GnssFix
    dem: Dem | None
    options: ProfileOptions
    sensor: int
    usual: UsualDrift | None

    def __call__(self, lag_s: float, progress: Progress = no_progress) -> Sequence[PassFactor]:
        then = Altimeter(self.sensor, lag_s)
        measured = _measure(self.raw, self.dem, self.options, then)
        drive = _smooth(self.raw, measured, then, self.usual, within(progress, 0.0, 0.9))
        passes = DrivenPasses.of(drive, self.fix)
        del drive
        return passes.factors(within(progress, 0.9, 1.0))


class ProfileMethod:
    """The default estimator behind the ``Method`` protocol."""

    name = "profile"
    source = "Versant; HMM matching after Newson & Krumm 2009, fixed-interval smoothing, network adjustment"
    description = (
        "Matches the whole drive, smooths height and grade along it with the drive's own noise levels; drives are "
        "solved together."
    )
    needs = ("positions", "altitudes, Doppler velocity, pitch, acceleration or pressure: any of them")
    cues = CUES
    options_model = ProfileOptions

    def estimate(
        self,
        log: DriveLog,
        network: RoadNetwork,
        dem: Dem | None,
        options: ProfileOptions,
        progress: Progress,
    ) -> DriveResult:
        """See ``Method.estimate``."""
        progress("match", 0.0)
        path = find_path(
            log, network, MatchOptions(radius_m=options.match_radius_m), within(progress, 0.0, MATCHED)
        )
        if path is None:
            raise NoMatchError(say("drive.no_stretch"))
        progress("smooth", MATCHED)
        raw = _PreparedDrive.of(log, path, options.sensors())
        drive, late, usual = _learned(raw, dem, options, within(progress, MATCHED, SMOOTHED))
        report = drive_report(log, drive, raw.inertia, within(progress, SMOOTHED, REPORTED))
        progress("smooth", REPORTED)
        passes = DrivenPasses.of(drive, log.fix)
        progress("smooth", REPORTED)
        track, drawn = build_track(drive), drawn_measurements(drive)
        late_by = _LateBy(raw, log.fix, dem, options, late.sensor, usual) if late.sensor >= 0 else None
        del drive, raw  # of a long drive they are as large as what its slopes take
        progress("factors", REPORTED)
        factors = passes.factors(within(progress, REPORTED, SUMMED))
        report = path_report(path, factors) | report
        del passes, path
        terrain = dem if options.dem else None
        slopes = adjusted_slopes(network, factors, terrain, within(progress, SUMMED, 1.0))
        return DriveResult(track, slopes, report, factors, drawn, late_by)


def _learned(
    raw: _PreparedDrive, dem: Dem | None, options: ProfileOptions, progress: Progress
) -> tuple[SmoothedDrive, Altimeter, UsualDrift | None]:
    """The smoothed drive, whether its heights are an altimeter's, whose filter makes them late, and the usual drift.

    An altimeter's heights err like a barometer: steps of a computer or a drift as slow as that show it. A short or
    noisy drive shows no drift, and is taken for a receiver's. Only to see the drift, a drive is learned from twice.
    """
    measured, drive, late = _measure(raw, dem, options, Altimeter()), None, Altimeter()
    again = progress
    if _may_be_late(raw.log, measured):
        late = Altimeter(ALTITUDE, USUAL_LAG_S)
        if not _in_steps(raw.log.fix.alt_msl_m):
            drive = _smooth(raw, measured, Altimeter(), progress=within(progress, 0.0, 0.5))
            again = within(progress, 0.5, 1.0)
            late = late if drive.learned.noise.drift < ALTIMETER_DRIFT.rate else Altimeter()
    usual = None if tells_drift(measured) else _USUAL_DRIFT[late.sensor >= 0]
    if drive is None or late.sensor >= 0 or usual:
        drive = None  # it is large
        if late.sensor >= 0:
            measured = _measure(raw, dem, options, late)
        drive = _smooth(raw, measured, late, usual, again)
    return drive, late, usual


def _may_be_late(log: DriveLog, measured: Measurements) -> bool:
    """Whether heights may be an altimeter's. A receiver's own fix is not: it states its accuracy, or is above the
    ellipsoid, which no altimeter knows. Nor is what is made of pressure, which is a sensor's own sample."""
    own = log.fix.has("v_acc_m") or log.fix.has("height_ell_m")
    return bool((measured.sensor == ALTITUDE).any() and not own)


def _in_steps(height_m: Floats) -> bool:
    """Whether heights come in the steps of a bicycle computer's files, ``COMPUTER_STEP_M``, and not in whole metres."""
    known = height_m[np.isfinite(height_m)] / COMPUTER_STEP_M
    off = np.abs(known - np.round(known)) > 0.01
    on_grid = np.round(known) % round(1 / COMPUTER_STEP_M) == 0
    return len(known) > 0 and bool(np.mean(off) < 0.01 and np.mean(on_grid) < 0.5)


def _measure(
    raw: _PreparedDrive, dem: Dem | None, options: ProfileOptions, altimeter: Altimeter
) -> Measurements:
    measured = build_measurements(raw.log, raw.path, dem, options.sensors(), altimeter.lag_s)
    if len(measured) < MIN_MEASUREMENTS:
        raise MissingSensorError(say("drive.too_little", n=len(measured), sensors=", ".join(SENSORS)))
    return measured


def _smooth(
    raw: _PreparedDrive,
    measured: Measurements,
    altimeter: Altimeter,
    usual_drift: UsualDrift | None = None,
    progress: Progress = no_progress,
) -> SmoothedDrive:
    epochs = build_smoother_epochs(measured, raw.path)
    by_satellites = not _in_steps(raw.log.fix.alt_msl_m)
    prior = prior_of(measured, usual_drift)
    learned = learn(measured, epochs, prior, by_satellites=by_satellites, progress=progress)
    return SmoothedDrive(raw.path, measured, epochs, learned, altimeter)


def adjusted_slopes(
    network: RoadNetwork, factors: Sequence[PassFactor], dem: Dem | None, progress: Progress = no_progress
) -> tuple[SegmentSlope, ...]:
    """The slopes of one drive's segments: its factors solved like the network's, alone."""
    if not factors:
        return ()
    every = table_of(factors)
    rows, segment = np.unique(every.segment, return_inverse=True)
    table = network.table.subset(rows)
    terrain = (
        Terrain(dem.heights_along(*knot_positions(table), knot_rows(table))) if dem is not None else None
    )
    if isinstance(factors, PackedPasses):
        solved = _in_blocks(table, factors.over(segment), terrain, progress)
    else:
        solved = adjust(table, {0: [f.over(int(k)) for f, k in zip(factors, segment, strict=True)]}, terrain)
    first, last = np.full(len(rows), np.inf), np.full(len(rows), -np.inf)
    np.minimum.at(first, segment, every.first_time_s)
    np.maximum.at(last, segment, every.last_time_s)
    return tuple(
        SegmentSlope(
            segment=int(row),
            slope_percent=float(solved.slope_percent[k]),
            slope_sigma_percent=float(solved.slope_sigma_percent[k]),
            observations=int(solved.observations[k]),
            passes=int(solved.passes[k] + solved.rejected[k]),
            first_time_s=float(first[k]),
            last_time_s=float(last[k]),
        )
        for k, row in enumerate(rows)
    )


def _in_blocks(
    table: RoadTable, passes: PackedPasses, terrain: Terrain | None, progress: Progress
) -> Adjustment:
    """The solution of a long drive, of which one block is in memory at a time."""
    with TemporaryDirectory(prefix="versant-drive-") as folder:
        blocks = bisected(table, BLOCK_SEGMENTS, folder=Path(folder))
        blocks = replace(blocks, hands=SMALL_TASKS)
        blocks = replace(blocks, executor=_InTurn(progress, tasks_of(blocks)))
        return adjust_from(_BlocksOf(passes, blocks.block[passes.table.segment]), table, blocks, terrain)


@dataclass(frozen=True, eq=False)
class _BlocksOf:
    """A ``PassSource`` of one drive; ``block`` (m,) is that of each pass."""

    passes_of_all: PackedPasses
    block: Ints

    def passes(self, block: int) -> dict[int, list[PassFactor]]:
        """See ``PassSource``."""
        return {0: self.passes_of_all.decoded(np.flatnonzero(self.block == block).tolist())}


class _InTurn(Executor):
    """Does each task when it is handed over, and says before each how many of about so many are done."""

    def __init__(self, progress: Progress, tasks: int) -> None:
        self._progress, self._tasks, self._done = progress, tasks, 0

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        """See ``Executor``."""
        self._progress("slopes", min(self._done / self._tasks, 1.0))
        self._done += 1
        future: Future[Any] = Future()
        try:
            future.set_result(work(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future
