"""Solves the network again around the segments whose passes changed, and nowhere else.

``drive_passes`` -> a ``Solution``. Nothing is written and nobody waits: the caller reads in one snapshot, and ``swap``
writes the solution.
"""

from __future__ import annotations

import math
import uuid
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds, bigints, fetch_binary
from app.network.cells import partitions_around
from app.network.condensed import StoredPass, by_drive, condensed_over, constants_outside, oldest
from app.network.extracts import roads_in
from app.network.passes import passes_over
from app.network.widenings import widenings_of
from fusion.frames import SHORTEST_DEGREE_M
from fusion.network.adjust import adjust
from fusion.network.condensed import CondensedPasses
from fusion.network.control import REACH_M, ControlHeights, ControlPoint, place
from fusion.network.curve import interval_count, knot_length
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.subnetwork import SOLVE_RADIUS_M, Subnetwork, boxes_around, subnetwork_around
from fusion.network.terrain import Terrain
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

_LINES = text("""
    SELECT ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)), ST_Y(ST_EndPoint(geom))
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))
""")

# A segment is driven where a drive that is no duplicate has a pass; the first one is enough. OFFSET 0 makes the planner
# look at passes before drives, whatever it believes of tables that have grown since.
KNOWN = """
    SELECT s.id, coalesce(p.driven, false) AS driven, coalesce(n.drives, -1), n.slope_percent, n.slope_sigma_percent
    FROM unnest(%(ids)s) AS s (id)
    LEFT JOIN LATERAL (
        SELECT true AS driven FROM (
            SELECT drive_id FROM drive_passes WHERE segment_id = s.id AND partition = ANY(%(partitions)s::smallint[])
            ORDER BY entered_s OFFSET 0) AS over
        WHERE (SELECT duplicate_of IS NULL FROM drives WHERE id = over.drive_id) LIMIT 1) AS p ON true
    LEFT JOIN network_slopes AS n ON n.segment_id = s.id
    WHERE p.driven OR n.segment_id IS NOT NULL
"""
_ROW = np.dtype([("id", "i8"), ("driven", "?"), ("drives", "i8"), ("slope", "f8"), ("sigma", "f8")])
_UNKNOWN = np.array((0, False, -1, np.nan, np.nan), _ROW)

_HEIGHTS = """
    SELECT id, dem_heights_m FROM segments WHERE id = ANY(%(ids)s::bigint[]) AND dem_heights_m IS NOT NULL
"""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The roads around touched segments and what is known of them; every column has shape (n,)."""

    table: RoadTable
    ids: Ints
    cell: Ints
    """The cell of each row (``app.network.cells``)."""
    driven: Bools
    drives: Ints
    """As stored: -1 where the network has no slope."""
    slope_percent: Floats
    """As stored, like its sigma: NaN where the network has none."""
    slope_sigma_percent: Floats


def surroundings(session: Session, touched: Collection[int], scale: float) -> Surroundings:
    """The roads within the library's radius, times ``scale``, around ``touched`` segments."""
    lines = np.array([tuple(row) for row in session.execute(_LINES, {"ids": bigints(touched)}).all()], float)
    lon0, lat0, lon1, lat1 = lines.reshape(-1, 4).T
    boxes = boxes_around(lon0, lat0, lon1, lat1, scale * SOLVE_RADIUS_M)
    roads = roads_in(session, boxes)
    row = np.argsort(roads.ids)
    rows = fetch_binary(session, KNOWN, {"ids": roads.ids, "partitions": partitions_around(roads.cell)})
    known = np.full(len(roads.ids), _UNKNOWN)
    known[row[np.searchsorted(roads.ids, [one[0] for one in rows], sorter=row)]] = rows
    columns = (known[name].copy() for name in ("driven", "drives", "slope", "sigma"))
    return Surroundings(roads.table, roads.ids, roads.cell, *columns)


def stored_terrain(session: Session, table: RoadTable, ids: Ints) -> Terrain | None:
    """Heights of the elevation model at the knots of ``table``, whose segments have these ids; None: there are none."""
    stored = dict(fetch_binary(session, _HEIGHTS, {"ids": ids}))
    if not stored:
        return None
    count = interval_count(knot_length(table.length_m)) + 1
    heights = [
        np.asarray(stored[i], float) if i in stored and len(stored[i]) == n else np.full(n, np.nan)
        for i, n in zip(ids.tolist(), count.tolist(), strict=True)
    ]
    return Terrain(np.concatenate(heights))


_NEAR = text("""
    SELECT lon_deg, lat_deg, height_m, sigma_m, name FROM control_points
    WHERE lon_deg BETWEEN :west AND :east AND lat_deg BETWEEN :south AND :north
    ORDER BY lon_deg, lat_deg
""")


def control_near(session: Session, bounds_deg: Bounds) -> list[ControlPoint]:
    """The stored points in a box (degrees), in the same order however they came."""
    box = dict(zip(("west", "south", "east", "north"), bounds_deg, strict=True))
    return [ControlPoint(*row) for row in session.execute(_NEAR, box)]


def control_on(session: Session, table: RoadTable) -> ControlHeights:
    """The stored points on the roads of a table that holds all roads where it has any."""
    points = control_near(session, widened(table.bounds_deg())) if len(table) else []
    return place(points, table)[0]


def widened(bounds_deg: Bounds) -> Bounds:
    """The box and all within a point's reach of it."""
    west, south, east, north = bounds_deg
    margin = REACH_M / SHORTEST_DEGREE_M
    farthest = min(max(abs(south), abs(north)) + margin, 89.9)
    wider = margin / math.cos(math.radians(farthest))
    return west - wider, south - margin, east + wider, north + margin


SETTLED_SIGMAS = 0.025
"""Slopes just outside of what is published may move by so much; if they move farther, the subnetwork was too small.
What settling changes afterwards is to stay below 0.1 sigma."""

SCALES = (1.0, 8.0)
"""The library's radii are multiplied by these in turn until the slopes are settled: where one is not enough, two and
four seldom are, and cost as much again."""

LARGEST_GROWING = 1_000
"""Subnetworks of more segments do not grow; settling corrects what they leave. Changes reach far where little is known,
and there roads are few; a subnetwork twice as wide has four times as many."""

SETTLING_SCALE = 2.0
"""The scale of the one subnetwork in which settling solves a cell."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The slopes of a subnetwork of the surroundings, from recent passes, drive by drive, and condensed ones."""

    around: Surroundings
    subnetwork: Subnetwork
    drives: list[list[StoredPass]]
    result: Adjustment | None
    """None where nothing was to be solved"""
    condensed: list[tuple[int, CondensedPasses]] = field(default_factory=list)
    """The condensed passes over each segment"""
    widening: Mapping[uuid.UUID, float] = field(default_factory=dict)
    """What sigmas of a drive were multiplied by; of others by 1"""

    def settled(self) -> bool:
        """Whether slopes outside of what is published stay as they are."""
        if self.result is None:
            return True
        solved = self.subnetwork.solved
        moved = np.abs(self.result.slope_percent - self.around.slope_percent[solved])
        far = moved > SETTLED_SIGMAS * self.around.slope_sigma_percent[solved]
        return not np.any(far[self.subnetwork.ring[solved]])

    def accepted(self) -> list[tuple[StoredPass, bool]]:
        """Every recent pass and whether this solution accepts it."""
        if self.result is None:
            return []
        accepted = self.result.accepted
        return [(p, accepted[k, p.factor.sequence]) for k, laps in enumerate(self.drives) for p in laps]

    def accepted_drives(self) -> Counter[int]:
        """How many drives are accepted on each segment, condensed ones included."""
        count = Counter(
            segment for segment, _ in {(p.factor.segment, p.drive_id) for p, good in self.accepted() if good}
        )
        for k, (segment, one) in enumerate(self.condensed, len(self.drives)):
            count[segment] += one.drives * (self.result is not None and self.result.accepted[k, 0])
        return count

    def old_passes(self, shown: Bools) -> list[StoredPass]:
        """The passes over ``shown`` rows that are to be condensed, with the weight of each in this solution: a pass
        whose sigma is widened weighs less."""
        if self.result is None:
            return []
        mine = set(self.around.ids[shown & self.subnetwork.solved].tolist())
        weight, over = self.result.weight, dict[int, list[StoredPass]]()
        for k, laps in enumerate(self.drives):
            less = self.widening.get(laps[0].drive_id, 1.0) ** -2.0
            for p in laps:
                name = (k, p.factor.sequence)
                if p.id is not None and p.factor.segment in mine:
                    counted = less * weight[name] if self.result.accepted[name] else 0.0
                    over.setdefault(p.factor.segment, []).append(p._replace(weight=counted))
        return oldest(over)


def solve_around(session: Session, touched: Collection[int]) -> tuple[Solution, Bools]:
    """Solve again around ``touched`` segments; the solution, and for which rows of its surroundings it is published.

    The subnetwork grows until the change has died away at its edge: where little was measured, it reaches farther. Gaps
    that depend on roads outside of the subnetwork wait until these are settled.
    """
    for scale in SCALES:
        solution = _solve(session, touched, scale)
        if solution.settled() or np.count_nonzero(solution.subnetwork.solved) > LARGEST_GROWING:
            break
    subnetwork = solution.subnetwork
    return solution, subnetwork.published & ~subnetwork.outward


def settle_cell(session: Session, segment_ids: Collection[int]) -> Solution:
    """Solve one cell anew from passes alone: these segments are all of the network in it.

    Earlier solutions have no part in it, so slopes do not depend on which cell came first.
    """
    return _solve(session, segment_ids, SETTLING_SCALE)


def lag_among_all(session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor]) -> float | None:
    """How late the drive's altimeter is, s, if its passes were ``factors`` (of database ids); None: it has none.

    Nothing is written, and the drive's own stored passes have no part in it, so the network need not be owned.
    """
    instead = [StoredPass(None, drive_id, True, factor) for factor in factors]
    solution = _solve(session, {f.segment for f in factors}, SCALES[0], instead)
    if solution.result is None:
        return None
    lags = solution.result.lag_s
    return next((lags.get(k) for k, laps in enumerate(solution.drives) if laps[0].drive_id == drive_id), None)


def _solve(
    session: Session, touched: Collection[int], scale: float, instead: Sequence[StoredPass] = ()
) -> Solution:
    """``instead``: passes of one drive in place of its stored ones."""
    around = surroundings(session, touched, scale)
    again = np.isin(around.ids, list(touched))
    driven = around.driven | np.isin(around.ids, [p.factor.segment for p in instead])
    subnetwork = subnetwork_around(around.table, driven, again, around.drives >= 0, scale)
    ids = around.ids[subnetwork.solved].tolist()
    if not ids:
        return Solution(around, subnetwork, [], None)
    row_of = {segment: row for row, segment in enumerate(ids)}
    own = {p.drive_id for p in instead}
    passes = [p for p in passes_over(session, ids) if p.drive_id not in own]
    drives = by_drive([*passes, *(p for p in instead if p.factor.segment in row_of)])
    widening = widenings_of(session, {laps[0].drive_id for laps in drives})
    times = [widening.get(laps[0].drive_id, 1.0) for laps in drives]
    outside = {
        k: constants.widened(times[k])
        for k, constants in constants_outside(session, drives).items()
        if drives[k][0].drive_id not in own
    }
    condensed = sorted(condensed_over(session, ids, next(iter(own), None)).items())
    factors = {
        k: [p.factor.over(row_of[p.factor.segment]).widened(times[k]) for p in laps]
        for k, laps in enumerate(drives)
    }
    length = knot_length(around.table.length_m[subnetwork.solved])
    for k, (segment, one) in enumerate(condensed, len(drives)):
        factors[k] = [one.factor(row_of[segment], float(length[row_of[segment]]))]
    result = adjust(
        around.table.subset(subnetwork.solved),
        factors,
        stored_terrain(session, around.table.subset(subnetwork.solved), around.ids[subnetwork.solved]),
        control_on(session, around.table).among(subnetwork.solved),
        outside=outside,
    )
    return Solution(around, subnetwork, drives, result, condensed, widening)
