"""Velocities from Doppler alone, epoch by epoch: nothing is smoothed, so that their errors are independent in time.

Slope methods weigh a vertical velocity as one measurement an epoch; one that a filter had smoothed would be counted
many times over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.gnss.measurements import Measurements
from fusion.types import Bools, Floats, Ints

NOISE_MPS = 0.2
"""Usual error of a range rate at high C/N0 (notes 6)."""
LEAST_SIGMA_MPS = 0.05
"""No velocity by Doppler of single epochs is better, whatever the residuals of few rows say."""
UNKNOWNS = 4
ROUNDS = 8
WORST_CONDITION = 1e4
"""Sights that lie nearly in a plane tell nothing across it."""


class DopplerVelocities(NamedTuple):
    """Of (m,) epochs: velocity (m, 3) and covariance (m, 3, 3) in ECEF, NaN where there is none."""

    velocity_mps: Floats
    covariance: Floats


def doppler_velocities(measured: Measurements, position_m: Floats) -> DopplerVelocities:
    """Velocities at places (m, 3), ECEF; robust against single wrong rates (Cauchy weights about the solution).

    An epoch needs four rates with sights in all directions, and a place.
    """
    epoch = measured.epoch
    place = position_m[epoch]
    usable = np.isfinite(measured.range_rate_mps) & np.isfinite(place).all(axis=1)
    usable &= np.isfinite(measured.satellite_mps).all(axis=1)
    epoch, m = epoch[usable], len(measured)
    sight = measured.satellite_m[usable] - place[usable]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    # (satellite velocity - user velocity) . sight + drift = rate: what is left is linear in velocity and drift.
    projected_mps = (
        np.einsum("ni,ni->n", measured.satellite_mps[usable], sight) - measured.range_rate_mps[usable]
    )
    rows = np.column_stack([sight, -np.ones(len(sight))])
    solvable = _solvable(rows, epoch, m)
    state = np.full((m, UNKNOWNS), np.nan)
    weight = np.ones(len(projected_mps))
    normal, residual = np.zeros((m, UNKNOWNS, UNKNOWNS)), np.zeros(len(projected_mps))
    for _ in range(ROUNDS):
        normal = _sums(weight[:, None, None] * rows[:, :, None] * rows[:, None, :], epoch, m)
        right = _sums((weight * projected_mps)[:, None] * rows, epoch, m)
        state[solvable] = np.linalg.solve(normal[solvable], right[solvable, :, None])[..., 0]
        residual = np.nan_to_num(projected_mps - np.einsum("nk,nk->n", rows, state[epoch]))
        weight = 1.0 / (1.0 + (residual / NOISE_MPS) ** 2)
    covariance = np.full((m, 3, 3), np.nan)
    if solvable.any():
        spread = _spread(residual, weight, epoch, m)[solvable, None, None]
        covariance[solvable] = (np.linalg.inv(normal[solvable]) * spread)[:, :3, :3]
    return DopplerVelocities(state[:, :3], covariance)


def _sums(values: Floats, epoch: Ints, m: int) -> Floats:
    """Sums over the rows of each epoch, (m, ...)."""
    out = np.zeros((m, *values.shape[1:]))
    np.add.at(out, epoch, values)
    return out


def _solvable(rows: Floats, epoch: Ints, m: int) -> Bools:
    normal = _sums(rows[:, :, None] * rows[:, None, :], epoch, m)
    enough = np.bincount(epoch, minlength=m) >= UNKNOWNS
    value = np.linalg.eigvalsh(normal)
    return np.asarray(enough & (value[:, 0] * WORST_CONDITION > value[:, -1]))


def _spread(residual: Floats, weight: Floats, epoch: Ints, m: int) -> Floats:
    """Variance of one rate, (m,): the usual one as a prior of four rows, and what the epoch's residuals say."""
    squares = np.bincount(epoch, weights=weight * residual**2, minlength=m)
    free = np.maximum(np.bincount(epoch, weights=weight, minlength=m) - UNKNOWNS, 0.0)
    variance: Floats = (UNKNOWNS * NOISE_MPS**2 + squares) / (UNKNOWNS + free)
    return np.maximum(variance, LEAST_SIGMA_MPS**2)
