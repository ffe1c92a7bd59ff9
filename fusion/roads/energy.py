"""Energy that a vehicle takes for a path of known slopes at constant speed, with the sigma that their errors give it.

The balance of forces on a piece of road of length l and slope s, a = atan s, mass m, speed v:

    F = m g (sin a + c_r cos a) + rho A v^2 / 2        at the wheels (c_r rolling resistance, A drag area)

The source (battery, tank, legs) gives F l / eta where F > 0, and takes back r eta F l where F < 0, with efficiency
eta and regeneration r; and the auxiliaries' power for the time l / v. So a steep way down gives less back than the way
up took, and with r = 0 nothing: brakes make heat of it.

Slopes are known with errors, Gaussian ones. Near F = 0 the energy has a bend in s, so its mean is not that of the mean
slope. With F ~ N(f, t^2), t = m g sigma_s, Phi and phi of the normal distribution and k = 1/eta - r eta:

    mean  l [r eta f + k (f Phi(f/t) + t phi(f/t))]
    mean of the first derivative   l [r eta + k Phi(f/t)],      of the second   l k phi(f/t) / t
    covariance of pieces i, j      d1_i d1_j C_ij + d2_i d2_j C_ij^2 / 2        (C of the forces)

the first terms of the expansion in Hermite polynomials, without the first of which sigma is half wrong on level roads.

C holds the covariance of slopes along the path. One segment has one error. Errors of measured segments that follow each
other hang together over ``TOGETHER_M``, those of others not at all. On simulated networks (60 and 8 drives over 116 km,
mixed receivers) errors of rises over 50 m to 6 km were then 0.3 to 1.0 of what is stated; as independent errors would
have them they were 1.5 times as large over 100 m. So sigma is on the safe side for long paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from fusion.arrays import ColumnTable
from fusion.types import Bools, Floats, Ints

GRAVITY_MPS2 = 9.81
AIR_KGPM3 = 1.2
J_PER_KWH = 3.6e6
TOGETHER_M = 50.0
"""Along a path, over which errors of the slopes of measured segments hang together."""
_NOTHING_N = 1e-9
"""Smaller errors of forces are none."""
REACH = 12.0
"""Pieces farther apart than so many ``TOGETHER_M`` are independent: exp(-12) is nothing."""


@dataclass(frozen=True)
class Vehicle:
    """What the balance needs; see the module. All are above 0 but what may be none of."""

    mass_kg: float
    drag_area_m2: float
    """Drag coefficient times frontal area."""
    rolling: float
    efficiency: float
    """Of what the source gives, the share that is at the wheels, (0, 1]."""
    regeneration: float
    """Of what brakes would take, the share that goes back through the same losses, 0..1."""
    auxiliary_w: float
    speed_kmh: float


VEHICLES: Mapping[str, Vehicle] = MappingProxyType(
    {
        "electric-car": Vehicle(1800.0, 0.62, 0.010, 0.88, 0.85, 500.0, 50.0),
        "electric-van": Vehicle(3000.0, 1.60, 0.010, 0.86, 0.80, 700.0, 50.0),
        "electric-truck": Vehicle(40_000.0, 5.4, 0.0055, 0.86, 0.80, 4000.0, 60.0),
        "e-bike": Vehicle(105.0, 0.55, 0.007, 0.75, 0.0, 5.0, 20.0),
        "car": Vehicle(1500.0, 0.65, 0.012, 0.25, 0.0, 500.0, 50.0),
        "truck": Vehicle(40_000.0, 6.0, 0.006, 0.40, 0.0, 4000.0, 60.0),
    }
)
"""Usual ones, round numbers; those with engines in energy of fuel."""


@dataclass(frozen=True, eq=False)
class Pieces(ColumnTable):
    """n pieces of a path in its order; columns (n,). ``slope`` is a ratio, upwards in its direction, NaN unknown.

    ``sigma``: one standard deviation of it. ``segment``: pieces with equal numbers that follow each other have one
    error. ``measured``: by drives.
    """

    length_m: Floats
    slope: Floats
    sigma: Floats
    segment: Ints
    measured: Bools


@dataclass(frozen=True)
class Energy:
    """What the path takes from the source, kWh, with one standard deviation; negative where it gives more back."""

    kwh: float
    sigma_kwh: float


def forces_n(vehicle: Vehicle, slope: ArrayLike) -> Floats:
    """At the wheels, at constant speed, on slopes (any shape); negative where brakes hold."""
    angle = np.arctan(np.asarray(slope, float))
    drag = 0.5 * AIR_KGPM3 * vehicle.drag_area_m2 * (vehicle.speed_kmh / 3.6) ** 2
    weight = vehicle.mass_kg * GRAVITY_MPS2
    return np.asarray(weight * (np.sin(angle) + vehicle.rolling * np.cos(angle)) + drag)


def energy_along(vehicle: Vehicle, pieces: Pieces) -> Energy:
    """What a path takes. Pieces whose slope is unknown count as level, without an error: say how much is known."""
    slope = np.nan_to_num(pieces.slope)
    sigma = np.where(np.isfinite(pieces.slope), np.nan_to_num(pieces.sigma), 0.0)
    mean, first, second = _expanded(vehicle, slope, sigma)
    seconds = float(pieces.length_m.sum()) / (vehicle.speed_kmh / 3.6)
    joules = float(pieces.length_m @ mean) + vehicle.auxiliary_w * seconds
    spread = vehicle.mass_kg * GRAVITY_MPS2 * sigma
    variance = _variance(pieces, pieces.length_m * first, pieces.length_m * second, spread)
    return Energy(joules / J_PER_KWH, float(np.sqrt(variance)) / J_PER_KWH)


def _expanded(vehicle: Vehicle, slope: Floats, sigma: Floats) -> tuple[Floats, Floats, Floats]:
    """Of the source's force (n,): its mean, and the means of its first and second derivatives by that at the wheels."""
    back = vehicle.regeneration * vehicle.efficiency
    bend = 1 / vehicle.efficiency - back
    f, t = forces_n(vehicle, slope), vehicle.mass_kg * GRAVITY_MPS2 * sigma
    known = t > _NOTHING_N
    z = np.clip(f / np.maximum(t, _NOTHING_N), -40.0, 40.0)
    below, density = _normal(z)
    mean = back * f + bend * np.where(known, f * below + t * density, np.maximum(f, 0.0))
    second = np.where(known, bend * density / np.where(known, t, 1.0), 0.0)
    return mean, back + bend * below, second


def _normal(z: Floats) -> tuple[Floats, Floats]:
    """The normal distribution and its density (n,)."""
    from scipy.special import ndtr  # noqa: PLC0415 - slow to load

    return np.asarray(ndtr(z)), np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)


def _variance(pieces: Pieces, first: Floats, second: Floats, spread: Floats) -> float:
    """Of the sum of all pieces: ``first`` and ``second`` (n,) times their errors, whose sigmas are ``spread``."""
    run, place = _runs(pieces)
    total = 0.0
    n = len(run)
    for lag in range(n):
        i, j = np.arange(n - lag), np.arange(lag, n)
        apart = place[run[j]] - place[run[i]]
        one, close = run[i] == run[j], apart < REACH * TOGETHER_M
        if not (one | close).any():
            break
        near = one | (close & pieces.measured[i] & pieces.measured[j])
        i, j, apart = i[near], j[near], apart[near]
        c = spread[i] * spread[j] * np.exp(-apart / TOGETHER_M)
        total += (2.0 if lag else 1.0) * float(
            (first[i] * first[j] * c + second[i] * second[j] * c * c / 2).sum()
        )
    return max(total, 0.0)


def _runs(pieces: Pieces) -> tuple[Ints, Floats]:
    """Which run of pieces of one segment each belongs to (n,), and where along the path the middle of each run is."""
    change = np.r_[True, pieces.segment[1:] != pieces.segment[:-1]][: len(pieces)]
    run = np.cumsum(change) - 1
    end = np.cumsum(pieces.length_m)
    length = np.bincount(run, pieces.length_m)
    middle = np.bincount(run, pieces.length_m * (end - pieces.length_m / 2)) / np.maximum(length, 1e-9)
    return run, np.asarray(middle)
