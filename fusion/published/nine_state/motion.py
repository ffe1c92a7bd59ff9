"""The nine-state model that Al Assaad (2.1)-(2.6) and Lahrech et al. (1) share, and the rules that follow from it.

The state is (ax, vx, x, ay, vy, y, az, vz, z): acceleration, velocity and position along east, north and up, SI units.
Each axis moves by itself, a' = a + w_a, v' = v + a dt + w_v, u' = u + v dt + w_u. First come the matrices F and Q of
that; then what every run over a drive must agree on, compiled or not: which fixes can't be where the vehicle is, and
how much a sample counts whose error hangs together with that of the last one.

It knows no sensor and no filter.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.published.nine_state.options import NineStateOptions
from fusion.types import Floats

AX, VX, X, AY, VY, Y, AZ, VZ, Z = range(9)
STATES = 9

STEEPEST_RAD = 0.35
"""No road is steeper (36 %); while a vehicle stands, vz / v may say anything."""

SHORTEST_WAY_M = 0.1
"""A vehicle that stands goes this far between two epochs, so that the terrain's weight stays finite."""

OUTLIERS_BEFORE_RESTART = 3
"""So many fixes in a row that can't be where the vehicle is: it is the filter that is lost."""

_OUTLIER_SIGMAS = 6.0
"""A fix further than this from where the vehicle is predicted to be, by both sigmas together, is left out."""


def half_rate(options: NineStateOptions) -> float:
    """What acceleration adds to the position row, per dt^2: nothing as printed, 1/2 in the exact discretisation."""
    return 0.5 if options.discretisation == "exact" else 0.0


def half_square(options: NineStateOptions, dt_s: float) -> float:
    """What acceleration adds to the position row over ``dt_s``."""
    return half_rate(options) * dt_s * dt_s


def transition(options: NineStateOptions, dt_s: float) -> Floats:
    """The matrix F over ``dt_s``, shape (9, 9)."""
    return transition_matrix(dt_s, half_square(options, dt_s))


@compiled
def transition_matrix(dt_s: float, half_dt2: float) -> Floats:
    """The matrix F over ``dt_s``, shape (9, 9), for compiled loops; ``half_dt2`` is ``half_square``."""
    F = np.eye(STATES)
    for a in range(0, STATES, 3):
        F[a + 1, a] = F[a + 2, a + 1] = dt_s
        F[a + 2, a] = half_dt2
    return F


def process_noise_rates(options: NineStateOptions) -> Floats:
    """Variances that each state gains per second, shape (9,); Q over ``dt_s`` is their diagonal times ``dt_s``."""
    o = options
    horizontal = [o.sigma_acc_mps2, o.sigma_vel_mps, o.sigma_pos_m]
    vertical = [o.sigma_acc_up_mps2, o.sigma_vel_up_mps, o.sigma_pos_up_m]
    rates: Floats = np.array([*horizontal, *horizontal, *vertical]) ** 2
    return rates


@compiled
def fix_fits(fix: Floats, fix_sigma: Floats, state: Floats, spread: tuple[float, float], dt_s: float) -> bool:
    """Whether a fix can be where the vehicle is by now.

    ``fix`` (3,) is x, y, altitude or NaN, metres, and ``fix_sigma`` (2,) its horizontal and vertical sigma; ``state``
    (9,) and ``spread`` (horizontal, vertical) are the estimate of ``dt_s`` seconds ago. The vehicle may have
    accelerated by 6 m/s2 in the plane and 2 m/s2 upwards since.
    """
    x, y = state[X] + state[VX] * dt_s, state[Y] + state[VY] * dt_s
    gate = _OUTLIER_SIGMAS * math.hypot(fix_sigma[0], spread[0]) + 3.0 * dt_s * dt_s
    if not math.hypot(fix[0] - x, fix[1] - y) <= gate:
        return False
    miss = abs(fix[2] - state[Z] - state[VZ] * dt_s)
    return math.isnan(miss) or miss <= _OUTLIER_SIGMAS * math.hypot(fix_sigma[1], spread[1]) + dt_s * dt_s


@compiled
def whitened(variance: float, step: float, correlation: float) -> float:
    """Variance of a sample ``step`` after the last one, such that samples whose errors hang together over
    ``correlation`` (of the same unit) may be taken as independent."""
    return variance * (1.0 + 2.0 * correlation / step)
