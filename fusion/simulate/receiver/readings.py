"""What a receiver reads of the truth: satellite positions, Doppler velocity, inertial sensors, a speed signal.

Knows the truth and the errors' sizes; knows no road and no file.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from fusion.frames import GRAVITY_MPS2, body_to_ned
from fusion.simulate.motion.vehicle import MotionState
from fusion.simulate.receiver.profiles import Mounting, ReceiverProfile
from fusion.types import Floats


@dataclass(frozen=True)
class GnssReadings:
    """Antenna positions (metres on the town's plane, height above EGM96) and Doppler velocity (NED)."""

    x_m: Floats
    y_m: Floats
    alt_msl_m: Floats
    velocity_ned_mps: Floats


def observe_gnss(
    state: MotionState,
    interval_s: float,
    antenna_m: float,
    profile: ReceiverProfile,
    mounting: Mounting,
    rng: np.random.Generator,
) -> GnssReadings:
    """GNSS readings at equally spaced instants; the antenna is ``antenna_m`` above the road."""
    n, p = len(state.time_s), profile
    side = p.horizontal_m / np.sqrt(2)
    east, north = (
        gauss_markov(n, interval_s, side, p.horizontal_s, rng) + p.horizontal_white_m * rng.normal(size=n)
        for _ in range(2)
    )
    up = gauss_markov(n, interval_s, p.vertical_m, p.vertical_s, rng) + p.vertical_white_m * rng.normal(
        size=n
    )
    sigma = np.array([p.doppler_mps, p.doppler_mps, p.doppler_vertical_mps])
    velocity = state.velocity_mps[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    return GnssReadings(
        x_m=state.x_m + east,
        y_m=state.y_m + north,
        alt_msl_m=state.z_m + antenna_m + mounting.height_bias_m + up,
        velocity_ned_mps=velocity + sigma * rng.normal(size=(n, 3)),
    )


def gauss_markov(
    count: int, interval_s: float, sigma: float, time_constant_s: float, rng: np.random.Generator
) -> Floats:
    """A stationary first-order Gauss-Markov sequence, shape (count,)."""
    a = float(np.exp(-interval_s / time_constant_s))
    drive = rng.normal(size=count) * sigma * np.sqrt(1 - a * a)
    drive[:1] = rng.normal() * sigma
    return np.array(list(accumulate(drive.tolist(), lambda before, new: new + a * before)))


@dataclass(frozen=True)
class InertialReadings:
    """Specific force and angular rate (x forward, y left, z up; shape (n, 3)), attitude, speed signal."""

    force_mps2: Floats
    rate_radps: Floats
    roll_rad: Floats
    pitch_rad: Floats
    yaw_rad: Floats
    odo_speed_mps: Floats


def observe_inertial(
    state: MotionState, profile: ReceiverProfile, mounting: Mounting, rng: np.random.Generator
) -> InertialReadings:
    """Inertial readings: the sensor is pitched by the mount against the body, which moves on springs."""
    n, p = len(state.time_s), profile
    pitch = state.pitch_rad + mounting.pitch_rad
    rotation = body_to_ned(state.roll_rad, pitch, state.yaw_rad)
    ned = state.acceleration_mps2[:, [1, 0, 2]] * np.array([1.0, 1.0, -1.0])
    ned[:, 2] -= GRAVITY_MPS2
    force = np.einsum("nji,nj->ni", rotation, ned) * np.array([1.0, -1.0, -1.0])
    odo = state.speed_mps * mounting.odo_scale + p.odo_mps * rng.normal(size=n)
    return InertialReadings(
        force_mps2=force + mounting.acc_bias_mps2 + p.acc_mps2 * rng.normal(size=(n, 3)),
        rate_radps=_body_rates(state, pitch)
        + mounting.gyro_bias_radps
        + np.radians(p.gyro_dps) * rng.normal(size=(n, 3)),
        roll_rad=state.roll_rad,
        pitch_rad=pitch + np.radians(p.pitch_deg) * rng.normal(size=n),
        yaw_rad=state.yaw_rad,
        odo_speed_mps=np.maximum(0.0, odo),
    )


def _body_rates(state: MotionState, pitch_rad: Floats) -> Floats:
    """Angular rates in the sensor's frame (x forward, y left, z up) from those of roll, pitch, yaw (ZYX)."""
    sin_roll, cos_roll = np.sin(state.roll_rad), np.cos(state.roll_rad)
    sin_pitch, cos_pitch = np.sin(pitch_rad), np.cos(pitch_rad)
    about_x = state.roll_rate_radps - state.yaw_rate_radps * sin_pitch
    about_right = state.pitch_rate_radps * cos_roll + state.yaw_rate_radps * sin_roll * cos_pitch
    about_down = -state.pitch_rate_radps * sin_roll + state.yaw_rate_radps * cos_roll * cos_pitch
    return np.column_stack([about_x, -about_right, -about_down])
