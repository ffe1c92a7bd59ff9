"""From several drives to slopes without a database: the service's network adjustment for logs at hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.methods.base import DriveResult
from fusion.network.adjust import adjust
from fusion.network.combine import SlopePart
from fusion.network.control import REACH_M, ControlHeights, ControlPoint, place
from fusion.network.duplicates import DriveTrace, find_duplicates
from fusion.network.pass_factor import PassFactor
from fusion.network.repeats import (
    FEWEST_DRIVES,
    OwnSlopes,
    RepeatPairs,
    device_class,
    learn_widenings,
)
from fusion.network.subnetwork import gap_rows
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions, knot_rows
from fusion.roads.table import RoadTable
from fusion.terrain.datum import datum_of_network
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints

LAG_ROUNDS, LAG_SETTLED_S = 6, 0.3
"""How often factors are made anew for altimeters that are late, and what counts as settled."""
LAG_GAIN, LAG_STEP_S = 1.3, 2.5
"""The response to a lag is taken from smoothed grades, which are too flat: steps are lengthened, within a bound."""


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
    """Sentences on sigmas that count wider, on control points that have no road or that the drives contradict, and on a
    wrong elevation model"""


def solve_network(
    roads: RoadTable, dem: Dem | None, drives: Sequence[FusedDrive], control: Sequence[ControlPoint] = ()
) -> SolvedNetwork:
    """Solve the drives that give factors together, as the service does; the others have no part in it.

    Sigmas of drives whose class their own repeats contradict (``fusion.network.repeats``) count as much wider at once:
    what a service does where its operator asks for it.
    """
    rejected = [0] * len(drives)
    duplicates = find_duplicates({k: _trace(one) for k, one in enumerate(drives)})
    # In the order of driving, so that the order in which logs are named changes no digit.
    numbers = sorted(
        (k for k, one in enumerate(drives) if one.result.factors and k not in duplicates),
        key=lambda k: float(drives[k].result.track.time_s[0]),
    )
    if not numbers:
        return SolvedNetwork({}, rejected, duplicates, [])
    widening, said = _widenings(roads, {k: drives[k] for k in numbers})
    passes = {k: _in_file(drives[k], drives[k].result.factors, widening[k]) for k in numbers}
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
        passes |= {k: _in_file(drives[k], factors, widening[k]) for k, factors in anew.items()}
        if not anew:
            break
    accepted = Counter[tuple[int, int]]()
    for (k, sequence), good in result.accepted.items():
        accepted[numbers[k], next(f.segment for f in own[k] if f.sequence == sequence)] += good
    for (number, _), count in accepted.items():
        rejected[number] += count == 0
    drives_on = Counter(row for (_, row), count in accepted.items() if count)
    parts = result.parts([drives_on[row] for row in range(len(rows))])
    of_terrain = result.model.remarks(table) if result.model else ()
    remarks = [*said, *_unused(far, surveyed, solved), *result.remarks, *of_terrain]
    known = {row: [part] for row, part in zip(rows.tolist(), parts, strict=True) if part is not None}
    return SolvedNetwork(known, rejected, duplicates, remarks)


def _unused(far: Sequence[ControlPoint], surveyed: ControlHeights, solved: Bools) -> list[str]:
    """What to say of control points that are no part of the solution."""
    away = [
        f"Control point {point.called} lies more than {REACH_M:g} m from the roads around the drives."
        for point in far
    ]
    undriven = [
        f"Control point {name} lies on a road that no drive knows."
        for name, row in zip(surveyed.names, surveyed.row.tolist(), strict=True)
        if not solved[row]
    ]
    return [*away, *undriven]


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


def _in_file(one: FusedDrive, factors: Sequence[PassFactor], widening: float) -> list[PassFactor]:
    """Factors of a log over the rows of the road file, so much wider."""
    return [f.over(int(one.rows[f.segment])).widened(widening) for f in factors]


def _widenings(roads: RoadTable, drives: Mapping[int, FusedDrive]) -> tuple[dict[int, float], list[str]]:
    """By how much the drives' sigmas are to be widened, as they contradict one another, and what to say of it."""
    learned = learn_widenings(_repeats(roads, drives)) if len(drives) >= FEWEST_DRIVES else []
    applied = {one.name: one for one in learned if one.applied != 1.0}
    if not applied:
        return dict.fromkeys(drives, 1.0), []
    kind = {k: device_class(one.result.report) for k, one in drives.items()}
    return {k: applied[kind[k]].applied if kind[k] in applied else 1.0 for k in drives}, [
        f"{one.drives} logs of one class ({one.name}) are farther apart than they state: their sigmas count "
        f"{one.applied:.2f} times."
        for one in applied.values()
    ]


def _repeats(roads: RoadTable, drives: Mapping[int, FusedDrive]) -> RepeatPairs:
    """Slopes of the drives by themselves, in the order of driving, against those of drives before them."""
    found = []
    for k, one in drives.items():
        passed = {f.segment: f for f in one.result.factors}
        once = [said for said in one.result.slopes if said.passes == 1 and said.segment in passed]
        name = device_class(one.result.report) if once else ""
        found += [(int(one.rows[said.segment]), k, name, said, passed[said.segment]) for said in once]
    found.sort(key=lambda own: own[0])
    names = sorted({name for _, _, name, _, _ in found})
    segment = np.array([row for row, *_ in found], np.int64)
    driven_m = np.array([f.end_m - f.start_m for *_, f in found])
    unknown = np.zeros(len(found), np.int64)
    return RepeatPairs.of_neighbours(
        OwnSlopes(
            names=tuple(names),
            segment=segment,
            drive=np.array([k for _, k, *_ in found], np.int64),
            kind=np.array([names.index(name) for _, _, name, _, _ in found], np.int64),
            slope_percent=np.array([said.slope_percent for *_, said, _ in found]),
            sigma_percent=np.array([said.slope_sigma_percent for *_, said, _ in found]),
            length_m=roads.length_m[segment],
            driven_m=driven_m,
            speed_mps=driven_m / np.maximum([f.last_time_s - f.first_time_s for *_, f in found], 0.1),
            way=unknown,
            season=unknown - 1,
        )
    )


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
