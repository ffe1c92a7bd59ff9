"""Rules that every run over epochs follows, whether it goes step by step or in a compiled loop."""

from __future__ import annotations

import math

from fusion.compiled import compiled
from fusion.methods.kinematics import VX, VY, VZ, X, Y, Z
from fusion.types import Floats

OUTLIER_SIGMAS = 6.0

OUTLIERS_BEFORE_RESTART = 3
"""So many fixes in a row that can't be where the vehicle is: it is the filter that is lost."""

SHORTEST_WAY_M = 0.1
"""A vehicle that stands goes this far between two epochs, for the terrain's sake."""


@compiled
def whitened(variance: float, step: float, correlation: float) -> float:
    """Variance of a sample ``step`` after the last one, such that samples whose errors hang together over
    ``correlation`` (of the same unit) may be taken as independent."""
    return variance * (1.0 + 2.0 * correlation / step)


@compiled
def fix_fits(
    fix: tuple[float, float, float],
    fix_sigma: tuple[float, float],
    state: Floats,
    spread: tuple[float, float],
    dt_s: float,
) -> bool:
    """Whether a fix can be where the vehicle is by now.

    ``fix`` is (x, y, altitude or NaN), metres, with its horizontal and vertical sigmas; ``state`` (9,) and ``spread``
    (horizontal, vertical) are the estimate of ``dt_s`` seconds ago.
    """
    x, y = state[X] + state[VX] * dt_s, state[Y] + state[VY] * dt_s
    gate = OUTLIER_SIGMAS * math.hypot(fix_sigma[0], spread[0]) + 3.0 * dt_s * dt_s
    if not math.hypot(fix[0] - x, fix[1] - y) <= gate:
        return False
    miss = abs(fix[2] - state[Z] - state[VZ] * dt_s)
    return math.isnan(miss) or miss <= OUTLIER_SIGMAS * math.hypot(fix_sigma[1], spread[1]) + dt_s * dt_s
