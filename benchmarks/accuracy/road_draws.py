"""Roads drawn from the very model that the network believes in, and a map that has them a little elsewhere.

The grade is a random walk along the road, with a change of its own at each node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.network.joints import couplings
from fusion.network.segment_slopes import PLACE_SIGMA_M
from fusion.roads.table import RoadTable
from fusion.types import Floats

LENGTHS_M = (5.0, 300.0)
ROUGHNESS_PER_M = (1e-6, 1e-4)
TURN_DEG = 3.0
"""One sigma of the turn at a node, on the half of the roads that turn."""
STEEPEST = 0.35
"""A road that becomes steeper anywhere is drawn anew: sensors of slopes are not used on far steeper ones."""
PLANE = LocalProjection(8.5, 49.0)
_STEP_M = 0.5
_SHORTEST_M = 1.0
"""A map whose nodes would lie closer together on the road, or in another order, is drawn anew."""


@dataclass(frozen=True, eq=False)
class DrawnRoad:
    """A road of n segments whose grade is linear on each of m short steps.

    ``table`` has the segments in order; ``node_m`` (n + 1,) and ``node_xy_m`` (n + 1, 2): where the map has its
    nodes, along it and in the plane; ``true_node_m`` (n + 1,): where they are. ``step_m``, ``height_m``,
    ``grade`` and ``bend`` (m,): where steps begin, height and grade there, and the change of grade per metre.
    """

    table: RoadTable
    node_m: Floats
    true_node_m: Floats
    node_xy_m: Floats
    step_m: Floats
    height_m: Floats
    grade: Floats
    bend: Floats
    roughness: float

    def height_and_grade(self, along_m: Floats) -> tuple[Floats, Floats]:
        """The road's height (m) and grade at distances along it."""
        k = np.clip(np.searchsorted(self.step_m, along_m, side="right") - 1, 0, len(self.step_m) - 1)
        d = along_m - self.step_m[k]
        height = self.height_m[k] + d * self.grade[k] + 0.5 * d**2 * self.bend[k]
        return height, self.grade[k] + d * self.bend[k]

    def slopes_percent(self) -> Floats:
        """For each segment the slope of the regression of height on distance between where its nodes are, percent."""
        nodes, weights = np.polynomial.legendre.leggauss(3)
        bounds = np.union1d(np.append(self.step_m, self.node_m[-1]), self.true_node_m)
        bounds = bounds[(bounds >= self.true_node_m[0]) & (bounds <= self.true_node_m[-1])]
        half, middle = 0.5 * np.diff(bounds), 0.5 * (bounds[1:] + bounds[:-1])
        along = middle[:, None] + half[:, None] * nodes  # exact: heights are parabolas on each step
        height, _ = self.height_and_grade(along.ravel())
        segment = np.searchsorted(self.true_node_m, middle, side="right") - 1
        centre = 0.5 * (self.true_node_m[1:] + self.true_node_m[:-1])
        moment = np.sum(
            height.reshape(along.shape) * (along - centre[segment, None]) * half[:, None] * weights, axis=1
        )
        length = np.diff(self.true_node_m)
        return np.asarray(100 * np.bincount(segment, moment) * 12 / length**3)


def draw_road(rng: np.random.Generator, segments: int) -> DrawnRoad:
    """A straight or gently turning road of one way, without junctions."""
    while True:
        road = _road(rng, segments)
        if np.max(np.abs(road.grade)) <= STEEPEST:
            return road


def _road(rng: np.random.Generator, segments: int) -> DrawnRoad:
    length = log_uniform(rng, LENGTHS_M, segments)
    turns = rng.random() < 0.5
    heading = rng.uniform(0, 2 * np.pi) + turns * np.cumsum(np.radians(TURN_DEG) * rng.normal(size=segments))
    step = length[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    place -= 0.5 * (place.min(axis=0) + place.max(axis=0))
    table = _table(place)
    roughness = float(log_uniform(rng, ROUGHNESS_PER_M))
    node = np.concatenate([[0.0], np.cumsum(table.length_m)])
    counts = np.ceil(table.length_m / _STEP_M).astype(np.int64)
    parts = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(node[:-1], node[1:], counts, strict=True)
    ]
    width = np.repeat(table.length_m / counts, counts)
    inside = np.sqrt(roughness * width) * rng.normal(size=len(width))
    change = np.zeros(len(width))
    change[np.cumsum(counts)[:-1]] = couplings(table).sigma * rng.normal(size=segments - 1)
    start = 0.03 * rng.normal()
    grade = start + np.cumsum(change) + np.concatenate([[0.0], np.cumsum(inside)[:-1]])
    climb = width * (grade + 0.5 * inside)
    height = 200.0 + np.concatenate([[0.0], np.cumsum(climb)[:-1]])
    true = _misplaced(rng, node)
    return DrawnRoad(
        table, node, true, place, np.concatenate(parts), height, grade, inside / width, roughness
    )


def _misplaced(rng: np.random.Generator, node_m: Floats) -> Floats:
    """Where the nodes of a map are, of which it is believed how well it knows them."""
    true = node_m + PLACE_SIGMA_M * rng.normal(size=len(node_m))
    while len(near := np.flatnonzero(np.diff(true) < _SHORTEST_M)):
        again = np.union1d(near, near + 1)
        true[again] = node_m[again] + PLACE_SIGMA_M * rng.normal(size=len(again))
    return np.asarray(true)


def _table(place_m: Floats) -> RoadTable:
    n = len(place_m)
    return road_through(*PLANE.to_lonlat(place_m[:, 0], place_m[:, 1]), np.ones(n - 1), np.arange(1, n + 1))


def road_through(lon_deg: Floats, lat_deg: Floats, osm_way_id: ArrayLike, node: ArrayLike) -> RoadTable:
    """A road from place to place (n,), open to both sides, without bridges and tunnels.

    ``osm_way_id`` (n - 1,) are the ways of its segments, ``node`` (n,) the numbers of its nodes.
    """
    n, node = len(lon_deg) - 1, np.asarray(node)
    return RoadTable.from_columns(
        osm_way_id=osm_way_id,
        from_node=node[:-1],
        to_node=node[1:],
        lon0_deg=lon_deg[:-1],
        lat0_deg=lat_deg[:-1],
        lon1_deg=lon_deg[1:],
        lat1_deg=lat_deg[1:],
        oneway=np.zeros(n),
        bridge=np.zeros(n, bool),
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n),
        highway=["residential"] * n,
        name=[None] * n,
    )


def log_uniform(rng: np.random.Generator, bounds: tuple[float, float], size: int | None = None) -> Floats:
    """Numbers whose logs are uniform between the bounds'."""
    return np.asarray(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), size)))
