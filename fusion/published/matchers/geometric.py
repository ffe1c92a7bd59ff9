"""Positions to segments, each for itself by distance and direction (Al Assaad 2020, 1.3.1.1 and 1.3.1.3).

Knows no covariance: that rule is ``mahalanobis``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fusion.compiled import compiled
from fusion.published.matchers.base import PointMatcher, PointMatches, Samples, placed
from fusion.roads.grid import SegmentGrid, project_point, segments_within
from fusion.roads.network import RoadNetwork
from fusion.types import Bools, Floats, Ints

_SAME_PLACE_M = 1e-6  # ends this close are one node: far above the rounding of projected coordinates


@dataclass(frozen=True)
class PointToPoint(PointMatcher):
    """The nearest node. A node has several segments, between which the rule cannot choose: of those that end
    there the one nearest to the position is given, if equally near the one that better fits the heading, then
    the lowest. The matched point is the node itself. ``radius_m``: no node farther than that is a match, m.
    """

    radius_m: float = math.inf

    name: ClassVar[str] = "point-to-point"
    description: ClassVar[str] = "the nearest node of the map"
    source: ClassVar[str] = "Al Assaad 2020, 1.3.1.1.1"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """Nothing but the network's index."""
        return _each_alone(network, nearest_nodes, self.radius_m)


@dataclass(frozen=True)
class PointToSegment(PointMatcher):
    """The segment with the nearest point: the foot of the perpendicular, or the nearer end where that falls
    outside. Ties go to the lowest segment. The heading has no say, but tells in which direction a two-way segment
    is driven. ``radius_m``: no segment farther than that is a match, m.
    """

    radius_m: float = math.inf

    name: ClassVar[str] = "point-to-segment"
    description: ClassVar[str] = "the segment at the least distance"
    source: ClassVar[str] = "Al Assaad 2020, 1.3.1.1.2"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """Nothing but the network's index."""
        return _each_alone(network, lightest_segments, 0.0, self.radius_m)


@dataclass(frozen=True)
class SegmentDirection(PointMatcher):
    """The segment of least weight d + turn_m (1 - cos a): d is the distance in metres, a the angle between the
    heading and the direction in which the segment may be driven; a one-way segment has one direction only. Without
    a heading this is the nearest segment. ``turn_m``: how many metres a right angle is worth; ``radius_m``: no
    segment farther than that is a match, m.
    """

    turn_m: float = 30.0
    radius_m: float = 50.0

    name: ClassVar[str] = "segment-direction"
    description: ClassVar[str] = "the segment of least weighted distance and difference of direction"
    source: ClassVar[str] = "Al Assaad 2020, 1.3.1.3 (weighting of distance and direction); Greenfeld 2002"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """Nothing but the network's index."""
        return _each_alone(network, lightest_segments, self.turn_m, self.radius_m)


def _each_alone(
    network: RoadNetwork, find: Callable[..., tuple[Ints, Floats, Bools]], *settings: float
) -> Callable[[Samples], PointMatches]:
    """A rule that needs the network's index alone; ``find`` gives segments, shares of them and directions."""
    grid = network.grid
    return lambda samples: placed(
        network, *find(grid, samples.x_m, samples.y_m, samples.heading_rad, *settings)
    )


@compiled
def _driven(grid: SegmentGrid, s: int, heading: float) -> tuple[float, bool]:
    """1 - cos of the angle between a heading and the better direction of a segment; whether that is forward.

    Without a heading the angle is 0; a segment of no length has no direction and is at a right angle to all.
    """
    dx, dy = grid.x1[s] - grid.x0[s], grid.y1[s] - grid.y0[s]
    length = math.hypot(dx, dy)
    if math.isnan(heading) or length == 0.0:
        return 0.0 if math.isnan(heading) else 1.0, grid.oneway[s] >= 0
    cosine = (dx * math.cos(heading) + dy * math.sin(heading)) / length
    forward = grid.oneway[s] > 0 or (grid.oneway[s] == 0 and cosine >= 0.0)
    return 1.0 - (cosine if forward else -cosine), forward


@compiled
def _lightest_within(
    grid: SegmentGrid, x: float, y: float, heading: float, turn_m: float, reach: float
) -> tuple[int, float]:
    """The segment of least weight among those within reach, and its weight; -1 for none."""
    best, least = -1, np.inf
    for s in segments_within(grid, x, y, reach):
        _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
        weight = math.sqrt((px - x) ** 2 + (py - y) ** 2)
        if weight > least:
            continue
        if turn_m > 0.0:
            weight += turn_m * _driven(grid, s, heading)[0]
        if weight < least:
            best, least = s, weight
    return best, least


@compiled
def lightest_segments(
    grid: SegmentGrid, x: Floats, y: Floats, heading: Floats, turn_m: float, radius_m: float
) -> tuple[Ints, Floats, Bools]:
    """Segment (-1: none), share of it and direction, for each position: see ``SegmentDirection``."""
    n = len(x)
    segment, share, forward = np.full(n, -1), np.full(n, np.nan), np.zeros(n, np.bool_)
    for i in range(n):
        if math.isnan(x[i]):
            continue
        reach = min(grid.cell_m, radius_m)
        best, least = _lightest_within(grid, x[i], y[i], heading[i], turn_m, reach)
        # No weight is less than the distance: what lies beyond the least weight found cannot be lighter.
        while least > reach and reach < radius_m:
            reach = min(2.0 * reach, radius_m)
            best, least = _lightest_within(grid, x[i], y[i], heading[i], turn_m, reach)
        if best >= 0:
            foot = project_point(grid.x0[best], grid.y0[best], grid.x1[best], grid.y1[best], x[i], y[i])
            segment[i], share[i], forward[i] = best, foot[0], _driven(grid, best, heading[i])[1]
    return segment, share, forward


@compiled
def _nearest_end(grid: SegmentGrid, x: float, y: float, reach: float) -> float:
    """Distance to the nearest end of a segment within reach, infinite for none."""
    least = np.inf
    for s in segments_within(grid, x, y, reach):
        d0, d1 = _ends(grid, s, x, y)
        least = min(least, d0, d1)
    return least if least <= reach else np.inf


@compiled
def _ends(grid: SegmentGrid, s: int, x: float, y: float) -> tuple[float, float]:
    """Distances from the two ends of a segment."""
    return math.hypot(grid.x0[s] - x, grid.y0[s] - y), math.hypot(grid.x1[s] - x, grid.y1[s] - y)


@compiled
def _best_at_node(
    grid: SegmentGrid, x: float, y: float, heading: float, distance: float
) -> tuple[int, float, bool]:
    """Of the segments that end at this distance the best: see ``PointToPoint``."""
    best, share, forward = -1, 0.0, False
    nearest, angle = np.inf, np.inf
    for s in segments_within(grid, x, y, distance + 2 * _SAME_PLACE_M):
        d0, d1 = _ends(grid, s, x, y)
        if min(d0, d1) > distance + _SAME_PLACE_M:
            continue
        _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
        d = math.hypot(px - x, py - y)
        a, onward = _driven(grid, s, heading)
        nearer, as_near = d < nearest - _SAME_PLACE_M, d <= nearest + _SAME_PLACE_M
        if nearer or (as_near and a < angle):
            best, nearest, angle, forward = s, d, a, onward
            share = 0.0 if d0 <= d1 else 1.0
    return best, share, forward


@compiled
def nearest_nodes(
    grid: SegmentGrid, x: Floats, y: Floats, heading: Floats, radius_m: float
) -> tuple[Ints, Floats, Bools]:
    """Segment (-1: none), which end of it (0 or 1) and direction, for each position: see ``PointToPoint``."""
    n = len(x)
    segment, share, forward = np.full(n, -1), np.full(n, np.nan), np.zeros(n, np.bool_)
    for i in range(n):
        if math.isnan(x[i]):
            continue
        reach = min(grid.cell_m, radius_m)
        least = _nearest_end(grid, x[i], y[i], reach)
        while least > reach and reach < radius_m:
            reach = min(2.0 * reach, radius_m)
            least = _nearest_end(grid, x[i], y[i], reach)
        if math.isfinite(least):
            segment[i], share[i], forward[i] = _best_at_node(grid, x[i], y[i], heading[i], least)
    return segment, share, forward
