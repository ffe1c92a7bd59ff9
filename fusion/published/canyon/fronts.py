"""Fronts of houses along streets: where they stand, how high they are, what a reflection on them costs.

A front is a straight vertical wall between two points of the plane. Streets of Table 3.1's classes get blocks with gaps
on either side; what would stand in a road is left out, so that streets open where they meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from fusion.arrays import ColumnTable
from fusion.published.canyon.ride import Route
from fusion.simulate.scene.town import Town
from fusion.types import Floats

_SPACING_M = 2.0
"""Between the points at which distances of fronts and roads are taken."""
_CLEAR_SHARE = 0.75
"""A front nearer to any road than this share of its own distance stands in that road."""
_LOSS_DB, _LOSS_SIGMA_DB, _LEAST_LOSS_DB = 9.0, 4.0, 3.0
"""What a reflection takes off C/N0: brick and concrete 6 to 12 dB, the change of polarisation included; glass less."""
_CENTRE_SHARE, _EDGE_SHARE = 0.25, 0.6
"""Shares of a town's radius within which streets are urban, and then industrial; beyond, residential."""


class StreetClass(NamedTuple):
    """Height of its houses and width from front to front (m, Table 3.1), and how its blocks stand.

    ``block_m`` and ``gap_m`` are means, ``height_spread`` is one sigma as a share. They are ours: the table has none.
    """

    height_m: float
    width_m: tuple[float, float]
    block_m: float
    gap_m: float
    height_spread: float


STREETS = {
    "open": StreetClass(0.0, (20.0, 20.0), 100.0, 0.0, 0.0),
    "residential": StreetClass(6.0, (7.0, 7.0), 14.0, 12.0, 0.2),
    "industrial": StreetClass(8.0, (19.0, 19.0), 40.0, 25.0, 0.2),
    "urban": StreetClass(25.0, (20.0, 25.0), 45.0, 6.0, 0.2),
    "dense": StreetClass(30.0, (45.0, 60.0), 60.0, 10.0, 0.2),
}
"""Heights and widths of Table 3.1 as printed. Its mask elevations do not follow from them (residential fronts would
mask 52 degrees, not 10, and dense ones 50, not over 60), so that they are not used."""


@dataclass(frozen=True)
class Fronts(ColumnTable):
    """n fronts: ``ends_m`` (n, 4) are x, y of one end and of the other, ``top_m`` (n,) the roof on the plane's z.

    ``loss_db`` (n,) is what a reflection takes off C/N0.
    """

    ends_m: Floats
    top_m: Floats
    loss_db: Floats

    def clear_of(self, roads_m: Floats) -> Fronts:
        """Those that do not stand in a road; ``roads_m`` (k, 2) are points of all roads, about every metre."""
        if not len(self):
            return self
        start, end = self.ends_m[:, :2], self.ends_m[:, 2:]
        count = np.maximum(2, np.ceil(np.linalg.norm(end - start, axis=1) / _SPACING_M).astype(np.int64) + 1)
        owner = np.repeat(np.arange(len(self)), count)
        share = np.concatenate([np.linspace(0, 1, c) for c in count])[:, None]
        near, _ = cKDTree(roads_m).query(start[owner] * (1 - share) + end[owner] * share)
        least = np.minimum.reduceat(near, np.concatenate([[0], np.cumsum(count)[:-1]]))
        own = np.maximum.reduceat(near, np.concatenate([[0], np.cumsum(count)[:-1]]))
        keep = least >= np.maximum(_CLEAR_SHARE * own, 2.0)
        return self.take(keep)


NO_FRONTS = Fronts(np.empty((0, 4)), np.empty(0), np.empty(0))


def fronts_along(street: Route, kind: StreetClass, rng: np.random.Generator) -> Fronts:
    """Blocks on both sides of a street, from its beginning to its end."""
    if kind.height_m <= 0:
        return NO_FRONTS
    half = 0.5 * rng.uniform(*kind.width_m)
    return NO_FRONTS.joined(*(_side(street, kind, side * half, rng) for side in (-1.0, 1.0)))


def _side(street: Route, kind: StreetClass, aside_m: float, rng: np.random.Generator) -> Fronts:
    """The blocks of one side, ``aside_m`` to the right of the street's middle."""
    along, points = street.along_m, street.points_m
    begin, end = _blocks(float(along[-1]), kind, rng)
    heading = np.gradient(points[:, :2], axis=0)
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-9)
    edge = points[:, :2] + aside_m * np.column_stack([heading[:, 1], -heading[:, 0]])
    ends = [np.interp(at, along, edge[:, k]) for at in (begin, end) for k in range(2)]
    ground = np.interp(0.5 * (begin + end), along, points[:, 2])
    spread = np.maximum(1 + kind.height_spread * rng.normal(size=len(begin)), 0.3)
    loss = np.maximum(rng.normal(_LOSS_DB, _LOSS_SIGMA_DB, len(begin)), _LEAST_LOSS_DB)
    return Fronts(np.column_stack(ends).reshape(-1, 4), ground + kind.height_m * spread, loss)


def _blocks(length_m: float, kind: StreetClass, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Where blocks begin and end along a street, metres."""
    most = int(4 * length_m / (kind.block_m + kind.gap_m)) + 4
    block = kind.block_m * rng.uniform(0.5, 1.5, most)
    gap = kind.gap_m * rng.uniform(0.3, 1.7, most)
    begin = np.concatenate([[0.0], np.cumsum(block + gap)[:-1]]) + rng.uniform(0, kind.gap_m + 1e-9)
    inside = begin < length_m - 1.0
    return begin[inside], np.minimum(begin + block, length_m)[inside]


def fronts_of_town(town: Town, rng: np.random.Generator, everywhere: str | None = None) -> Fronts:
    """Fronts along a town's streets: urban in its middle, then industrial, then residential; motorways stand open.

    ``everywhere`` names the one class that all its streets have instead.
    """
    a, b = town.start, town.end
    x, y = town.node_x_m, town.node_y_m
    from_centre = np.hypot(0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b]))
    radius = float(np.quantile(from_centre, 0.95))
    highway = town.roads.highway.astype(str)
    built = ~(np.char.startswith(highway, "motorway") | town.roads.bridge | town.roads.tunnel)
    parts, roads = [], []
    for k in range(len(a)):
        count = max(2, int(np.ceil(town.length_m[k])) + 1)
        share = np.linspace(0, 1, count)
        line = np.column_stack(
            [
                x[a[k]] + share * (x[b[k]] - x[a[k]]),
                y[a[k]] + share * (y[b[k]] - y[a[k]]),
                town.road_height(np.full(count, k), share),
            ]
        )
        roads.append(line[:, :2])
        if built[k]:
            kind = STREETS[everywhere] if everywhere else _class_at(from_centre[k] / radius)
            parts.append(fronts_along(Route(line), kind, rng))
    return NO_FRONTS.joined(*parts).clear_of(np.concatenate(roads))


def _class_at(share: float) -> StreetClass:
    if share < _CENTRE_SHARE:
        return STREETS["urban"]
    return STREETS["industrial" if share < _EDGE_SHARE else "residential"]
