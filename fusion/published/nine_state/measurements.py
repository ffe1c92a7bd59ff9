"""Measurement functions of the nine states with their Jacobians, and what a Gaussian state says in their terms.

Functions of a state (9,): heading atan2(vy, vx) of (7) and (2.14), pitch atan(vz / |v|) of (3.14), and the height
z - H / cos(pitch) of the ground of (2.17). Near standstill angles have no derivative; below ``SLOWEST_MPS`` they are
taken as if the vehicle moved that fast. How sure a sensor is of what it measures is not known here.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.published.nine_state.motion import STATES, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.published.nine_state.protocol import Estimate, PredictedMap
from fusion.types import Floats

SLOWEST_MPS = 0.5  # 1.8 km/h

_STEEPEST = math.tan(STEEPEST_RAD)


@compiled
def heading_measurement(state: Floats) -> tuple[float, Floats]:
    """Direction of travel, radians from east, and its derivative (9,)."""
    vx, vy = state[VX], state[VY]
    square = max(vx * vx + vy * vy, SLOWEST_MPS**2)
    row = np.zeros(STATES)
    row[VX], row[VY] = -vy / square, vx / square
    return math.atan2(vy, vx), row


@compiled
def pitch_measurement(state: Floats) -> tuple[float, Floats]:
    """Pitch of the way travelled, radians, and its derivative (9,)."""
    vx, vy, vz = state[VX], state[VY], state[VZ]
    speed = math.hypot(vx, vy)
    along = max(speed, SLOWEST_MPS)
    square = along * along + vz * vz
    row = np.zeros(STATES)
    row[VZ] = along / square
    if speed > SLOWEST_MPS:
        row[VX], row[VY] = -vz * vx / (along * square), -vz * vy / (along * square)
    return math.atan(vz / along), row


@compiled
def ground_measurement(state: Floats, antenna_m: float) -> tuple[float, Floats]:
    """Height of the road under an antenna ``antenna_m`` above it, metres, and its derivative (9,)."""
    pitch, row = pitch_measurement(state)
    steep = min(max(pitch, -STEEPEST_RAD), STEEPEST_RAD)
    lift = antenna_m / math.cos(steep)
    row *= -lift * math.tan(steep) if steep == pitch else 0.0
    row[Z] = 1.0
    return state[Z] - lift, row


@compiled
def map_covariance(covariance: Floats, heading: Floats) -> Floats:
    """Covariance (3, 3) of x, y, heading, of which ``heading`` (9,) is the derivative."""
    out = np.empty((3, 3))
    out[0, 0], out[1, 1], out[0, 1] = covariance[X, X], covariance[Y, Y], covariance[X, Y]
    out[0, 2], out[1, 2], out[2, 2] = 0.0, 0.0, 0.0
    for a in range(STATES):
        out[0, 2] += covariance[X, a] * heading[a]
        out[1, 2] += covariance[Y, a] * heading[a]
        for b in range(STATES):
            out[2, 2] += heading[a] * covariance[a, b] * heading[b]
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
    return out


@compiled
def attitude_and_spreads(state: Floats, covariance: Floats) -> tuple[float, float, float, float]:
    """Pitch and its sigma, radians; sigma of the position in the plane and of the height, metres: to first order."""
    pitch, row = pitch_measurement(state)
    variance = 0.0
    for a in range(STATES):
        for b in range(STATES):
            variance += row[a] * covariance[a, b] * row[b]
    return (
        pitch,
        math.sqrt(max(variance, 0.0)),
        math.sqrt(max(covariance[X, X] + covariance[Y, Y], 0.0)),
        math.sqrt(max(covariance[Z, Z], 0.0)),
    )


def predicted_map(state: Floats, covariance: Floats) -> PredictedMap:
    """What a map match starts from, to first order."""
    heading, row = heading_measurement(state)
    return PredictedMap(float(state[X]), float(state[Y]), heading, map_covariance(covariance, row))


def gaussian_estimate(state: Floats, covariance: Floats) -> Estimate:
    """The estimate of a filter whose posterior is Gaussian, to first order."""
    pitch, pitch_sigma, h_sigma, z_sigma = attitude_and_spreads(state, covariance)
    return Estimate(state.copy(), math.atan2(state[VY], state[VX]), pitch, pitch_sigma, h_sigma, z_sigma)
