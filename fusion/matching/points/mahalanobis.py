"""Positions to road segments.

Each position for itself: the Mahalanobis nearest (Al Assaad 2020, 2.3.3.3), ``match_points``. The drive as a
whole: ``DriveMatcher`` and ``match_drive``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion.roads.kernels import NOT_POSITIVE, nearest, nearest_each
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints

_COVARIANCE = "the covariance of a match must be finite and positive definite"

GATE = 2.55
"""The largest accepted Mahalanobis distance (2.31), on d and not on its square."""


@dataclass(frozen=True, slots=True)
class PointMatch:
    """One position on its segment.

    ``segment`` indexes the network; (x_m, y_m) is the matched point, ``distance_m`` its distance from
    from_node along the segment; ``heading_rad`` the segment's direction as it is driven (from east,
    anticlockwise, (-pi, pi]); ``forward`` whether that is the direction in which the way is drawn.
    """

    segment: int
    x_m: float
    y_m: float
    distance_m: float
    heading_rad: float
    mahalanobis: float
    forward: bool


@dataclass(frozen=True, eq=False)
class PointMatches:
    """The matches of n positions: columns as in ``PointMatch``, shape (n,).

    The segment is -1 and the numbers NaN where none passes.
    """

    segment: Ints
    x_m: Floats
    y_m: Floats
    distance_m: Floats
    heading_rad: Floats
    mahalanobis: Floats
    forward: NDArray[np.bool_]


def nearest_mahalanobis(
    network: RoadNetwork,
    x_m: float,
    y_m: float,
    heading_rad: float,
    covariance: Floats,
    gate: float = GATE,
    radius_m: float | None = None,
    *,
    use_heading: bool = True,
) -> PointMatch | None:
    """The candidate of least Mahalanobis distance over (x, y, heading), or None when none is within ``gate``.

    Every segment offers its point nearest to (x_m, y_m) (2.27) with its own direction, and with the opposite
    one unless it is one-way (2.28); heading differences are wrapped. ``covariance`` has shape (3, 3): m2,
    m rad, rad2. With a NaN heading or ``use_heading=False`` (stationary) only x and y count, and a two-way
    segment matches in the direction in which it is drawn. ``radius_m`` bounds the search; by default it is
    the gate times the largest standard deviation of the position, beyond which nothing can pass. Ties go to
    the lowest segment, forward first. Raises ``ValueError`` for a covariance that is not positive definite.
    """
    radius = -1.0 if radius_m is None else float(radius_m)
    heading = float(heading_rad) if use_heading else np.nan
    c = np.ascontiguousarray(covariance, np.float64)
    segment, x, y, distance, direction, d, forward = nearest(
        network.grid, float(x_m), float(y_m), heading, c, float(gate), radius
    )
    if segment >= 0:
        return PointMatch(segment, x, y, distance, direction, d, forward)
    if segment == NOT_POSITIVE:
        raise ValueError(_COVARIANCE)
    return None


def match_points(
    network: RoadNetwork,
    x_m: ArrayLike,
    y_m: ArrayLike,
    heading_rad: ArrayLike,
    covariance: ArrayLike,
    gate: float = GATE,
    radius_m: float | None = None,
) -> PointMatches:
    """``nearest_mahalanobis`` of n positions, each for itself.

    ``x_m``, ``y_m`` and ``heading_rad`` broadcast to shape (n,) (a NaN heading is not used, a NaN position
    not matched); ``covariance`` has shape (3, 3) or (n, 3, 3). Raises ``ValueError`` for a covariance that
    is not positive definite.
    """
    x, y, heading = np.broadcast_arrays(*(np.asarray(v, np.float64) for v in (x_m, y_m, heading_rad)))
    x, y, heading = (np.array(np.atleast_1d(v)) for v in (x, y, heading))
    c = np.array(np.broadcast_to(np.asarray(covariance, np.float64), (len(x), 3, 3)))
    radius = -1.0 if radius_m is None else float(radius_m)
    segment, columns, forward = nearest_each(network.grid, x, y, heading, c, float(gate), radius)
    if np.any(segment == NOT_POSITIVE):
        raise ValueError(_COVARIANCE)
    x, y, distance, direction, d = columns
    return PointMatches(segment, x, y, distance, direction, d, forward)
