"""From several drives to slopes without a database: the service's network adjustment for logs at hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from fusion.arrays import ColumnTable
from fusion.lags import factors_for_lag, with_settled_lags
from fusion.methods.base import DriveResult
from fusion.network.adjust import adjust
from fusion.network.combine import SlopePart
from fusion.network.control import REACH_M, ControlHeights, ControlPoint, place
from fusion.network.duplicates import DriveTrace, find_duplicates
from fusion.network.repeats import (
    FEWEST_DRIVES,
    OwnSlopes,
    RepeatPairs,
    device_class,
    learn_widenings,
)
from fusion.network.segment_slopes import Adjustment
from fusion.network.subnetwork import gap_rows
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions, knot_rows
from fusion.roads.table import RoadTable
from fusion.terrain.datum import datum_of_network
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class FusedDrive:
    """A log's result, the rows of the road file that its segment indices refer to, and the times of its positions.

    Without these times (none: unknown) duplicates are found less surely.
    """

    rows: Ints
    result: DriveResult
    epoch_s: Floats


@dataclass(frozen=True, eq=False)
class OnceDriven(ColumnTable):
    """What a drive by itself says of m segments that it passed once; columns (m,). ``row`` is the road file's."""

    row: Ints
    slope_percent: Floats
    sigma_percent: Floats
    driven_m: Floats
    speed_mps: Floats


@dataclass(frozen=True, eq=False)
class DriveFacts:
    """What is known of a drive beside what its passes say: little enough that those of all drives fit into memory.

    ``kind`` is its device class. ``in_network``: it gives factors, whose rows ``trace`` has; others have no part in the
    network. ``begin_s`` is when it began.
    """

    trace: DriveTrace
    once: OnceDriven
    kind: str
    begin_s: float
    in_network: bool

    @classmethod
    def of(cls, one: FusedDrive) -> Self:
        """Of a drive in memory."""
        result, said = one.result, one.result.factors or one.result.slopes
        trace = DriveTrace(
            one.rows[np.array([s.segment for s in said], np.int64)],
            np.array([s.first_time_s for s in said], float),
            one.epoch_s,
            sum(f.rows for f in result.factors) or sum(s.observations for s in said),
        )
        passed = {f.segment: f for f in result.factors}
        once = [s for s in result.slopes if s.passes == 1 and s.segment in passed]
        alone = [passed[s.segment] for s in once]
        driven_m = np.array([f.end_m - f.start_m for f in alone], float)
        took_s = np.array([f.last_time_s - f.first_time_s for f in alone], float)
        own = OnceDriven(
            one.rows[np.array([s.segment for s in once], np.int64)],
            np.array([s.slope_percent for s in once], float),
            np.array([s.slope_sigma_percent for s in once], float),
            driven_m,
            driven_m / np.maximum(took_s, 0.1),
        )
        in_network = bool(result.factors)
        kind = device_class(result.report) if in_network else ""
        return cls(trace, own, kind, float(result.track.time_s[0]), in_network)


class Evidence(Protocol):
    """Who holds what the passes of drives say, in memory or in files, and solves a network from it."""

    def adjusted(
        self,
        network: RoadTable,
        rows: Ints,
        widening: Mapping[int, float],
        terrain: Terrain | None,
        control: ControlHeights,
    ) -> Adjustment:
        """A solution from the drives that ``widening`` names, in its order, their sigmas so much wider.

        A drive's number in the solution is its place in this order. ``rows`` of the road file are those of ``network``;
        passes over others have no part in it.
        """
        ...

    def near(self, numbers: Sequence[int]) -> Ints:
        """Rows of the road file around these drives, ascending."""
        ...

    @property
    def altimeters(self) -> Set[int]:
        """Drives whose factors can be made anew for another lag."""
        ...

    def made_anew(self, lag_s: Mapping[int, float], settled_s: float) -> Set[int]:
        """Make the factors of drives anew for lags of their altimeters (``factors_for_lag``); which drives' were."""
        ...

    def made_before(self) -> Set[int] | None:
        """What the next ``made_anew`` would say, where a run that was cut off has done that; None: it is not known."""
        ...


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
    """Solve the drives that give factors together, as the service does; the others have no part in it."""
    facts = [DriveFacts.of(one) for one in drives]
    return solve_evidence(roads, dem, facts, _InMemory(drives), control)


def solve_evidence(
    roads: RoadTable,
    dem: Dem | None,
    facts: Sequence[DriveFacts],
    evidence: Evidence,
    control: Sequence[ControlPoint] = (),
) -> SolvedNetwork:
    """As ``solve_network``, whoever holds what the drives say.

    Sigmas of drives whose class their own repeats contradict (``fusion.network.repeats``) count as much wider at once:
    what a service does where its operator asks for it.
    """
    rejected = [0] * len(facts)
    duplicates = find_duplicates({k: one.trace for k, one in enumerate(facts)})
    # In the order of driving, so that the order in which logs are named changes no digit.
    numbers = sorted(
        (k for k, one in enumerate(facts) if one.in_network and k not in duplicates),
        key=lambda k: facts[k].begin_s,
    )
    if not numbers:
        return SolvedNetwork({}, rejected, duplicates, [])
    widening, said = _widenings(roads, {k: facts[k] for k in numbers})
    near = evidence.near(numbers)
    surveyed, far = place(control, roads.subset(near))
    table = roads.subset(near)
    driven = np.isin(near, np.concatenate([facts[k].trace.segment for k in numbers]))
    solved = driven | gap_rows(table, driven)

    def adjusted(part: Bools) -> Adjustment:
        own = table.subset(part)
        terrain = Terrain(dem.heights_along(*knot_positions(own), knot_rows(own))) if dem else None
        return evidence.adjusted(own, near[part], widening, terrain, surveyed.among(part))

    def made_anew(
        part: Bools, among: Collection[int] | None, settled_s: float
    ) -> tuple[Adjustment | None, Set[int]]:
        known = evidence.made_before()
        if known is not None:
            return None, known
        result = adjusted(part)
        lag_s = {numbers[k]: one for k, one in result.lag_s.items()}
        asked = {k: one for k, one in lag_s.items() if among is None or k in among}
        return result, evidence.made_anew(asked, settled_s)

    def around(late: Set[int]) -> Bools:
        passed = np.isin(near, np.concatenate([facts[k].trace.segment for k in late]))
        return np.asarray(passed | gap_rows(table, passed))

    altimeters = evidence.altimeters & set(numbers)
    result = with_settled_lags(solved, altimeters, adjusted, made_anew, around)
    table, rows = table.subset(solved), near[solved]
    drives_on, wrong = _accepted(result, len(rows))
    for k, count in wrong.items():
        rejected[numbers[k]] = count
    parts = result.parts(drives_on)
    of_terrain = result.model.remarks(table) if result.model else ()
    remarks = [*said, *_unused(far, surveyed, solved), *result.remarks, *of_terrain]
    known = {row: [part] for row, part in zip(rows.tolist(), parts, strict=True) if part is not None}
    return SolvedNetwork(known, rejected, duplicates, remarks)


class _InMemory:
    """Drives whose factors are in memory, solved as one system."""

    def __init__(self, drives: Sequence[FusedDrive]) -> None:
        self._drives = drives
        self._factors = {k: one.result.factors for k, one in enumerate(drives)}

    def near(self, numbers: Sequence[int]) -> Ints:
        """Rows around these drives."""
        return surroundings([self._drives[k] for k in numbers])

    def adjusted(
        self,
        network: RoadTable,
        rows: Ints,
        widening: Mapping[int, float],
        terrain: Terrain | None,
        control: ControlHeights,
    ) -> Adjustment:
        """See ``Evidence``."""
        row_of = {int(row): k for k, row in enumerate(rows)}
        own = {
            place: [
                f.over(row).widened(wider)
                for f in self._factors[k]
                if (row := row_of.get(int(self._drives[k].rows[f.segment]))) is not None
            ]
            for place, (k, wider) in enumerate(widening.items())
        }
        return adjust(network, {place: said for place, said in own.items() if said}, terrain, control)

    @property
    def altimeters(self) -> Set[int]:
        """See ``Evidence``."""
        return {k for k, one in enumerate(self._drives) if one.result.late_by is not None}

    def made_anew(self, lag_s: Mapping[int, float], settled_s: float) -> Set[int]:
        """See ``Evidence``."""
        anew = {
            k: factors
            for k, one in lag_s.items()
            if (factors := factors_for_lag(self._drives[k].result, self._factors[k], one, settled_s))
        }
        self._factors |= anew
        return anew.keys()

    def made_before(self) -> None:
        """Nothing is kept."""


def _accepted(result: Adjustment, segments: int) -> tuple[list[int], dict[int, int]]:
    """By how many drives each segment has an accepted pass; and by drive, on how many segments it has none."""
    passes = result.judged.passes
    pairs, which = np.unique(passes.drive * segments + passes.segment, return_inverse=True)
    good = np.bincount(which, result.judged.accepted, len(pairs)) > 0
    drive, row = np.divmod(pairs, segments)
    return np.bincount(row[good], minlength=segments).tolist(), dict(Counter(drive[~good].tolist()))


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
    dem: Dem | None, reports: Sequence[Mapping[str, Any]], control: Sequence[ControlPoint] = ()
) -> str | None:
    """What the heights of ``solve_network`` refer to, in words, by the reports of the drives with factors; None without
    any."""
    if not reports:
        return None
    logs = [report["height_datum"] for report in reports]
    known = dem is not None and any(report["dem_share"] for report in reports)
    return datum_of_network(logs, dem.datum if dem and known else None, bool(control))


def surroundings(drives: Sequence[FusedDrive]) -> Ints:
    """Rows of the road file around the drives: farther than any gap beside a track is long."""
    return np.unique(np.concatenate([one.rows for one in drives]))


def _widenings(roads: RoadTable, drives: Mapping[int, DriveFacts]) -> tuple[dict[int, float], list[str]]:
    """By how much the drives' sigmas are to be widened, as they contradict one another, and what to say of it."""
    learned = learn_widenings(_repeats(roads, drives)) if len(drives) >= FEWEST_DRIVES else []
    applied = {one.name: one for one in learned if one.applied != 1.0}
    return {k: applied[one.kind].applied if one.kind in applied else 1.0 for k, one in drives.items()}, [
        f"{one.drives} logs of one class ({one.name}) are farther apart than they state: their sigmas count "
        f"{one.applied:.2f} times."
        for one in applied.values()
    ]


def _repeats(roads: RoadTable, drives: Mapping[int, DriveFacts]) -> RepeatPairs:
    """Slopes of the drives by themselves, in the order of driving, against those of drives before them."""
    own = OnceDriven.empty().joined(*(one.once for one in drives.values()))
    counts = [len(one.once) for one in drives.values()]
    names = sorted({one.kind for one in drives.values() if len(one.once)})
    number = [names.index(one.kind) if len(one.once) else 0 for one in drives.values()]
    order = np.argsort(own.row, kind="stable")
    own, unknown = own.take(order), np.zeros(len(own), np.int64)
    return RepeatPairs.of_neighbours(
        OwnSlopes(
            names=tuple(names),
            segment=own.row,
            drive=np.repeat(np.array([*drives], np.int64), counts)[order],
            kind=np.repeat(np.array(number, np.int64), counts)[order],
            slope_percent=own.slope_percent,
            sigma_percent=own.sigma_percent,
            length_m=roads.length_m[own.row],
            driven_m=own.driven_m,
            speed_mps=own.speed_mps,
            way=unknown,
            season=unknown - 1,
        )
    )
