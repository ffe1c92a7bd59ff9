"""Which of the roads near it a place is on: the nearest, or of a line of places those that go on from each other.

Where a road crosses another on a bridge both are near. Places that form a line say which is meant: by the direction in
which they go, and since a line that was on a road is seldom on another that does not meet it a moment later. The best
sequence is found as map matching does it (Viterbi); costs are squared deviations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.map.heights.places import distances_along_m
from app.map.heights.store import RoadHere
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
    directions = _directions(places)
    start = 0
    while start < len(there):
        end = start
        while end < len(there) and there[end]:
            end += 1
        if end > start:
            chosen[start:end] = _best(there[start:end], directions[start:end])
        start = end + 1
    return chosen


def _best(there: Sequence[Sequence[OnRoad]], directions: Floats) -> list[OnRoad]:
    cost = _costs(there[0], directions[0])
    back: list[np.ndarray] = []
    for before, now, direction in zip(there, there[1:], directions[1:], strict=False):
        jumps = np.array([[0.0 if _meet(a.road, b.road) else JUMP_COST for a in before] for b in now])
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
        along = np.array([_unit(one.road) for one in options])
        sine = along[:, 0] * direction[1] - along[:, 1] * direction[0]
        cost += (sine / TURNED) ** 2
    return np.asarray(cost)


def _meet(a: RoadHere, b: RoadHere) -> bool:
    return a.id == b.id or bool({*a.nodes} & {*b.nodes})


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


def _unit(road: RoadHere) -> tuple[float, float]:
    dx = (road.lon1_deg - road.lon0_deg) * math.cos(math.radians(road.lat0_deg))
    dy = road.lat1_deg - road.lat0_deg
    size = math.hypot(dx, dy) or 1.0
    return dx / size, dy / size


def _directions(places: Floats) -> Floats:
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
