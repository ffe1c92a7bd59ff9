"""From drawn streets to what a map holds: heights of the roads, ways, node pairs in the order of drawing, grades.

Heights are smooth, agree at junctions, and are near the ground except on structures; how the ground came about is not
known here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from fusion.roads.table import RoadTable
from fusion.simulate.scene.plan import BRIDGE, GROUND, TUNNEL, Kind, Plan, Street
from fusion.types import Floats, Ints

_ON_GROUND_M = 0.7
"""One sigma of how far a road leaves the ground; on banks and in cuttings ``_EMBANKED_M``."""
_EMBANKED_M = 3.0
_KINK = {"motorway": 0.004, "motorway_link": 0.008, "primary": 0.012, "secondary": 0.012}
"""One sigma of the change of grade (a fraction) from one segment of a street to the next, by class of road."""
_KINK_ELSEWHERE = 0.018
_KINK_ON_STRUCTURE = 0.001
_KINK_AT_MERGES = 0.002
_CLEARANCE_SIGMA_M = 0.2
"""One sigma of how exactly a bridge keeps its height above the road below."""


def node_heights(plan: Plan, ground_m: Floats) -> Floats:
    """Height of every node, metres, by weighted least squares.

    Three kinds of equations, each divided by its tolerance: a node on the ground lies at ``ground_m``; the
    grade changes little from one segment of a street to the next; a bridge over a road keeps its clearance.
    Inside bridges and tunnels the first kind is left out, so that the road runs nearly straight between its
    ends.
    """
    system = _System(len(ground_m))
    for node, tolerance in enumerate(_ground_tolerance(plan)):
        if np.isfinite(tolerance):
            system.add([node], [1.0], float(ground_m[node]), tolerance)
    for street in plan.streets:
        _add_smoothness(system, plan, street)
    for a, b, c in plan.merges:
        lengths = [float(np.hypot(*(plan.xy(v) - plan.xy(u)))) for u, v in ((a, b), (b, c))]
        _add_kink(system, (a, b, c), lengths, _KINK_AT_MERGES)
    for top, under, clearance in plan.clearances:
        share = -1.0 / len(under)
        system.add([top, *under], [1.0] + [share] * len(under), clearance, _CLEARANCE_SIGMA_M)
    return system.solve()


class _System:
    """Rows of a sparse weighted least-squares problem."""

    def __init__(self, unknowns: int) -> None:
        self.unknowns = unknowns
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.values: list[float] = []
        self.right: list[float] = []

    def add(self, nodes: list[int], factors: list[float], right: float, tolerance: float) -> None:
        self.rows += [len(self.right)] * len(nodes)
        self.columns += nodes
        self.values += [f / tolerance for f in factors]
        self.right.append(right / tolerance)

    def solve(self) -> Floats:
        shape = (len(self.right), self.unknowns)
        a = csr_array((self.values, (self.rows, self.columns)), shape=shape)
        return np.asarray(spsolve((a.T @ a).tocsc(), a.T @ np.array(self.right)), float)


def _ground_tolerance(plan: Plan) -> Floats:
    """How far each node may leave the ground (metres, one sigma); infinite inside bridges and tunnels."""
    tolerance = np.full(len(plan.x_m), np.nan)
    for street in plan.streets:
        for k, kind in enumerate(street.kinds):
            for node in street.nodes[k : k + 2]:
                banked = (kind.highway == "motorway" or node in plan.embanked) and node not in plan.level
                allowed = _EMBANKED_M if banked else _ON_GROUND_M
                if kind.structure == GROUND:
                    tolerance[node] = np.nanmax([tolerance[node], allowed])
    return np.where(np.isnan(tolerance), np.inf, tolerance)


def _add_smoothness(system: _System, plan: Plan, street: Street) -> None:
    length = segment_lengths(plan, street)
    for k in range(len(length) - (0 if street.closed else 1)):
        m = (k + 1) % len(length)
        nodes = (street.nodes[k], street.nodes[k + 1], street.nodes[m + 1])
        kink = _kink(street.kinds[k], street.kinds[m])
        _add_kink(system, nodes, [float(length[k]), float(length[m])], kink)


def _add_kink(system: _System, nodes: tuple[int, int, int], lengths: list[float], tolerance: float) -> None:
    """Change of grade from the segment before the middle node to the one after it: none, within a tolerance."""
    before, after = 1 / lengths[0], 1 / lengths[1]
    system.add(list(nodes), [before, -before - after, after], 0.0, tolerance)


def _kink(before: Kind, after: Kind) -> float:
    """Tolerated change of grade (a fraction) between two consecutive segments."""
    if GROUND not in (before.structure, after.structure):
        return _KINK_ON_STRUCTURE
    return _KINK.get(before.highway, _KINK_ELSEWHERE)


def segment_lengths(plan: Plan, street: Street) -> Floats:
    """Lengths of a street's segments, metres."""
    x, y = np.array(plan.x_m)[street.nodes], np.array(plan.y_m)[street.nodes]
    return np.asarray(np.hypot(np.diff(x), np.diff(y)))


def node_grades(plan: Plan, street: Street, height_m: Floats) -> Floats:
    """Grade (rise over run along the street) at each of its nodes; it leaves no kink inside the street."""
    length = segment_lengths(plan, street)
    mean = np.diff(height_m[street.nodes]) / length
    if street.closed:
        mean, length = np.r_[mean[-1], mean, mean[0]], np.r_[length[-1], length, length[0]]
    inside = (mean[:-1] * length[1:] + mean[1:] * length[:-1]) / (length[:-1] + length[1:])
    return inside if street.closed else np.r_[mean[0], inside, mean[-1]]


def hermite(
    z0_m: Floats, z1_m: Floats, grade0: Floats, grade1: Floats, length_m: Floats, share: Floats
) -> Floats:
    """Height at ``share`` 0..1 of segments from the heights and grades at their ends (cubic, broadcasts)."""
    u = np.asarray(share, float)
    mean = (z1_m - z0_m) / length_m
    bend = (grade0 - mean) * (u - 2 * u**2 + u**3) + (grade1 - mean) * (u**3 - u**2)
    return np.asarray(z0_m + length_m * (mean * u + bend))


def regression_slope(z0_m: Floats, z1_m: Floats, grade0: Floats, grade1: Floats, length_m: Floats) -> Floats:
    """Slope (a fraction) of the least-squares line through the whole cubic profile of a segment.

    Integrating 12 (u - 1/2) z(u) over the segment gives mean - (grade0 - mean + grade1 - mean) / 10.
    """
    mean = (z1_m - z0_m) / length_m
    return np.asarray(1.2 * mean - 0.1 * (grade0 + grade1))


FIRST_NODE_ID = 9_100_000_001
"""Beyond 32 bits, as real node ids are."""
FIRST_WAY_ID = 800_000_001
_LONGEST_WAY = 12
"""Segments of a way at most: longer streets are cut."""


@dataclass(frozen=True)
class Way:
    """A way as it is drawn: node indices in order, one kind for all of it."""

    way_id: int
    name: str | None
    kind: Kind
    nodes: tuple[int, ...]
    grades: Floats
    """Grade of the road at each node in the direction of drawing, shape (nodes,)."""


def cut_into_ways(plan: Plan, height_m: Floats) -> list[Way]:
    """Cut streets where their kind changes or they grow long; draw some two-way ways the other way round."""
    ways: list[Way] = []
    for street in plan.streets:
        grades = node_grades(plan, street, height_m)
        for start, stop in _stretches(plan, street):
            nodes, along = street.nodes[start : stop + 1], grades[start : stop + 1]
            kind = street.kinds[start]
            if kind.oneway == 0 and plan.rng.random() < 0.5:
                nodes, along = nodes[::-1], -along[::-1]
            ways.append(Way(FIRST_WAY_ID + 7 * len(ways), street.name, kind, tuple(nodes), along))
    return ways


def _stretches(plan: Plan, street: Street) -> list[tuple[int, int]]:
    """First and last node position of each way of a street."""
    cuts = [0]
    for k in range(1, len(street.kinds)):
        changed = street.kinds[k] != street.kinds[k - 1]
        grown = not street.closed and k - cuts[-1] >= _LONGEST_WAY - int(plan.rng.integers(0, 5))
        if changed or grown:
            cuts.append(k)
    return list(zip(cuts, [*cuts[1:], len(street.kinds)], strict=True))


@dataclass(frozen=True)
class Segments:
    """The node pairs of all ways in the order of ``roads``; ``start`` and ``end`` are node indices."""

    roads: RoadTable
    start: Ints
    end: Ints
    grade_start: Floats
    grade_end: Floats


def node_ids(count: int) -> Ints:
    """OpenStreetMap ids of the first ``count`` nodes, increasing."""
    return FIRST_NODE_ID + 3 * np.arange(count, dtype=np.int64)


def tabulate(ways: list[Way], lon_deg: Floats, lat_deg: Floats) -> Segments:
    """Turn ways into segments; ``lon_deg`` and ``lat_deg`` are those of the nodes."""
    start = np.concatenate([w.nodes[:-1] for w in ways])
    end = np.concatenate([w.nodes[1:] for w in ways])
    way = np.repeat(np.arange(len(ways)), [len(w.nodes) - 1 for w in ways])
    way_id = np.array([w.way_id for w in ways], np.int64)
    order = np.lexsort((end, start, way_id[way]))
    start, end, way = start[order], end[order], way[order]
    kinds = [ways[w].kind for w in way]
    ids = node_ids(len(lon_deg))
    roads = RoadTable.from_columns(
        osm_way_id=way_id[way],
        from_node=ids[start],
        to_node=ids[end],
        lon0_deg=lon_deg[start],
        lat0_deg=lat_deg[start],
        lon1_deg=lon_deg[end],
        lat1_deg=lat_deg[end],
        oneway=[k.oneway for k in kinds],
        bridge=[k.structure == BRIDGE for k in kinds],
        tunnel=[k.structure == TUNNEL for k in kinds],
        layer=[layer_of(k) for k in kinds],
        highway=[k.highway for k in kinds],
        name=[ways[w].name for w in way],
    )
    if len(roads) != len(start):
        raise AssertionError("the plan draws a segment twice")
    grade_start = np.concatenate([w.grades[:-1] for w in ways])[order]
    grade_end = np.concatenate([w.grades[1:] for w in ways])[order]
    return Segments(roads, start.astype(np.int64), end.astype(np.int64), grade_start, grade_end)


def layer_of(kind: Kind) -> int:
    """OpenStreetMap's layer of a kind of road."""
    return {BRIDGE: 1, TUNNEL: -1}.get(kind.structure, 0)
