"""The heading of the vehicle out of what a log has: a yaw sensor, a gyroscope anchored to the course, the course.

Headings are mathematical: from east, anticlockwise. A compass bearing b is pi/2 - b.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.filters import kalman
from fusion.frames import wrap_angle
from fusion.methods.epochs.table import Epochs
from fusion.types import Floats

_ANCHOR_SPEED_MPS = 3.0  # a course is good to about a degree or two from here on
_MIN_ANCHORS = 10
_DEFAULT_DOPPLER_SIGMA_MPS = 0.2
_LEAST_COURSE_SIGMA_RAD = 0.01  # a vehicle goes sideways by half a degree in bends

# The gyroscope of a phone or a receiver: noise, and an offset that wanders by a hundredth of itself a minute.
_GYRO_NOISE_RADPS = 0.01
_GYRO_BIAS_SIGMA_RADPS = 0.02
_GYRO_BIAS_WALK_RADPS = 1e-4
_TURN_UNKNOWN_RADPS = 0.3
_LOST_RAD = 0.3


def course(epochs: Epochs, min_speed_mps: float) -> tuple[Floats, Floats]:
    """Direction of the Doppler velocity and its sigma, rad, shape (n,); NaN below ``min_speed_mps``."""
    speed = np.hypot(epochs.vel_e_mps, epochs.vel_n_mps)
    moving = speed >= max(min_speed_mps, 1e-9)
    angle = np.where(moving, np.arctan2(epochs.vel_n_mps, epochs.vel_e_mps), np.nan)
    doppler = np.where(epochs.s_acc_mps > 0, epochs.s_acc_mps, _DEFAULT_DOPPLER_SIGMA_MPS)
    sigma = np.hypot(doppler / np.where(moving, speed, np.nan), _LEAST_COURSE_SIGMA_RAD)
    return angle, sigma


def yaw_heading(epochs: Epochs, align: bool) -> tuple[Floats, float]:
    """The yaw sensor as a heading, shape (n,), and by how much it was turned to meet the course, rad.

    A sensor that sits askew, or counts from where it was switched on, is off by one angle all along: the median of
    course minus yaw over the drive. Too few courses, or ``align`` False, leave it as it is.
    """
    yaw = wrap_angle(np.pi / 2 - epochs.yaw_rad)
    excess = course(epochs, _ANCHOR_SPEED_MPS)[0] - yaw
    excess = excess[np.isfinite(excess)]
    if not align or len(excess) < _MIN_ANCHORS:
        return yaw, 0.0
    middle = float(np.angle(np.mean(np.exp(1j * excess))))
    offset = float(wrap_angle(np.asarray(middle + np.median(wrap_angle(excess - middle)))))
    return wrap_angle(yaw + offset), offset


def gyro_heading(epochs: Epochs) -> Floats:
    """The gyroscope's turns added up and anchored to the course, shape (n,); NaN before a first course.

    A Kalman filter of two states, the heading and the gyroscope's offset. NaN where both have been missing for long.
    """
    out = np.full(len(epochs), np.nan)
    if not np.isfinite(epochs.turn_radps).any():
        return out
    anchor, sigma = course(epochs, _ANCHOR_SPEED_MPS)
    moments: tuple[Floats, Floats] | None = None
    for e in range(len(epochs)):
        if epochs.after_gap[e]:
            moments = None
        if moments is not None:
            moments = _turned(epochs, e, moments)
        moments = _anchored(moments, float(anchor[e]), float(sigma[e]))
        if moments is not None and moments[1][0, 0] < _LOST_RAD**2:
            out[e] = math.remainder(float(moments[0][0]), math.tau)
    return out


def _turned(epochs: Epochs, e: int, moments: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """From the epoch before to ``e`` by the mean of the rates at both."""
    dt = float(epochs.time_s[e] - epochs.time_s[e - 1])
    rate = 0.5 * float(epochs.turn_radps[e - 1] + epochs.turn_radps[e])
    known = math.isfinite(rate)
    noise = _GYRO_NOISE_RADPS**2 * dt if known else (_TURN_UNKNOWN_RADPS * dt) ** 2
    mean, covariance = kalman.predict(
        *moments, np.array([[1.0, -dt], [0.0, 1.0]]), np.diag([noise, _GYRO_BIAS_WALK_RADPS**2 * dt])
    )
    return mean + np.array([rate * dt if known else 0.0, 0.0]), covariance


def _anchored(
    moments: tuple[Floats, Floats] | None, course_rad: float, sigma_rad: float
) -> tuple[Floats, Floats] | None:
    """Corrected by a course, the first of which begins the heading; a course to the rear is that of reverse gear."""
    if not math.isfinite(course_rad):
        return moments
    if moments is None:
        return np.array([course_rad, 0.0]), np.diag([sigma_rad**2, _GYRO_BIAS_SIGMA_RADPS**2])
    residual = math.remainder(course_rad - moments[0][0], math.tau)
    if abs(residual) > math.pi / 2:
        residual = math.remainder(residual + math.pi, math.tau)
    return kalman.correct(*moments, np.array([residual]), np.array([[1.0, 0.0]]), np.array([[sigma_rad**2]]))
