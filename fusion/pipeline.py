"""From drive logs to slopes: one drive through all of the library, and several together without a database.

``run_drive`` is what a worker of the service and the command line do with a log; ``solve_network`` is the service's
network adjustment for logs at hand. Nothing here knows files, people or where a result goes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import EmptyLogError, MethodError, MissingSensorError, NoMatchError
from fusion.frames import LocalProjection
from fusion.gnss.positioning import Positioned, options_of, positioned, validated
from fusion.methods.base import DriveResult, Options
from fusion.methods.computed_positions import (
    above_ellipsoid,
    heights_under,
    knows_grade,
    places_alone,
    without_heights,
)
from fusion.network.adjust import adjust
from fusion.network.combine import SlopePart
from fusion.network.control import REACH_M, ControlPoint, place
from fusion.network.duplicates import DriveTrace, find_duplicates
from fusion.network.pass_factor import PassFactor
from fusion.network.subnetwork import gap_rows
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions, knot_rows
from fusion.registry import DEFAULT_METHOD
from fusion.report import Ground, advice_of, drive_report, ground_under, without_placeholders
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable, boxes_along
from fusion.terrain.datum import datum_of_network
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Ints, Progress, no_progress

ROAD_MARGIN_M = 250.0
"""Roads this far around a log's positions are loaded: farther than a method looks for a road, or a gap is long."""
LAG_ROUNDS, LAG_SETTLED_S = 6, 0.3
"""How often factors are made anew for altimeters that are late, and what counts as settled."""
LAG_GAIN, LAG_STEP_S = 1.3, 2.5
"""The response to a lag is taken from smoothed grades, which are too flat: steps are lengthened, within a bound."""
MIN_FIXES = 4
"""Positions without which no log has a slope."""


def parse_options(method: str, options: Mapping[str, Any] | None = None) -> Options:
    """Validate ``options`` for ``method``; raises ``UnknownNameError`` or ``BadOptionsError``."""
    chosen = validated(METHODS[method].options_model, options, f"method {method!r}")
    options_of(POSITIONINGS[chosen.gnss], chosen.gnss_options)
    return chosen


def run_drive(
    log: DriveLog | Positioned,
    roads: RoadTable,
    dem: Dem | None,
    *,
    method: str = DEFAULT_METHOD,
    options: Mapping[str, Any] | Options | None = None,
    progress: Progress = no_progress,
) -> tuple[RoadNetwork, DriveResult]:
    """Estimate the slopes of the segments that one drive went over.

    Positions are computed first, as the options say, unless the log comes with them (``positions_of``); where a
    solver made them and there is an elevation model, the heights of the matched road help to compute them again.
    Takes the roads along the log (``road_boxes``), so a whole country may be handed in. Returns
    the network that the result's segment indices refer to. Raises ``FusionError`` with a sentence for the
    person who supplied the log.
    """
    estimator = METHODS[method]
    chosen = options if isinstance(options, Options) else parse_options(method, options)
    positioned = log if isinstance(log, Positioned) else positions_of(log, chosen, progress)
    positioned = replace(positioned, log=without_placeholders(positioned.log))
    log = positioned.log
    if len(log.fix) < MIN_FIXES:
        raise EmptyLogError(
            f"The log holds {len(log.fix)} position(s); at least {MIN_FIXES} are needed for a slope. "
            "Record for longer, or check that the receiver had a fix."
        )
    west, _, east, _ = log.bounds_deg()
    if east - west > 180:
        raise MethodError(
            f"The log reaches from {west:.3f} to {east:.3f} degrees east: it crosses the 180th meridian, which is not "
            "supported yet. Split it there into two logs."
        )
    near = roads.along(road_boxes(log))
    if not len(near):
        raise NoMatchError(_far_message(log))
    network = RoadNetwork.project(near, _plane(log))
    if dem:
        positioned = _helped(positioned, network, dem)
    ground = ground_under(positioned.log, dem)
    log, graded = _for_slopes(positioned, ground)
    try:
        result = estimator.estimate(log, network, dem, chosen, progress)
    except MissingSensorError as error:
        advice = advice_of(positioned.log, estimator.cues, dem, ground)
        raise MissingSensorError(f"{error} {advice}".strip(), where=error.where) from error
    result = result if graded else places_alone(result)
    if not np.any(result.track.segment >= 0):
        raise NoMatchError(_far_message(log))
    progress("slopes", 1.0)
    report = drive_report(
        log, result, estimator, chosen, dem, ground, computed=positioned.solution is not None, graded=graded
    )
    return network, replace(result, report=report | {"gnss": positioned.report})


def positions_of(log: DriveLog, options: Options, progress: Progress = no_progress) -> Positioned:
    """The log with positions computed as the options of a method say; raises ``FusionError``."""
    return positioned(log, options.gnss, options.gnss_options, progress)


def _helped(positioned: Positioned, network: RoadNetwork, dem: Dem) -> Positioned:
    """The positions again, helped by the heights of the road that they lead along, where they do."""
    if positioned.with_heights is None:
        return positioned
    height = above_ellipsoid(heights_under(positioned.log, network, dem), positioned.height_ell_m)
    return positioned.with_heights(height) if np.isfinite(height).any() else positioned


def _for_slopes(positioned: Positioned, ground: Ground | None) -> tuple[DriveLog, bool]:
    """The log as methods take it, and whether slopes may be made of it."""
    if positioned.solution is None:
        return positioned.log, True
    graded = (ground is not None and ground.share > 0) or knows_grade(positioned.log)
    return (without_heights(positioned.log) if graded else positioned.log), graded


def road_boxes(log: DriveLog) -> Floats:
    """Boxes (m, 4: west, south, east, north; degrees) whose roads a drive is matched to: within ``ROAD_MARGIN_M``."""
    return boxes_along(log.fix.lon_deg, log.fix.lat_deg, ROAD_MARGIN_M)


def _plane(log: DriveLog) -> LocalProjection:
    """Metres around the middle of the drive; the median, so that a wild fix can't drag the plane away."""
    return LocalProjection.around(
        np.median(log.fix.lon_deg, keepdims=True), np.median(log.fix.lat_deg, keepdims=True)
    )


def _far_message(log: DriveLog) -> str:
    west, south, east, north = log.bounds_deg()
    return (
        f"The log lies between {south:.5f} and {north:.5f} degrees north and between {west:.5f} and {east:.5f} "
        "degrees east, and no position in it comes near a known road. Import the roads of that area, or check the "
        "log's coordinates (latitude and longitude swapped?)."
    )


@dataclass(frozen=True, eq=False)
class FusedDrive:
    """A log's result, the rows of the road file that its segment indices refer to, and the times of its positions.

    Without these times (none: unknown) duplicates are found less surely.
    """

    rows: Ints
    result: DriveResult
    epoch_s: Floats


class SolvedNetwork(NamedTuple):
    """What drives with factors say together."""

    parts: dict[int, list[SlopePart]]
    """By row of the road file: driven segments and gaps."""
    rejected: list[int]
    """For each drive, the segments that it passed and on which it is rejected, for it contradicts the others."""
    duplicates: dict[int, int]
    """Duplicate drives, each with the one that counts"""
    remarks: list[str]
    """Sentences on control points that have no road, or that the drives contradict, and on a wrong elevation model."""


def solve_network(
    roads: RoadTable, dem: Dem | None, drives: Sequence[FusedDrive], control: Sequence[ControlPoint] = ()
) -> SolvedNetwork:
    """Solve the drives that give factors together, as the service does; the others have no part in it."""
    rejected = [0] * len(drives)
    duplicates = find_duplicates({k: _trace(one) for k, one in enumerate(drives)})
    # In the order of driving, so that the order in which logs are named changes no digit.
    numbers = sorted(
        (k for k, one in enumerate(drives) if one.result.factors and k not in duplicates),
        key=lambda k: float(drives[k].result.track.time_s[0]),
    )
    if not numbers:
        return SolvedNetwork({}, rejected, duplicates, [])
    passes = {k: _in_file(drives[k], drives[k].result.factors) for k in numbers}
    near = surroundings([drives[k] for k in numbers])
    surveyed, far = place(control, roads.subset(near))
    table = roads.subset(near)
    driven = np.isin(near, [f.segment for factors in passes.values() for f in factors])
    solved = driven | gap_rows(table, driven)
    table, rows = table.subset(solved), near[solved]
    terrain = Terrain(dem.heights_along(*knot_positions(table), knot_rows(table))) if dem else None
    row_of = {int(row): k for k, row in enumerate(rows)}
    for _ in range(LAG_ROUNDS):
        own = {k: [f.over(row_of[f.segment]) for f in factors] for k, factors in enumerate(passes.values())}
        result = adjust(table, own, terrain, surveyed.among(solved))
        anew = {
            numbers[k]: factors
            for k, lag_s in result.lag_s.items()
            if (factors := factors_for_lag(drives[numbers[k]].result, passes[numbers[k]], lag_s))
        }
        passes |= {k: _in_file(drives[k], factors) for k, factors in anew.items()}
        if not anew:
            break
    accepted = Counter[tuple[int, int]]()
    for (k, sequence), good in result.accepted.items():
        accepted[numbers[k], next(f.segment for f in own[k] if f.sequence == sequence)] += good
    for (number, _), count in accepted.items():
        rejected[number] += count == 0
    drives_on = Counter(row for (_, row), count in accepted.items() if count)
    parts = result.parts([drives_on[row] for row in range(len(rows))])
    away = [
        f"Control point {point.called} lies more than {REACH_M:g} m from the roads around the drives."
        for point in far
    ]
    undriven = [
        f"Control point {name} lies on a road that no drive knows."
        for name, row in zip(surveyed.names, surveyed.row.tolist(), strict=True)
        if not solved[row]
    ]
    remarks = [*away, *undriven, *result.remarks, *(result.model.remarks(table) if result.model else ())]
    known = {row: [part] for row, part in zip(rows.tolist(), parts, strict=True) if part is not None}
    return SolvedNetwork(known, rejected, duplicates, remarks)


def network_datum(
    dem: Dem | None, drives: Sequence[FusedDrive], control: Sequence[ControlPoint] = ()
) -> str | None:
    """What the heights of ``solve_network`` refer to, in words; None where it gives none."""
    with_heights = [one.result.report for one in drives if one.result.factors]
    if not with_heights:
        return None
    logs = [report["height_datum"] for report in with_heights]
    known = dem is not None and any(report["dem_share"] for report in with_heights)
    return datum_of_network(logs, dem.datum if dem and known else None, bool(control))


def surroundings(drives: Sequence[FusedDrive]) -> Ints:
    """Rows of the road file around the drives: farther than any gap beside a track is long."""
    return np.unique(np.concatenate([one.rows for one in drives]))


def _trace(one: FusedDrive) -> DriveTrace:
    said = one.result.factors or one.result.slopes
    return DriveTrace(
        one.rows[np.array([s.segment for s in said], np.int64)],
        np.array([s.first_time_s for s in said], float),
        one.epoch_s,
        sum(f.rows for f in one.result.factors) or sum(s.observations for s in said),
    )


def _in_file(one: FusedDrive, factors: Sequence[PassFactor]) -> list[PassFactor]:
    """Factors of a log over the rows of the road file."""
    return [f.over(int(one.rows[f.segment])) for f in factors]


def factors_for_lag(
    result: DriveResult, factors: Sequence[PassFactor], lag_s: float | None
) -> tuple[PassFactor, ...] | None:
    """The factors of a drive made anew for the altimeter's lag that a network's solution finds, ``lag_s``.

    ``factors`` are those that were solved. None where the lag is settled, or nothing is known of one: the factors stay.
    A drive alone rarely shows the lag: where everybody drives the same way, lag and slope look alike.
    """
    if result.late_by is None or lag_s is None:
        return None
    before_s = factors[0].lag_s
    step_s = float(np.clip(LAG_GAIN * (lag_s - before_s), -LAG_STEP_S, LAG_STEP_S))
    return None if abs(step_s) < LAG_SETTLED_S else result.late_by(before_s + step_s)
