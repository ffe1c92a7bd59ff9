"""The slopes of the network: solved again around the segments whose passes changed, and nowhere else.

``segment_evidence`` -> ``network_slopes`` (here) -> ``segment_slopes`` (``publish.py``). Callers own the
network (``app.network.versions``), so that what is read here stays as it is until the result is written.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.network.extracts import ROAD_COLUMNS, ROAD_ORDER, road_table
from app.network.passes import Evidence, count_drives, read_evidence
from app.network.publish import refresh_aggregates
from fusion.network.adjust import Adjustment, adjust
from fusion.network.evidence import SegmentEvidence
from fusion.network.window import WINDOW_RADIUS_M, Window, boxes_around, window_around
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints, Progress, no_progress

TOLERANCE_PERCENT = 1e-6
"""Smaller changes are not written: a solution differs from the last by rounding wherever nothing happened."""

SETTLED_PERCENT = 0.002
"""Slopes just outside of what is published may move by so much; if they move farther, the window was too small."""

SCALES = (1.0, 2.0, 4.0)
"""The library's radii are multiplied by these in turn until the slopes are settled."""

REGION_DEG = 0.02
"""Side of the squares in which a whole network is solved: a town's part of some thousand segments."""

_LINES = text(
    """
    SELECT ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)), ST_Y(ST_EndPoint(geom))
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))
    """
)

_CELLS = text(
    """
    SELECT id, CAST(floor(ST_XMin(geom) / :size) AS integer) AS x, CAST(floor(ST_YMin(geom) / :size) AS integer) AS y
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[])) ORDER BY id
    """
)

# Through the index on the geometry: the cost is that of the roads around the touched ones, however large the
# map.
SURROUNDINGS = text(
    f"""
    SELECT {ROAD_COLUMNS}, s.dem_slope_percent, e.segment_id IS NOT NULL AS driven, n.drives, n.slope_percent
    FROM segments AS s
    LEFT JOIN segment_evidence AS e ON e.segment_id = s.id
    LEFT JOIN network_slopes AS n ON n.segment_id = s.id
    WHERE s.id IN (
        SELECT i.id
        FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                    CAST(:north AS float8[])) AS box (west, south, east, north)
        JOIN segments AS i ON i.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326))
    ORDER BY {ROAD_ORDER}
    """  # noqa: S608 - constants
)

_WRITE = text(
    """
    INSERT INTO network_slopes AS n (segment_id, slope_percent, slope_sigma_percent, drives, observations)
    SELECT * FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope AS float8[]), CAST(:sigma AS float8[]),
                         CAST(:drives AS integer[]), CAST(:observations AS integer[]))
    ON CONFLICT (segment_id) DO UPDATE SET
        slope_percent = excluded.slope_percent, slope_sigma_percent = excluded.slope_sigma_percent,
        drives = excluded.drives, observations = excluded.observations
    WHERE abs(n.slope_percent - excluded.slope_percent) > :tolerance
        OR abs(n.slope_sigma_percent - excluded.slope_sigma_percent) > :tolerance
        OR (n.drives, n.observations) IS DISTINCT FROM (excluded.drives, excluded.observations)
    RETURNING segment_id
    """
)
_CLEAR = text(
    "DELETE FROM network_slopes WHERE segment_id = ANY(CAST(:ids AS bigint[])) RETURNING segment_id"
)


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """The roads around touched segments and what is known of them; every column has shape (n,)."""

    table: RoadTable
    ids: Ints
    dem_slope_percent: Floats
    driven: Bools
    drives: Ints
    """As stored: -1 where the network has no slope."""
    slope_percent: Floats
    """As stored: NaN where the network has none."""


@dataclass(frozen=True, eq=False)
class _Solution:
    """The slopes of a window of the surroundings; ``again`` masks the touched rows."""

    around: _Surroundings
    again: Bools
    window: Window
    result: Adjustment

    def settled(self) -> bool:
        """Whether slopes outside of what is published stay as they are."""
        solved = self.window.solved
        moved = np.abs(self.result.slope_percent - self.around.slope_percent[solved])
        return not np.any(moved[self.window.ring[solved]] > SETTLED_PERCENT)


def refresh_network(session: Session, touched: Collection[int], evidence: Evidence | None = None) -> None:
    """Solve the network again around ``touched`` segments and renew what is published there.

    ``evidence`` is that of (some of) the touched segments, where the caller has it at hand.
    """
    if touched:
        refresh_aggregates(session, adjust_around(session, touched, evidence or {}))


def refresh_in_regions(session: Session, touched: Collection[int], progress: Progress = no_progress) -> None:
    """``refresh_network`` for any number of segments, region by region."""
    parts = regions(session, touched)
    for done, part in enumerate(parts):
        progress("slopes", done / len(parts))
        refresh_region(session, part)


def refresh_region(session: Session, touched: Collection[int]) -> None:
    """``refresh_network`` for a part of many, all of which are to be solved: in one wide window."""
    refresh_aggregates(session, adjust_around(session, touched, {}, SCALES[1:2]))


def regions(session: Session, segment_ids: Collection[int]) -> list[list[int]]:
    """The segments that exist, grouped by the squares of a grid, so that a group is solved at once."""
    groups: dict[tuple[int, int], list[int]] = {}
    for row in session.execute(_CELLS, {"ids": list(segment_ids), "size": REGION_DEG}):
        groups.setdefault((row.y, row.x), []).append(row.id)
    return [groups[cell] for cell in sorted(groups)]


def adjust_around(
    session: Session, touched: Collection[int], evidence: Evidence, scales: Sequence[float] = SCALES
) -> list[int]:
    """Solve again around ``touched`` segments; ids of those whose slope changed, came or went.

    The window grows by ``scales`` until the change has died away at its edge: where little was measured, it
    reaches farther.
    """
    for scale in scales:
        solution = _solve(session, touched, evidence, scale)
        if solution.settled():
            break
    return _store(session, solution)


def _solve(session: Session, touched: Collection[int], evidence: Evidence, scale: float) -> _Solution:
    around = _surroundings(session, touched, scale)
    again = np.isin(around.ids, list(touched))
    window = window_around(around.table, around.driven, again, around.drives >= 0, scale)
    known = _evidence(session, around.ids[window.solved & around.driven], evidence)
    ids = around.ids[window.solved]
    result = adjust(
        around.table.subset(window.solved),
        [known.get(i) for i in ids.tolist()],
        around.dem_slope_percent[window.solved],
        ids,
    )
    return _Solution(around, again, window, result)


def _surroundings(session: Session, touched: Collection[int], scale: float) -> _Surroundings:
    lines = np.array([tuple(row) for row in session.execute(_LINES, {"ids": list(touched)})], float)
    lon0, lat0, lon1, lat1 = lines.reshape(-1, 4).T
    west, south, east, north = boxes_around(lon0, lat0, lon1, lat1, scale * WINDOW_RADIUS_M).T.tolist()
    box = {"west": west, "south": south, "east": east, "north": north}
    rows = session.execute(SURROUNDINGS, box).all()
    table, ids = road_table(rows)
    return _Surroundings(
        table,
        ids,
        np.array([np.nan if row.dem_slope_percent is None else row.dem_slope_percent for row in rows], float),
        np.array([row.driven for row in rows], bool),
        np.array([-1 if row.drives is None else row.drives for row in rows], np.int64),
        np.array([np.nan if row.slope_percent is None else row.slope_percent for row in rows], float),
    )


def _evidence(session: Session, ids: Ints, known: Evidence) -> Mapping[int, SegmentEvidence]:
    """The evidence of driven segments, read where it is not at hand."""
    at_hand = {i: one for i, one in known.items() if one is not None}
    return at_hand | read_evidence(session, set(ids.tolist()) - at_hand.keys())


def _store(session: Session, solution: _Solution) -> list[int]:
    around, window, result = solution.around, solution.window, solution.result
    solved = np.flatnonzero(window.solved)
    usable = np.isfinite(result.slope_percent) & np.isfinite(result.slope_sigma_percent)
    shown = usable & window.published[solved]
    rows = solved[shown]
    gone = window.published & (around.drives >= 0)
    gone[rows] = False
    values = {
        "segment_id": around.ids[rows].tolist(),
        "slope": result.slope_percent[shown].tolist(),
        "sigma": result.slope_sigma_percent[shown].tolist(),
        "drives": _drives(session, around, solution.again)[rows].tolist(),
        "observations": result.observations[shown].tolist(),
        "tolerance": TOLERANCE_PERCENT,
    }
    cleared = session.execute(_CLEAR, {"ids": around.ids[gone].tolist()}).scalars().all()
    return [*cleared, *session.execute(_WRITE, values).scalars()]


def _drives(session: Session, around: _Surroundings, again: Bools) -> Ints:
    """How many drives are heard on each row; counted only where that can have changed, 0 for a gap."""
    count = again | (around.drives < 1)
    drives = np.where(around.driven & ~count, around.drives, 0)
    counted = count_drives(session, around.ids[around.driven & count].tolist())
    for row in np.flatnonzero(around.driven & count).tolist():
        drives[row] = counted.get(int(around.ids[row]), 0)
    return drives
