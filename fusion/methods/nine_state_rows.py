"""Measurement functions of the nine-state model with their Jacobians, and what a Gaussian state says in their terms.

Functions of a state (9,): heading atan2(vy, vx) of (7) and (2.14), pitch atan(vz / |v|) of (3.14), and the height
z - H / cos(pitch) of the ground of (2.17). Near standstill angles have no derivative; below ``SLOWEST_MPS`` rows are
taken as if the vehicle moved that fast.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.methods.epoch_filter import Estimate, PredictedMap
from fusion.methods.kinematics import STATES, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.types import Floats

SLOWEST_MPS = 0.5

_STEEPEST = math.tan(STEEPEST_RAD)


@compiled
def heading_row(state: Floats) -> tuple[float, Floats]:
    """Direction of travel, radians from east, and its derivative (9,)."""
    vx, vy = state[VX], state[VY]
    square = max(vx * vx + vy * vy, SLOWEST_MPS**2)
    row = np.zeros(STATES)
    row[VX], row[VY] = -vy / square, vx / square
    return math.atan2(vy, vx), row


@compiled
def pitch_row(state: Floats) -> tuple[float, Floats]:
    """Pitch of the way travelled, radians, and its derivative (9,)."""
    vx, vy, vz = state[VX], state[VY], state[VZ]
    along = max(math.hypot(vx, vy), SLOWEST_MPS)
    square = along * along + vz * vz
    row = np.zeros(STATES)
    row[VX], row[VY], row[VZ] = -vz * vx / (along * square), -vz * vy / (along * square), along / square
    return math.atan(vz / along), row


@compiled
def ground_row(state: Floats, antenna_m: float) -> tuple[float, Floats]:
    """Height of the road under an antenna ``antenna_m`` above it, metres, and its derivative (9,)."""
    pitch, row = pitch_row(state)
    steep = min(max(pitch, -STEEPEST_RAD), STEEPEST_RAD)
    lift = antenna_m / math.cos(steep)
    row *= -lift * math.tan(steep) if steep == pitch else 0.0
    row[Z] = 1.0
    return state[Z] - lift, row


def map_rows(state: Floats) -> tuple[Floats, Floats]:
    """(x, y, heading) and its Jacobian, shapes (3,) and (3, 9)."""
    heading, row = heading_row(state)
    design = np.zeros((3, STATES))
    design[0, X] = design[1, Y] = 1.0
    design[2] = row
    return np.array([state[X], state[Y], heading]), design


def predicted_map(state: Floats, covariance: Floats) -> PredictedMap:
    """What a map match starts from, to first order."""
    at, design = map_rows(state)
    return PredictedMap(float(at[0]), float(at[1]), float(at[2]), design @ covariance @ design.T)


def gaussian_estimate(state: Floats, covariance: Floats) -> Estimate:
    """The estimate of a filter whose posterior is Gaussian, to first order."""
    pitch, row = pitch_row(state)
    return Estimate(
        state=state.copy(),
        heading_rad=math.atan2(state[VY], state[VX]),
        pitch_rad=pitch,
        pitch_sigma_rad=math.sqrt(max(float(row @ covariance @ row), 0.0)),
        h_sigma_m=math.sqrt(max(float(covariance[X, X] + covariance[Y, Y]), 0.0)),
        z_sigma_m=math.sqrt(max(float(covariance[Z, Z]), 0.0)),
    )
