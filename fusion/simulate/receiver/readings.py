"""What a receiver reads of the truth: satellite positions, Doppler velocity, inertial sensors, a speed signal.

How large the errors of consumer receivers are, by name, which of them one drive has throughout, and what they do to the
truth. Knows no road and no file.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from fusion.frames import GRAVITY_MPS2, body_to_ned
from fusion.registry import Registry
from fusion.simulate.motion.vehicle import MotionState
from fusion.types import Floats


@dataclass(frozen=True)
class ReceiverProfile:
    """One sigma of every error. Correlated GNSS errors are first-order Gauss-Markov in time.

    ``horizontal_m`` is the 2-D figure, split evenly between east and north; ``vertical_bias_m``,
    ``mount_deg``, ``acc_bias_mps2``, ``gyro_bias_dps`` and ``odo_scale`` are drawn once per drive, the
    ``..._white`` and all other figures once per sample. ``h_acc_m`` and ``v_acc_m`` are what the receiver
    states. ``springs`` scales the suspension (see ``vehicle.move``).
    """

    horizontal_m: float
    horizontal_s: float
    horizontal_white_m: float
    vertical_m: float
    vertical_s: float
    vertical_white_m: float
    vertical_bias_m: float
    doppler_mps: float
    doppler_vertical_mps: float
    pitch_deg: float
    mount_deg: float
    acc_mps2: float
    acc_bias_mps2: float
    gyro_dps: float
    gyro_bias_dps: float
    odo_mps: float
    odo_scale: float
    h_acc_m: float
    v_acc_m: float
    springs: float = 1.0

    @property
    def s_acc_mps(self) -> float:
        """The speed accuracy that the receiver states."""
        return float(np.hypot(self.doppler_mps, self.doppler_vertical_mps))

    @property
    def pitch_acc_deg(self) -> float:
        """The pitch accuracy that the receiver states: its noise, and half a degree that it cannot know."""
        return float(np.hypot(self.pitch_deg, 0.5))


RECEIVERS: Registry[ReceiverProfile] = Registry("receiver")
_NAMES = ("m8", "m8u", "phone", "f9p", "perfect")
_FIGURES = {
    "horizontal_m": (1.5, 2.0, 4.0, 0.3, 0.0),
    "horizontal_s": (100.0, 300.0, 60.0, 200.0, 1.0),
    "horizontal_white_m": (0.3, 0.3, 1.0, 0.05, 0.0),
    "vertical_m": (3.0, 1.2, 6.0, 0.5, 0.0),
    "vertical_s": (120.0, 60.0, 60.0, 200.0, 1.0),
    "vertical_white_m": (0.5, 0.6, 1.5, 0.1, 0.0),
    "vertical_bias_m": (2.0, 2.5, 4.0, 0.3, 0.0),
    "doppler_mps": (0.05, 0.05, 0.2, 0.02, 0.0),
    "doppler_vertical_mps": (0.1, 0.1, 0.4, 0.04, 0.0),
    "pitch_deg": (0.2, 0.2, 0.8, 0.1, 0.0),
    "mount_deg": (1.5, 1.5, 3.0, 0.5, 0.0),
    "acc_mps2": (0.05, 0.05, 0.15, 0.02, 0.0),
    "acc_bias_mps2": (0.05, 0.05, 0.2, 0.02, 0.0),
    "gyro_dps": (0.1, 0.1, 0.3, 0.05, 0.0),
    "gyro_bias_dps": (0.2, 0.2, 0.5, 0.1, 0.0),
    "odo_mps": (0.05, 0.05, 0.05, 0.05, 0.0),
    "odo_scale": (0.01, 0.01, 0.01, 0.01, 0.0),
    "h_acc_m": (2.0, 2.0, 5.0, 0.4, 0.01),
    "v_acc_m": (3.5, 3.0, 8.0, 0.6, 0.01),
    "springs": (1.0, 1.0, 1.0, 1.0, 0.0),
}
"""Figures by receiver. ``m8u`` is an EVK-M8U under an open sky.

Its data sheet promises 2.5 m horizontally (half of the fixes, autonomous) and 0.05 m/s; over a day the vertical error
is about 1.4 times the horizontal one. What part of it changes within ten minutes follows from the error budget in Al
Assaad's thesis (table 1.1): multipath of 0.5 to 1 m and receiver noise of 0.25 to 0.5 m in a range, times a vertical
dilution of 1.6. Orbits, clocks and the atmosphere change over hours and are a bias here.
"""
for _column, _name in enumerate(_NAMES):
    RECEIVERS.add(_name, ReceiverProfile(**{error: figures[_column] for error, figures in _FIGURES.items()}))


@dataclass(frozen=True)
class Mounting:
    """What stays the same during one drive: how the sensor sits and what its readings are off by."""

    pitch_rad: float
    acc_bias_mps2: Floats
    gyro_bias_radps: Floats
    odo_scale: float
    height_bias_m: float

    @classmethod
    def draw(cls, profile: ReceiverProfile, rng: np.random.Generator) -> Mounting:
        """Draw one drive's mounting."""
        return cls(
            pitch_rad=float(np.radians(profile.mount_deg) * rng.normal()),
            acc_bias_mps2=profile.acc_bias_mps2 * rng.normal(size=3),
            gyro_bias_radps=np.radians(profile.gyro_bias_dps) * rng.normal(size=3),
            odo_scale=1.0 + profile.odo_scale * float(rng.normal()),
            height_bias_m=profile.vertical_bias_m * float(rng.normal()),
        )


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
    up = gauss_markov(n, interval_s, p.vertical_m, p.vertical_s, rng)
    up = up + p.vertical_white_m * rng.normal(size=n)
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
