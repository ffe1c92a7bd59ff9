"""What stands for the INS in a log: a speed and a heading for every step, held for a while where they are missing.

The heading comes from a yaw sensor, from a gyroscope anchored to the course, or from the course itself, the best that
there is at each epoch. Headings are mathematical: from east, anticlockwise; a compass bearing b is pi/2 - b. Which
filter takes speed and heading, and as what, is not known here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.errors import MissingSensorError
from fusion.filters import kalman
from fusion.frames import wrap_angle
from fusion.messages import say
from fusion.published.epochs.table import Epochs
from fusion.published.gps_ins.filter import DriveReadings
from fusion.published.gps_ins.options import GpsInsOptions
from fusion.types import Floats

NEED = "speed (Doppler or odometer) and heading (yaw, gyroscope or Doppler course) beside the positions"
"""What the three methods need beside positions and heights, as they declare it."""

_SPEED_CHANGE_MPS2 = 1.5  # what a held speed may be off by, per second of age
_HEADING_CHANGE_RADPS = 0.2  # what a held heading may be off by, per second of age
_FREE_SPEED_MPS = 15.0  # spread of a speed of which nothing is known

_ANCHOR_SPEED_MPS = 3.0  # a course is good to about a degree or two from here on
_MIN_ANCHORS = 10  # courses that turn a yaw sensor
_DEFAULT_DOPPLER_SIGMA_MPS = 0.2  # accuracy of a Doppler velocity that states none
_LEAST_COURSE_SIGMA_RAD = 0.01  # a vehicle goes sideways by half a degree in bends

# The gyroscope of a phone or a receiver: white noise, and an offset that wanders.
_GYRO_NOISE_RAD = 0.01  # of the heading, per root second
_GYRO_BIAS_SIGMA_RADPS = 0.02  # of the offset at the start
_GYRO_BIAS_WALK_RADPS = 1e-4  # of the offset, per root second
_TURN_UNKNOWN_RADPS = 0.3  # a turn that nothing measures
_LOST_RAD = 0.3  # a heading less sure than this is none


@dataclass(frozen=True)
class Ins:
    """Speed and heading at n epochs, arrays of shape (n,).

    ``speed_mps`` is negative backwards; NaN where neither measured nor held, like ``heading_rad`` (from east,
    anticlockwise). ``speed_age_s`` and ``heading_age_s`` count the seconds since a value was measured.
    ``heading_share`` says at which share of the epochs each source gave the heading; ``heading_offset_rad`` by how
    much the yaw sensor was turned.
    """

    speed_mps: Floats
    speed_age_s: Floats
    heading_rad: Floats
    heading_sigma_rad: Floats
    heading_age_s: Floats
    heading_share: dict[str, float]
    heading_offset_rad: float


def read_ins(method: str, epochs: Epochs, options: GpsInsOptions) -> Ins:
    """The INS of a log. Raises ``MissingSensorError`` where there is no speed at all or no heading at all."""
    heading, sigma, share, offset = _heading(epochs, options)
    speed = _speed(epochs, heading)
    if not (np.isfinite(speed).any() and np.isfinite(heading).any()):
        raise MissingSensorError(say("method.needs_motion", method=method, need=NEED))
    standing = np.abs(np.nan_to_num(speed)) < options.min_speed_mps
    speed, speed_age = _held(speed, _elapsed(epochs), epochs.after_outage, options.hold_s)
    # A vehicle that stands does not turn: its heading does not age.
    moved_s = _elapsed(epochs, counts=~standing)
    held, heading_age = _held(heading, moved_s, epochs.after_outage, options.hold_s)
    sigma = np.where(np.isfinite(heading), sigma, options.heading_sigma_rad)
    sigma = np.hypot(sigma, _HEADING_CHANGE_RADPS * np.where(np.isfinite(held), heading_age, 0.0))
    return Ins(speed, speed_age, held, sigma, heading_age, share, offset)


def _heading(epochs: Epochs, options: GpsInsOptions) -> tuple[Floats, Floats, dict[str, float], float]:
    """The best source at each epoch, its sigma, each source's share, and the turn of the yaw sensor."""
    yaw, offset = yaw_heading(epochs, options.align_heading)
    by_course, course_sigma = course(epochs, options.min_speed_mps)
    stated = np.full(len(epochs), options.heading_sigma_rad)
    sources = {
        "yaw": (yaw, stated),
        "gyroscope": (gyro_heading(epochs), stated),
        "course": (by_course, course_sigma),
    }
    heading, sigma = np.full(len(epochs), np.nan), stated
    share = {}
    for name, (value, its_sigma) in sources.items():
        take = np.isnan(heading) & np.isfinite(value)
        heading, sigma = np.where(take, value, heading), np.where(take, its_sigma, sigma)
        share[name] = float(np.mean(take)) if len(epochs) else 0.0
    return heading, sigma, share, offset


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

    A misaligned sensor, or one that counts from where it was switched on, is off by one angle all along: the median of
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
        if epochs.after_outage[e]:
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
    noise = _GYRO_NOISE_RAD**2 * dt if known else (_TURN_UNKNOWN_RADPS * dt) ** 2
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
    innovation = math.remainder(course_rad - moments[0][0], math.tau)
    if abs(innovation) > math.pi / 2:
        innovation = math.remainder(innovation + math.pi, math.tau)
    return kalman.correct(
        *moments, np.array([innovation]), np.array([[1.0, 0.0]]), np.array([[sigma_rad**2]])
    )


def _speed(epochs: Epochs, heading_rad: Floats) -> Floats:
    """Doppler speed, negative where it points to the rear of the heading; else the vehicle's own."""
    along = epochs.vel_e_mps * np.cos(heading_rad) + epochs.vel_n_mps * np.sin(heading_rad)
    doppler = np.hypot(epochs.vel_e_mps, epochs.vel_n_mps)
    doppler = np.where((doppler > 1.0) & (along < 0), -doppler, doppler)
    return np.where(np.isfinite(doppler), doppler, epochs.odo_mps)


def _elapsed(epochs: Epochs, counts: NDArray[np.bool_] | None = None) -> Floats:
    """Seconds since the first epoch, of which only the steps that end at a counted epoch count."""
    step = np.diff(epochs.time_s, prepend=epochs.time_s[:1])
    total: Floats = np.cumsum(step if counts is None else np.where(counts, step, 0.0))
    return total


def _held(
    values: Floats, elapsed_s: Floats, restart: NDArray[np.bool_], hold_s: float
) -> tuple[Floats, Floats]:
    """Values with outages filled by the one before for up to ``hold_s``, and their ages; no further than a restart."""
    index = np.arange(len(values))
    last = np.maximum.accumulate(np.where(np.isfinite(values), index, -1))
    start = np.maximum.accumulate(np.where(restart, index, 0))
    there = last >= start
    age = elapsed_s - elapsed_s[np.where(there, last, start)]
    return np.where(there & (age <= hold_s), values[last], np.nan), age


def build_drive(epochs: Epochs, ins: Ins, options: GpsInsOptions) -> DriveReadings:
    """GPS and INS as the filter takes them: a command for the step from each epoch to the next."""
    speed, heading = ins.speed_mps, ins.heading_rad
    if options.command_at == "midpoint":
        speed, heading = _middle(speed), _middle_angle(heading)
    known = np.isfinite(speed) & np.isfinite(heading)
    return DriveReadings(
        time_s=epochs.time_s,
        x_m=epochs.x_m,
        y_m=epochs.y_m,
        fix_sigma_m=_fix_sigma(epochs, options),
        speed_mps=np.where(known, speed, 0.0),
        heading_rad=heading,
        heading_sigma_rad=ins.heading_sigma_rad,
        spread_m=_spread(epochs, ins),
        restart=epochs.after_outage,
    )


def _spread(epochs: Epochs, ins: Ins) -> Floats:
    """How far, per axis, a step may lead from where the INS says, because it says little or nothing.

    A held value is off by more the older it is. Of a vehicle that goes nobody knows how fast or where to only the way
    it can have made is known: that grows with time itself, so its variance must grow by more with every step.
    """
    step_s = np.append(np.diff(epochs.time_s), 0.0)
    has_speed, has_heading = np.isfinite(ins.speed_mps), np.isfinite(ins.heading_rad)
    pace = np.where(has_speed, np.abs(ins.speed_mps), _FREE_SPEED_MPS)
    turned = np.minimum(_HEADING_CHANGE_RADPS * ins.heading_age_s, 1.0)
    held = step_s * np.hypot(_SPEED_CHANGE_MPS2 * ins.speed_age_s, pace * turned)
    age_s = np.maximum(
        np.where(has_speed, 0.0, ins.speed_age_s), np.where(has_heading, 0.0, ins.heading_age_s)
    )
    free = pace * np.sqrt(step_s * (2 * age_s + step_s))
    spread: Floats = np.where(has_speed & has_heading, held, free)
    return spread


def _fix_sigma(epochs: Epochs, options: GpsInsOptions) -> Floats:
    """Per axis: the log's own accuracy, which is 2-D, where it states one."""
    stated = np.isfinite(epochs.h_acc_m) & (epochs.h_acc_m > 0)
    return np.where(stated, epochs.h_acc_m / np.sqrt(2), options.gnss_sigma_m)


def _middle(values: Floats) -> Floats:
    """Mean of each value and the next, the value itself at the end and where the next is missing."""
    following = np.append(values[1:], values[-1:])
    return np.where(np.isfinite(following), 0.5 * (values + following), values)


def _middle_angle(values: Floats) -> Floats:
    following = np.append(values[1:], values[-1:])
    half = 0.5 * wrap_angle(following - values)
    return np.where(np.isfinite(half), wrap_angle(values + half), values)
