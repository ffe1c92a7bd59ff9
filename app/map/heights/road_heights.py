"""Which of the roads near it a place is on, and the height of the road there.

It is the nearest road, or of a line of places those that go on from each other. Where a road crosses another on a
bridge both are near. Places that form a line say which is meant: by the direction in which they go, and since a line
that was on a road is seldom on another that does not meet it a moment later. The best sequence is found as map
matching does it (Viterbi); costs are squared deviations.

A height is measured, else from the elevation model, on bridges and in tunnels neither. A measured segment has heights
of its nodes; between them the grade is even but for the steepest stretch, where that is known. A segment that nobody
measured has those of the elevation model along it. On a bridge or in a tunnel the model knows the ground, not the
road: heights there go evenly between those of the roads at its ends, over all segments of it (a harmonic function on
its graph, which for a chain is a straight line), and its sigma is that of these ends and grows with the distance from
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from sqlalchemy.orm import Session

from app.map.heights.places import distances_along_m
from app.map.heights.store import RoadHere, roads_at
from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats

APART_M = 6.0
"""How far places of a line lie off their road as a rule, one standard deviation."""
TURNED = 0.35
"""The same of the sine between the line's direction and the road's."""
JUMP_COST = 6.0
"""Of going on on a road that does not meet the last: a place may be off by two and a half of ``APART_M`` instead."""
SHORTEST_STEP_M = 2.0
"""Nearer places have no direction."""


@dataclass(frozen=True)
class OnRoad:
    """A place on a road: how far from ``from_node``, as a share of the length, and how far the place lies off, m."""

    road: RoadHere
    share: float
    off_m: float


def nearest(place: Floats, roads: Sequence[RoadHere], radius_m: float) -> OnRoad | None:
    """The place on the nearest road within ``radius_m``; of equally near ones, one that was measured."""
    there = _within(place, roads, radius_m)
    return min(there, key=lambda one: (round(one.off_m, 2), not one.road.measured, one.road.id), default=None)


def along_line(places: Floats, roads: Sequence[Sequence[RoadHere]], radius_m: float) -> list[OnRoad | None]:
    """For each place of a line the place on the road that it most likely follows."""
    there = [_within(place, near, radius_m) for place, near in zip(places, roads, strict=True)]
    chosen: list[OnRoad | None] = [None] * len(there)
    ways = directions(places)
    for is_near, group in groupby(range(len(there)), key=lambda n: bool(there[n])):
        if is_near:
            rows = list(group)
            run = slice(rows[0], rows[-1] + 1)
            chosen[run] = _best(there[run], ways[run])
    return chosen


def _best(there: Sequence[Sequence[OnRoad]], directions: Floats) -> list[OnRoad]:
    cost = _costs(there[0], directions[0])
    back: list[np.ndarray] = []
    for before, now, direction in zip(there, there[1:], directions[1:], strict=False):
        jumps = np.array(
            [[0.0 if {*a.road.nodes} & {*b.road.nodes} else JUMP_COST for a in before] for b in now]
        )
        total = cost[None, :] + jumps
        back.append(np.argmin(total, axis=1))
        cost = total.min(axis=1) + _costs(now, direction)
    k = int(np.argmin(cost))
    path = [k]
    for step in reversed(back):
        k = int(step[k])
        path.append(k)
    return [options[k] for options, k in zip(there, reversed(path), strict=True)]


def _costs(options: Sequence[OnRoad], direction: Floats) -> Floats:
    off = np.array([one.off_m for one in options])
    cost = (off / APART_M) ** 2
    if np.isfinite(direction).all():
        along = np.array([unit(one.road) for one in options])
        sine = along[:, 0] * direction[1] - along[:, 1] * direction[0]
        cost += (sine / TURNED) ** 2
    return np.asarray(cost)


def _within(place: Floats, roads: Sequence[RoadHere], radius_m: float) -> list[OnRoad]:
    lon, lat = float(place[0]), float(place[1])
    east, north = METRES_PER_DEGREE * math.cos(math.radians(lat)), METRES_PER_DEGREE
    near = []
    for road in roads:
        x0, y0 = (road.lon0_deg - lon) * east, (road.lat0_deg - lat) * north
        dx, dy = (road.lon1_deg - road.lon0_deg) * east, (road.lat1_deg - road.lat0_deg) * north
        length2 = dx * dx + dy * dy
        share = 0.0 if length2 == 0 else min(1.0, max(0.0, -(x0 * dx + y0 * dy) / length2))
        off_m = math.hypot(x0 + share * dx, y0 + share * dy)
        if off_m <= radius_m:
            near.append(OnRoad(road, share, off_m))
    return near


def unit(road: RoadHere) -> tuple[float, float]:
    """The road's direction from ``from_node``: a unit vector, east and north."""
    dx = (road.lon1_deg - road.lon0_deg) * math.cos(math.radians(road.lat0_deg))
    dy = road.lat1_deg - road.lat0_deg
    size = math.hypot(dx, dy) or 1.0
    return dx / size, dy / size


def directions(places: Floats) -> Floats:
    """Unit vectors east and north of the line at each place, from the one before to the one after; NaN without one."""
    n = len(places)
    if n < 2:
        return np.full((n, 2), np.nan)
    before, after = np.maximum(np.arange(n) - 1, 0), np.minimum(np.arange(n) + 1, n - 1)
    step = places[after] - places[before]
    step[:, 0] *= np.cos(np.radians(places[:, 1]))
    along_m = distances_along_m(places)
    size = np.hypot(*step.T)
    short = (along_m[after] - along_m[before] < SHORTEST_STEP_M) | (size == 0)
    unit: Floats = np.where(short[:, None], np.nan, step / np.where(size == 0, 1.0, size)[:, None])
    return unit


MEASURED, MODEL, BETWEEN = "measured", "elevation model", "between the ends of a bridge or tunnel"
MODEL_SIGMA_M = 5.0
"""Of a height of an elevation model, one standard deviation: published ones are 4 to 7 m (Copernicus GLO-30, NASADEM,
SRTM), and it knows the ground beside the road as well."""
SAG = 0.02
"""Metres of sigma for each metre from the nearer end of a bridge or tunnel: decks are seldom straight."""
MOST_ROUNDS = 300
"""Segments from a place to the ends of its bridge or tunnel; a longer one has no heights."""


@dataclass(frozen=True)
class RoadHeight:
    """Height in metres with one standard deviation, and what it rests on."""

    height_m: float
    sigma_m: float
    source: str


def heights_of(session: Session, places: Sequence[OnRoad | None]) -> list[RoadHeight | None]:
    """The height of the road at each place; None where nothing is known of it."""
    unmeasured = {
        one.road.id: one.road
        for one in places
        if one is not None and one.road.structure and not one.road.measured
    }
    structure = _whole(session, unmeasured) if unmeasured else None
    decks = {} if structure is None else _between(structure[0], _end_heights(*structure))
    return [None if one is None else _height(one, decks) for one in places]


def _height(place: OnRoad, decks: dict[int, RoadHeight]) -> RoadHeight | None:
    road = place.road
    if road.measured:
        return measured_height(road, place.share)
    if not road.structure:
        return model_height(road, place.share)
    start, end = (decks.get(node) for node in road.nodes)
    if start is None or end is None:
        return None
    height_m = start.height_m + place.share * (end.height_m - start.height_m)
    sigma_m = start.sigma_m + place.share * (end.sigma_m - start.sigma_m)
    return RoadHeight(height_m, sigma_m, BETWEEN)


def measured_height(road: RoadHere, share: float) -> RoadHeight:
    """The height at a share of the length of a segment that is ``measured``."""
    start_m, end_m = float(road.height_from_m or 0.0), float(road.height_to_m or 0.0)
    at_m = share * road.length_m
    height_m = float(np.interp(at_m, *_course(road, start_m, end_m)))
    inner_m = min(at_m, road.length_m - at_m) * (road.slope_sigma_percent or 0.0) / 100
    return RoadHeight(height_m, math.hypot(road.height_sigma_m or 0.0, inner_m), MEASURED)


def _course(road: RoadHere, start_m: float, end_m: float) -> tuple[list[float], list[float]]:
    """Distances and heights between which the grade is even: the ends, and the steepest stretch as the rest allows."""
    grade, first, last = road.steepest_percent, road.steepest_from_m, road.steepest_to_m
    if grade is None or first is None or last is None or last - first >= road.length_m - 1e-6:
        return [0.0, road.length_m], [start_m, end_m]
    rise_m = grade / 100 * (last - first)
    rest = (end_m - start_m - rise_m) / (road.length_m - (last - first))
    at_first = start_m + rest * first
    return [0.0, first, last, road.length_m], [start_m, at_first, at_first + rise_m, end_m]


def model_height(road: RoadHere, share: float) -> RoadHeight | None:
    """What the elevation model has at a share of the length of a segment: of the ground, also on a bridge."""
    heights = np.array(road.dem_heights_m or [], float)
    known = np.isfinite(heights)
    if not known.all() or not len(heights):
        return None
    height_m = float(np.interp(share, np.linspace(0, 1, len(heights)), heights))
    return RoadHeight(height_m, MODEL_SIGMA_M, MODEL)


def _whole(
    session: Session, hit: dict[int, RoadHere]
) -> tuple[dict[int, RoadHere], dict[int, list[RoadHere]]] | None:
    """The unmeasured segments of the structures, and the roads that are not of them at each of their nodes; None: there
    is no end of them."""
    spans, ends = dict(hit), dict[int, list[RoadHere]]()
    seen: set[int] = set()
    edge = _places_of(hit.values())
    for _ in range(MOST_ROUNDS):
        edge = {node: place for node, place in edge.items() if node not in seen}
        if not edge:
            return spans, ends
        seen |= {*edge}
        more: dict[int, RoadHere] = {}
        for road in roads_at(session, edge):
            if road.structure and not road.measured:
                more |= {road.id: road} if road.id not in spans else {}
            else:
                for node in {*road.nodes} & {*edge}:
                    ends.setdefault(node, []).append(road)
        spans |= more
        edge = _places_of(more.values())
    return None


def _places_of(roads: Iterable[RoadHere]) -> dict[int, tuple[float, float]]:
    places = {road.from_node: (road.lon0_deg, road.lat0_deg) for road in roads}
    return places | {road.to_node: (road.lon1_deg, road.lat1_deg) for road in roads}


def _end_heights(spans: dict[int, RoadHere], ends: dict[int, list[RoadHere]]) -> dict[int, RoadHeight]:
    """Heights where roads of the ground, or measured ones, meet a structure: the surest that any of them says."""
    known = {}
    for node in {node for road in spans.values() for node in road.nodes}:
        heights = [height for road in ends.get(node, []) if (height := _at_node(road, node)) is not None]
        if heights:
            known[node] = min(heights, key=lambda one: one.sigma_m)
    return known


def _at_node(road: RoadHere, node: int) -> RoadHeight | None:
    share = 0.0 if road.from_node == node else 1.0
    if road.measured:
        height_m = float((road.height_from_m if share == 0.0 else road.height_to_m) or 0.0)
        known = math.isfinite(height_m)
        return RoadHeight(height_m, road.height_sigma_m or 0.0, MEASURED) if known else None
    return None if road.structure else model_height(road, share)


def _between(spans: dict[int, RoadHere], known: dict[int, RoadHeight]) -> dict[int, RoadHeight]:
    """Heights of all nodes of the structures: harmonic between the known ones, weights by the inverse of lengths."""
    nodes = sorted({node for road in spans.values() for node in road.nodes})
    free = [node for node in nodes if node not in known]
    if not free or not known:
        return dict(known)
    row = {node: n for n, node in enumerate(free)}
    matrix, right = np.zeros((len(free), len(free))), np.zeros((len(free), 2))
    for road in spans.values():
        weight = 1.0 / max(road.length_m, 0.1)
        for here, there in (road.nodes, road.nodes[::-1]):
            if here not in row:
                continue
            matrix[row[here], row[here]] += weight
            if there in row:
                matrix[row[here], row[there]] -= weight
            else:
                right[row[here]] += weight * np.array([known[there].height_m, known[there].sigma_m])
    # What hangs on one known node has its height; what hangs on none has a singular block, and no height.
    solved = np.linalg.lstsq(matrix, right, rcond=None)[0]
    reach_m = _reach(spans, known)
    heights = dict(known)
    for node, n in row.items():
        if node in reach_m:
            heights[node] = RoadHeight(
                float(solved[n, 0]), float(solved[n, 1]) + SAG * reach_m[node], BETWEEN
            )
    return heights


def _reach(spans: dict[int, RoadHere], known: dict[int, RoadHeight]) -> dict[int, float]:
    """Metres along the structures from each node to the nearest known one; nodes that reach none are left out."""
    reach = {node: 0.0 for road in spans.values() for node in road.nodes if node in known}
    for _ in range(len(spans)):
        changed = False
        for road in spans.values():
            for here, there in (road.nodes, road.nodes[::-1]):
                if here in reach and reach[here] + road.length_m < reach.get(there, math.inf):
                    reach[there] = reach[here] + road.length_m
                    changed = True
        if not changed:
            break
    return reach
