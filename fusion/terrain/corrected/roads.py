"""Heights of measured roads, taken from their own datum into that of an elevation model, at places along their lines.

The network's heights and an elevation model's differ slowly: by their datums, by the geoid that receivers subtract, by
the model's large errors. That **slow offset** is taken off, or every measured town would stand on a step. It is the
difference of both at nodes of roads on the ground: its median in each square of ``SQUARE_DEG``, and of these medians
the mean with weights that fall over ``SLOW_M``. What differs over a shorter distance is an error of the model where the
road is, and is corrected. Over 100 m the offset changes by centimetres, so slopes stay what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from fusion.arrays import ColumnTable, counted
from fusion.frames import METRES_PER_DEGREE
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints

SQUARE_DEG = 0.02
SLOW_M = 5000.0
"""One standard deviation of the weights with which medians count."""
MOST_NODES = 100
"""A square with more nodes than so many counts no more."""


@dataclass(frozen=True, eq=False)
class RoadHeights(ColumnTable):
    """n measured segments; columns (n,). Places in degrees, lengths in metres along the segment from its first end.

    ``steepest_percent`` over [``steepest_from_m``, ``steepest_to_m``] is NaN where it is not known;
    ``slope_sigma_percent`` is one standard deviation. ``structure``: a bridge or in a tunnel; ``way``: OpenStreetMap's.
    None crosses the antimeridian.
    """

    lon0_deg: Floats
    lat0_deg: Floats
    lon1_deg: Floats
    lat1_deg: Floats
    length_m: Floats
    height_from_m: Floats
    height_to_m: Floats
    steepest_percent: Floats
    steepest_from_m: Floats
    steepest_to_m: Floats
    slope_sigma_percent: Floats
    structure: Bools
    way: Ints

    def in_box(self, west: float, south: float, east: float, north: float) -> Bools:
        """Those whose box meets this one, degrees."""
        return np.asarray(
            (np.minimum(self.lon0_deg, self.lon1_deg) <= east)
            & (np.maximum(self.lon0_deg, self.lon1_deg) >= west)
            & (np.minimum(self.lat0_deg, self.lat1_deg) <= north)
            & (np.maximum(self.lat0_deg, self.lat1_deg) >= south)
        )


@dataclass(frozen=True, eq=False)
class Places(ColumnTable):
    """m places along roads; columns (m,). ``sigma``: of the grade there, a fraction; ``node``: a segment's end.

    ``deck_end``: where a way on a bridge or in a tunnel ends, which is where routers take its height.
    """

    lon_deg: Floats
    lat_deg: Floats
    height_m: Floats
    sigma: Floats
    structure: Bools
    node: Bools
    deck_end: Bools


def places_along(roads: RoadHeights, apart_m: float) -> Places:
    """Places on both ends of each segment and between them, at most ``apart_m`` from each other."""
    parts = np.maximum(np.ceil(roads.length_m / apart_m), 1).astype(np.int64)
    row, k = counted(parts + 1)
    ends = _deck_ends(roads)
    share = k / parts[row]
    at_m, heights = _courses(roads)
    return Places(
        lon_deg=roads.lon0_deg[row] + share * (roads.lon1_deg - roads.lon0_deg)[row],
        lat_deg=roads.lat0_deg[row] + share * (roads.lat1_deg - roads.lat0_deg)[row],
        height_m=_on_course(share * roads.length_m[row], at_m[row], heights[row]),
        sigma=roads.slope_sigma_percent[row] / 100,
        structure=roads.structure[row],
        node=(k == 0) | (k == parts[row]),
        deck_end=((k == 0) & ends[0][row]) | ((k == parts[row]) & ends[1][row]),
    )


def _deck_ends(roads: RoadHeights) -> Bools:
    """Whether both ends of each segment (2, n) are where a bridge's or tunnel's way ends, or meets another one."""
    place = np.stack([roads.lon0_deg + 1j * roads.lat0_deg, roads.lon1_deg + 1j * roads.lat1_deg])
    found = np.zeros(place.shape, bool)
    decks = np.flatnonzero(roads.structure)
    _, node, count = np.unique(place[:, decks], return_inverse=True, return_counts=True)
    node = node.reshape(2, -1)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    for side in node:
        np.minimum.at(low, side, roads.way[decks])
        np.maximum.at(high, side, roads.way[decks])
    found[:, decks] = ((count != 2) | (low != high))[node]
    return found


def _courses(roads: RoadHeights) -> tuple[Floats, Floats]:
    """Distances and heights (n, 4) between which the grade is even: the ends, and the steepest stretch where it is
    known and shorter than the segment. So ``POST /height`` takes them as well.
    """
    length, start, end = roads.length_m, roads.height_from_m, roads.height_to_m
    stretch = roads.steepest_to_m - roads.steepest_from_m
    inside = np.isfinite(roads.steepest_percent * stretch) & (stretch < length - 1e-6)
    first, last = (np.where(inside, w, 0.0) for w in (roads.steepest_from_m, roads.steepest_to_m))
    rise = np.where(inside, roads.steepest_percent / 100 * stretch, 0.0)
    rest = (end - start - rise) / np.where(inside, length - stretch, np.maximum(length, 1e-9))
    at_first = start + rest * first
    at = np.column_stack([np.zeros(len(length)), first, last, length])
    return at, np.column_stack([start, at_first, at_first + rise, end])


def _on_course(along_m: Floats, at_m: Floats, heights_m: Floats) -> Floats:
    """Heights (m,) between breakpoints (m, 4)."""
    found = heights_m[:, 0].copy()
    for k in range(3):
        step = at_m[:, k + 1] - at_m[:, k]
        share = np.clip((along_m - at_m[:, k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
        found += np.where(step > 0, share, 0.0) * (heights_m[:, k + 1] - heights_m[:, k])
    return found


def in_datum_of(dem: Dem | None, roads: RoadHeights) -> tuple[RoadHeights, float]:
    """The roads with the slow offset taken off, and its median over all ends, m; without a model as they are."""
    if dem is None or not len(roads):
        return roads, 0.0
    lon, lat = np.r_[roads.lon0_deg, roads.lon1_deg], np.r_[roads.lat0_deg, roads.lat1_deg]
    height = np.r_[roads.height_from_m, roads.height_to_m]
    place, ends = lon + 1j * lat, np.r_[roads.structure, roads.structure]
    difference = height - dem.heights(lon, lat)
    difference[np.isin(place, place[ends])] = np.nan  # the model knows no decks, and valleys at their ends
    known = np.isfinite(difference)
    if not known.any():
        return roads, 0.0
    offset = _SlowOffset.of(lon[known], lat[known], difference[known]).at(lon, lat)
    start, end = np.split(offset, 2)
    moved = replace(roads, height_from_m=roads.height_from_m - start, height_to_m=roads.height_to_m - end)
    return moved, float(np.median(offset))


@dataclass(frozen=True, eq=False)
class _SlowOffset:
    """Medians of squares: their middle places, degrees, their weights, and their values, m."""

    lon_deg: Floats
    lat_deg: Floats
    weight: Floats
    median_m: Floats

    @classmethod
    def of(cls, lon_deg: Floats, lat_deg: Floats, difference_m: Floats) -> _SlowOffset:
        square = np.floor(np.column_stack([lon_deg, lat_deg]) / SQUARE_DEG).astype(np.int64)
        _, number, count = np.unique(square, axis=0, return_inverse=True, return_counts=True)
        order = np.lexsort((difference_m, number.ravel()))
        first = np.cumsum(count) - count
        low, high = order[first + (count - 1) // 2], order[first + count // 2]
        lon, lat = (np.bincount(number.ravel(), w) / count for w in (lon_deg, lat_deg))
        median = (difference_m[low] + difference_m[high]) / 2
        return cls(lon, lat, np.minimum(count, MOST_NODES).astype(float), median)

    def at(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """The offset at places (n,): bilinear between the corners of squares, so it has no step anywhere."""
        u, v = lon_deg / SQUARE_DEG, lat_deg / SQUARE_DEG
        left, low = np.floor(u), np.floor(v)
        corners = np.concatenate([np.column_stack([left + i, low + j]) for j in (0, 1) for i in (0, 1)])
        wanted, number = np.unique(corners, axis=0, return_inverse=True)
        value = self._smoothed(*(wanted.T * SQUARE_DEG))[number.ravel()].reshape(4, -1)
        x, y = u - left, v - low
        weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
        return np.asarray((weights * value).sum(axis=0))

    def _smoothed(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        narrow = float(np.cos(np.radians(np.mean(self.lat_deg))))
        scale = METRES_PER_DEGREE * np.array([narrow, 1.0])
        mine, theirs = (
            np.column_stack(w) * scale for w in ((self.lon_deg, self.lat_deg), (lon_deg, lat_deg))
        )
        pairs = KDTree(theirs).sparse_distance_matrix(KDTree(mine), 4 * SLOW_M, output_type="coo_matrix")
        weight = self.weight[pairs.col] * np.exp(-0.5 * (pairs.data / SLOW_M) ** 2)
        total = np.bincount(pairs.row, weight, len(theirs))
        mean = np.bincount(pairs.row, weight * self.median_m[pairs.col], len(theirs))
        usual = float(np.median(self.median_m))  # where nothing is near: far bridges, voids of the model
        return np.where(total > 0, mean / np.where(total > 0, total, 1.0), usual)


def structures_that_lose(places: Places, x_m: Floats, y_m: Floats, near_m: float, *, upper: bool) -> Bools:
    """Places (m,) that another road at another level takes the posts from; see ``fusion.terrain.corrected.fit``."""
    loses = np.zeros(len(places), bool)
    decks = np.flatnonzero(places.structure)
    if not len(decks):
        return loses
    xy = np.column_stack([x_m, y_m])
    for deck, near in zip(decks.tolist(), KDTree(xy).query_ball_point(xy[decks], near_m), strict=True):
        around: Ints = np.asarray(near, np.int64)
        above_m = places.height_m[around] - places.height_m[deck]
        others = around[np.abs(above_m) > LEVEL_M]
        if not len(others):
            continue
        if upper:
            highest = places.height_m[others].max() < places.height_m[deck]
            loses[deck] |= not highest
            loses[others[places.height_m[others] < places.height_m[deck]]] = True
        else:
            on_ground = ~places.structure[others]
            is_under = on_ground.any() or (places.height_m[others] > places.height_m[deck]).any()
            loses[deck] |= bool(is_under) and not places.deck_end[deck]
    return loses


LEVEL_M = 3.0
"""Roads so near each other that differ by more in height are on different levels."""
