"""The height beside the thesis's plane: a scalar Kalman filter, ours, the same for the three methods.

The thesis is two-dimensional. Its idea carries over: what the INS says is the command, here the climb along the
road, and what GPS says is the measurement, here the altitude (or the terrain's where a log has none).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.filters import kalman
from fusion.published.epochs.levelling import MountPitch
from fusion.published.epochs.table import MAD_TO_SIGMA, Epochs, white_altitude_sigma
from fusion.published.gps_ins.options import GpsInsOptions
from fusion.types import Floats

_UNKNOWN_GRADE = 0.06  # spread of road grades, where nothing says how steep the road is
_UNKNOWN_SPEED_MPS = (
    15.0  # of a vehicle whose speed nothing says; the spread of its climb, with the grade above
)
_STANDING_CLIMB_MPS = 0.02  # one sigma of the climb of a vehicle that stands
_START_SIGMA_M = 0.5  # the receiver's own datum is kept, slopes need no other
_GATE_SIGMAS = 5.0  # a height further off than this is left out
_MIN_SCATTER = 20  # second differences of pitch from which its noise can be told

_ONE = np.eye(1)


@dataclass(frozen=True)
class Climb:
    """Vertical velocity at n epochs, m/s, arrays of shape (n,), finite; ``known`` where that is
    more than a guess."""

    rate_mps: Floats
    sigma_mps: Floats
    known: NDArray[np.bool_]


@dataclass(frozen=True)
class HeightReadings:
    """Measured heights at n epochs, arrays of shape (n,): NaN where none.

    ``sigma_m`` is the weight in the filter, in which errors that hang together count for less; ``gate_m`` what a single
    height may be off by, one sigma. ``slow_m`` is an error that the filter's own variance does not hold.
    """

    height_m: Floats
    sigma_m: Floats
    gate_m: Floats
    slow_m: Floats


@dataclass(frozen=True)
class Heights:
    """Estimated heights at n epochs, arrays of shape (n,): NaN before the first; ``starts`` where they begin anew."""

    height_m: Floats
    sigma_m: Floats
    starts: NDArray[np.bool_]
    gated: NDArray[np.bool_]


def climb_rate(epochs: Epochs, speed_mps: Floats, mount: MountPitch, options: GpsInsOptions) -> Climb:
    """Pitch times speed and vertical Doppler velocity by inverse variance; none of either is a level road, vaguely.

    ``speed_mps`` (n,) is the ground speed, NaN where unknown. A vehicle that stands does not climb.
    """
    speed = np.where(np.isfinite(speed_mps), np.abs(speed_mps), _UNKNOWN_SPEED_MPS)
    moving = speed >= options.min_speed_mps
    by_pitch = np.where(np.isfinite(speed_mps), speed * np.tan(epochs.pitch_rad - mount.angle_rad), np.nan)
    pitch_sigma = _pitch_sigma(epochs, moving, options)
    doppler_sigma = np.where(epochs.s_acc_mps > 0, epochs.s_acc_mps, options.doppler_sigma_mps)
    rates = np.array([by_pitch, epochs.vel_u_mps])
    sigmas = np.array([np.maximum(speed, options.min_speed_mps) * pitch_sigma, doppler_sigma])
    used = np.array([options.climb in ("all", "pitch"), options.climb in ("all", "doppler")])
    weight = np.where(np.isfinite(rates) & used[:, None], sigmas**-2.0, 0.0)
    total = weight.sum(axis=0)
    known = total > 0
    rate = np.sum(weight * np.nan_to_num(rates), axis=0) / np.where(known, total, 1.0)
    sigma = np.where(known, 1 / np.sqrt(np.where(known, total, 1.0)), _UNKNOWN_GRADE * speed)
    return Climb(np.where(moving, rate, 0.0), np.where(moving, sigma, _STANDING_CLIMB_MPS), known | ~moving)


def _pitch_sigma(epochs: Epochs, moving: NDArray[np.bool_], options: GpsInsOptions) -> Floats:
    """The sensor's stated accuracy and the body's motion; unstated, the scatter of the drive's own pitches."""
    second = np.diff(np.where(moving, epochs.pitch_rad, np.nan), 2)
    second = second[np.isfinite(second)]
    scatter = 0.0
    if len(second) >= _MIN_SCATTER:
        scatter = MAD_TO_SIGMA * float(np.median(np.abs(second))) / math.sqrt(6)
    stated = np.hypot(epochs.pitch_acc_rad, options.pitch_sigma_rad)
    return np.where(np.isfinite(stated), stated, max(scatter, options.pitch_sigma_rad))


def gnss_heights(epochs: Epochs, climb: Climb, options: GpsInsOptions) -> HeightReadings:
    """The receiver's altitudes.

    Their errors hang together for minutes. Where a sensor measures the climb, they are weighted down for that; where
    none does, the road is what the altitudes say, and only their white noise is filtered.
    """
    stated = np.where(epochs.v_acc_m > 0, epochs.v_acc_m, options.gnss_v_sigma_m)
    white = np.full(len(epochs), white_altitude_sigma(epochs))
    since_s = np.maximum(_since_known(epochs.time_s, epochs.alt_m), options.period_s)
    counted = stated * np.sqrt(1 + 2 * options.altitude_correlation_s / since_s)
    slow = np.sqrt(np.maximum(stated**2 - white**2, 0.0))
    return HeightReadings(
        height_m=epochs.alt_m,
        sigma_m=np.where(climb.known, counted, white),
        gate_m=np.hypot(stated, white),
        slow_m=np.where(climb.known, 0.0, slow),
    )


def _since_known(time_s: Floats, values: Floats) -> Floats:
    """Seconds since the epoch before at which there was a value; since the first epoch where there was none."""
    known = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    before: Floats = time_s - time_s[np.concatenate([[0], known[:-1]])]
    return before


def terrain_heights(
    ground_m: Floats, climb: Climb, speed_mps: Floats, time_s: Floats, options: GpsInsOptions
) -> HeightReadings:
    """The DEM's heights (n,) below the vehicle, whose errors hang together over a distance."""
    step_s = np.maximum(np.diff(time_s, prepend=time_s[:1]), options.period_s)
    way = np.maximum(np.nan_to_num(speed_mps) * step_s, 0.1)
    sigma = options.dem_sigma_m * np.sqrt(1 + 2 * options.dem_correlation_m / way)
    return HeightReadings(
        height_m=ground_m,
        sigma_m=sigma,
        gate_m=np.full(len(time_s), options.dem_sigma_m),
        slow_m=np.where(climb.known, 0.0, options.dem_sigma_m),
    )


def filter_heights(
    time_s: Floats, restart: NDArray[np.bool_], climb: Climb, readings: HeightReadings, restart_after: int
) -> Heights:
    """The scalar filter: the mean climb of a step's two ends as command, heights as measurements.

    Starts at the first height. One that can't be is left out, and after ``restart_after`` of these in a row the
    filter starts anew at the last.
    """
    n = len(time_s)
    out = Heights(np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, bool), np.zeros(n, bool))
    moments: tuple[Floats, Floats] | None = None
    rejected = 0
    for e in range(n):
        if restart[e]:
            moments = None
        measured = float(readings.height_m[e])
        if moments is not None:
            moments = _climbed(time_s, climb, e, moments)
            if math.isfinite(measured):
                moments, believed = _measured(readings, e, moments)
                out.gated[e] = not believed
                rejected = 0 if believed else rejected + 1
        if math.isfinite(measured) and (moments is None or rejected >= restart_after):
            moments = np.array([measured]), _ONE * _START_SIGMA_M**2
            out.starts[e], rejected = True, 0
        if moments is not None:
            out.height_m[e] = moments[0][0]
            out.sigma_m[e] = math.hypot(math.sqrt(moments[1][0, 0]), readings.slow_m[e])
    return out


def _climbed(time_s: Floats, climb: Climb, e: int, moments: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    dt = float(time_s[e] - time_s[e - 1])
    ends = slice(e - 1, e + 1)
    mean, covariance = kalman.predict(
        *moments, _ONE, _ONE * (dt * float(np.mean(climb.sigma_mps[ends]))) ** 2
    )
    return mean + dt * float(np.mean(climb.rate_mps[ends])), covariance


def _measured(
    readings: HeightReadings, e: int, moments: tuple[Floats, Floats]
) -> tuple[tuple[Floats, Floats], bool]:
    """Corrected by a height, and whether it was believed."""
    mean, covariance = moments
    innovation = float(readings.height_m[e]) - mean
    gate = _GATE_SIGMAS * math.hypot(float(readings.gate_m[e]), math.sqrt(covariance[0, 0]))
    if abs(innovation[0]) > gate:
        return moments, False
    return kalman.correct(mean, covariance, innovation, _ONE, _ONE * float(readings.sigma_m[e]) ** 2), True
