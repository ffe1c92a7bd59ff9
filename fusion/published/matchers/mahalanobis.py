"""Positions to segments, each for itself by the least Mahalanobis distance (Al Assaad 2020, 2.3.3.3).

``Mahalanobis`` is the rule with fixed spreads, for comparison with the other matchers; ``nearest_mahalanobis`` and
``match_points`` take the covariance that a filter has at the moment, and ``nearest_segment`` is for loops that are
compiled themselves. Knows nothing of the positions before and after.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion.compiled import compiled
from fusion.published.matchers.base import PointMatch, PointMatcher, PointMatches, Samples
from fusion.roads.grid import SegmentGrid, project_point, segments_within
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints

GATE = 2.55
"""The largest accepted Mahalanobis distance (2.31), on d and not on its square."""

NOT_POSITIVE = -2
"""Stands for a segment where the covariance is not positive definite."""

_COVARIANCE = "the covariance of a match must be finite and positive definite"


@dataclass(frozen=True)
class Mahalanobis(PointMatcher):
    """``match_points``: the least Mahalanobis distance over x, y and heading. ``sigma_m`` and ``sigma_rad``: standard
    deviations of each coordinate, m, and of the heading, rad; ``gate``: the largest accepted distance.
    """

    sigma_m: float = 10.0
    sigma_rad: float = 0.3
    gate: float = GATE

    name: ClassVar[str] = "mahalanobis"
    description: ClassVar[str] = "the least Mahalanobis distance over position and heading, within a gate"
    source: ClassVar[str] = "Al Assaad 2020, 2.3.3.3"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """Nothing but the network's index."""
        _ = network.grid
        covariance = np.diag([self.sigma_m**2, self.sigma_m**2, self.sigma_rad**2])

        def found(samples: Samples) -> PointMatches:
            return match_points(network, samples.x_m, samples.y_m, samples.heading_rad, covariance, self.gate)

        return found


def nearest_mahalanobis(
    network: RoadNetwork, x_m: float, y_m: float, heading_rad: float, covariance: Floats, gate: float = GATE
) -> PointMatch | None:
    """The candidate of least Mahalanobis distance over (x, y, heading), or None when none is within ``gate``.

    Every segment offers its point nearest to (x_m, y_m) (2.27) with its own direction, and with the opposite
    one unless it is one-way (2.28); heading differences are wrapped. ``covariance`` has shape (3, 3): m2,
    m rad, rad2. With a NaN heading (stationary) only x and y count, and a two-way segment matches in the
    direction in which it is drawn. Ties go to the lowest segment, forward first. Raises ``ValueError`` for a
    covariance that is not positive definite.
    """
    c = np.ascontiguousarray(covariance, np.float64)
    match = nearest_segment(network.grid, float(x_m), float(y_m), float(heading_rad), c, float(gate))
    if match.segment == NOT_POSITIVE:
        raise ValueError(_COVARIANCE)
    return match if match.segment >= 0 else None


def match_points(
    network: RoadNetwork,
    x_m: ArrayLike,
    y_m: ArrayLike,
    heading_rad: ArrayLike,
    covariance: ArrayLike,
    gate: float = GATE,
) -> PointMatches:
    """``nearest_mahalanobis`` of n positions, each for itself.

    ``x_m``, ``y_m`` and ``heading_rad`` broadcast to shape (n,) (a NaN heading is not used, a NaN position
    not matched); ``covariance`` has shape (3, 3) or (n, 3, 3). Raises ``ValueError`` for a covariance that
    is not positive definite.
    """
    x, y, heading = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (x_m, y_m, heading_rad)))
    x, y, heading = (np.array(np.atleast_1d(v)) for v in (x, y, heading))
    c = np.array(np.broadcast_to(np.asarray(covariance, np.float64), (len(x), 3, 3)))
    segment, columns, forward = nearest_segments(network.grid, x, y, heading, c, float(gate))
    if np.any(segment == NOT_POSITIVE):
        raise ValueError(_COVARIANCE)
    x, y, distance, direction, d = columns
    return PointMatches(segment, x, y, distance, direction, d, forward)


@compiled
def nearest_segment(
    grid: SegmentGrid, x: float, y: float, heading: float, c: Floats, gate: float
) -> PointMatch:
    """See ``nearest_mahalanobis``; the segment is -1 for none, or NOT_POSITIVE."""
    heading = heading if np.isfinite(heading) else np.nan
    p = _invert(c, not np.isnan(heading))
    if not (p.positive and np.isfinite(x) and np.isfinite(y)):
        return _nowhere(-1 if p.positive else NOT_POSITIVE)
    best, best_d2, best_forward = -1, gate * gate, False
    for s in segments_within(grid, x, y, _reach(c, gate)):
        _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
        dx, dy = px - x, py - y
        d2 = p.xx * dx * dx + 2 * p.xy * dx * dy + p.yy * dy * dy
        added, forward = _best_direction(grid, s, heading, p.xh * dx + p.yh * dy, p.hh)
        d2 += added
        if d2 < best_d2 or (d2 == best_d2 and best < 0):
            best, best_d2, best_forward = s, d2, forward
    if best < 0:
        return _nowhere(-1)
    share, px, py = project_point(grid.x0[best], grid.y0[best], grid.x1[best], grid.y1[best], x, y)
    length = np.hypot(grid.x1[best] - grid.x0[best], grid.y1[best] - grid.y0[best])
    angle = _direction(grid, best, best_forward)
    return PointMatch(best, px, py, share * length, angle, np.sqrt(max(best_d2, 0.0)), best_forward)


@compiled
def _nowhere(segment: int) -> PointMatch:
    return PointMatch(segment, np.nan, np.nan, np.nan, np.nan, np.nan, False)


@compiled
def nearest_segments(
    grid: SegmentGrid, x: Floats, y: Floats, heading: Floats, c: Floats, gate: float
) -> tuple[Ints, Floats, NDArray[np.bool_]]:
    """``nearest_segment`` of n positions: segments, the five columns of numbers (5, n), whether forward."""
    n = len(x)
    segment, columns, forward = np.empty(n, np.int64), np.empty((5, n)), np.empty(n, np.bool_)
    for i in range(n):
        match = nearest_segment(grid, x[i], y[i], heading[i], c[i], gate)
        segment[i], columns[:, i], forward[i] = match.segment, match[1:6], match.forward
    return segment, columns, forward


@compiled
def _best_direction(grid: SegmentGrid, s: int, heading: float, cross: float, hh: float) -> tuple[float, bool]:
    """What the heading adds to d squared at the better of the directions in which s may be driven."""
    if np.isnan(heading):
        return 0.0, grid.oneway[s] >= 0
    added = np.empty(2)
    for turn in range(2):
        dh = _wrap(_direction(grid, s, turn == 0) - heading)
        added[turn] = 2 * dh * cross + hh * dh * dh
    if grid.oneway[s] > 0 or (grid.oneway[s] == 0 and added[0] <= added[1]):
        return added[0], True
    return added[1], False


@compiled
def _direction(grid: SegmentGrid, s: int, forward: bool) -> float:
    """The heading along a segment, in or against the direction in which it is drawn."""
    theta = math.atan2(grid.y1[s] - grid.y0[s], grid.x1[s] - grid.x0[s])
    return _wrap(theta if forward else theta + math.pi)


@compiled
def _wrap(angle: float) -> float:
    """To (-pi, pi]."""
    return angle - 2 * math.pi * math.ceil((angle - math.pi) / (2 * math.pi))


@compiled
def _reach(c: Floats, gate: float) -> float:
    """Gate times the largest standard deviation of x, y: the position's part alone is a lower bound of d."""
    mean = (c[0, 0] + c[1, 1]) / 2
    return gate * math.sqrt(mean + math.hypot((c[0, 0] - c[1, 1]) / 2, c[0, 1])) * (1 + 1e-9)


class _Precision(NamedTuple):
    """The inverse of a covariance over x, y, heading; not positive definite: nothing else counts."""

    positive: bool
    xx: float
    xy: float
    yy: float
    xh: float
    yh: float
    hh: float


@compiled
def _invert(c: Floats, with_heading: bool) -> _Precision:
    """Invert a 3 x 3 covariance, or its x, y block where the heading does not count."""
    minor = c[0, 0] * c[1, 1] - c[0, 1] * c[0, 1]
    if not (c[0, 0] > 0 and minor > 0 and np.isfinite(minor)):
        return _Precision(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if not with_heading:
        return _Precision(True, c[1, 1] / minor, -c[0, 1] / minor, c[0, 0] / minor, 0.0, 0.0, 0.0)
    xh = c[0, 1] * c[1, 2] - c[1, 1] * c[0, 2]
    yh = c[0, 1] * c[0, 2] - c[0, 0] * c[1, 2]
    det = c[0, 2] * xh + c[1, 2] * yh + c[2, 2] * minor
    if not (det > 0 and np.isfinite(det)):
        return _Precision(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    xx = (c[1, 1] * c[2, 2] - c[1, 2] * c[1, 2]) / det
    yy = (c[0, 0] * c[2, 2] - c[0, 2] * c[0, 2]) / det
    xy = (c[0, 2] * c[1, 2] - c[0, 1] * c[2, 2]) / det
    return _Precision(True, xx, xy, yy, xh / det, yh / det, minor / det)
