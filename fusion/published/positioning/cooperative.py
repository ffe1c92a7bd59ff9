"""Co-operative positioning among vehicles: places of neighbours and ranges to them mend one that reflections spoil.

As described by Drawil (in Saadaoui 2011, 2.2.4).

The survey gives neither the objective nor what the classifier is fed. Here reflections are told by C/N0 as elsewhere
(``fusion.gnss.reception``), and the place is the most likely one by the vehicle's own estimate, the neighbours' and the
ranges, which count less the farther they are off. The result is not fed back: neighbours would count their own data.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.types import Bools, Floats, Ints

MOST_NEIGHBOURS = 4
"""Of the neighbours those whose places are surest."""
FEWEST_NEIGHBOURS = 2
TOLERATED_SIGMAS = 2.0
"""A range that is farther off counts less, in proportion (Huber)."""
_STEPS = 10
_LEAST_M = 1e-3


class Neighbours(NamedTuple):
    """n vehicles in radio range: places (n, 2) on a plane with their sigmas (n,) along one axis, and measured distances
    (n,) with their sigma, m."""

    place_m: Floats
    sigma_m: Floats
    range_m: Floats
    range_sigma_m: float


def refined(place_m: Floats, covariance_m2: Floats, neighbours: Neighbours) -> Floats:
    """The most likely place (2,) by one's own estimate with its covariance (2, 2) and the ranges to neighbours.

    With fewer than ``FEWEST_NEIGHBOURS`` it is one's own.
    """
    if len(neighbours.range_m) < FEWEST_NEIGHBOURS:
        return place_m
    best = np.argsort(neighbours.sigma_m, kind="stable")[:MOST_NEIGHBOURS]
    known, measured = neighbours.place_m[best], neighbours.range_m[best]
    sigma = np.hypot(neighbours.sigma_m[best], neighbours.range_sigma_m)
    own, at = np.linalg.inv(covariance_m2), place_m.astype(float)
    for _ in range(_STEPS):
        away = at - known
        distance = np.maximum(np.linalg.norm(away, axis=1), _LEAST_M)
        sight, off = away / distance[:, None], (measured - distance) / sigma
        weight = np.minimum(1.0, TOLERATED_SIGMAS / np.maximum(np.abs(off), 1e-9)) / sigma**2
        normal = own + (sight * weight[:, None]).T @ sight
        change = np.linalg.solve(normal, own @ (place_m - at) + sight.T @ (weight * (measured - distance)))
        at = at + change
        if np.linalg.norm(change) < _LEAST_M:
            break
    return np.asarray(at)


def contaminated(reflected: Bools, first: Ints) -> Bools:
    """Epochs (m,) of which a quarter of the satellites or more is received by reflections; rows (n,) are satellites'.

    ``first`` (m + 1,): where each epoch's rows begin.
    """
    total, count = np.concatenate([[0], np.cumsum(reflected)]), np.diff(first)
    return np.asarray((total[first[1:]] - total[first[:-1]] >= 0.25 * count) & (count > 0))
