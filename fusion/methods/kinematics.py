"""The nine-state model that Al Assaad (2.1)-(2.6) and Lahrech et al. (1) share: how a vehicle moves between epochs.

The state is (ax, vx, x, ay, vy, y, az, vz, z): acceleration, velocity and position along east, north and up, SI units.
Each axis moves by itself, a' = a + w_a, v' = v + a dt + w_v, u' = u + v dt + w_u.
"""

from __future__ import annotations

import numpy as np

from fusion.methods.epoch_options import EpochOptions
from fusion.types import Floats

AX, VX, X, AY, VY, Y, AZ, VZ, Z = range(9)
STATES = 9

STEEPEST_RAD = 0.35
"""No road is steeper; while a vehicle stands, vz / v may say anything."""


def half_square(options: EpochOptions, dt_s: float) -> float:
    """What acceleration adds to the position row: nothing as printed, dt^2 / 2 in the exact discretisation."""
    return 0.5 * dt_s * dt_s if options.discretisation == "exact" else 0.0


def transition(options: EpochOptions, dt_s: float) -> Floats:
    """The matrix F over ``dt_s``, shape (9, 9)."""
    axis = np.array([[1.0, 0.0, 0.0], [dt_s, 1.0, 0.0], [half_square(options, dt_s), dt_s, 1.0]])
    out: Floats = np.kron(np.eye(3), axis)
    return out


def noise_rates(options: EpochOptions) -> Floats:
    """Variances that each state gains per second, shape (3, 3): axis by (acceleration, velocity, position)."""
    o = options
    horizontal = [o.sigma_acc_mps2, o.sigma_vel_mps, o.sigma_pos_m]
    vertical = [o.sigma_acc_up_mps2, o.sigma_vel_up_mps, o.sigma_pos_up_m]
    rates: Floats = np.array([horizontal, horizontal, vertical]) ** 2
    return rates
