"""The Kalman filters of the particle method as one compiled loop over a drive, which ``KalmanRun`` leads.

Each epoch is taken as ``DriveRun`` takes it through an engine, in the order of the thesis, with the textbook's
prediction and with corrections by one number after another (their errors are independent). What a filter of 9 states
needs for that is some microseconds; going in and out of compiled code at every step would cost many times as much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.filters.kalman import correct_scalar, predict
from fusion.published.matchers.mahalanobis import NOT_POSITIVE, nearest_segment
from fusion.published.nine_state.measurements import (
    attitude_and_spreads,
    ground_measurement,
    heading_measurement,
    map_covariance,
    pitch_measurement,
)
from fusion.published.nine_state.motion import (
    OUTLIERS_BEFORE_RESTART,
    SHORTEST_WAY_M,
    STATES,
    VX,
    VY,
    X,
    Y,
    Z,
    fix_fits,
    transition_matrix,
    whitened,
)
from fusion.published.nine_state.protocol import EpochRows
from fusion.published.nine_state.sensors import GNSS_STATES, SensorColumns
from fusion.roads.grid import SegmentGrid
from fusion.types import Floats, Ints

UNKNOWN, NOTHING, PLANE, OTHER = range(4)
"""What is known of the terrain under a segment: not looked at yet; no height; a plane; a surface to be asked."""


class EpochInputs(NamedTuple):
    """The epochs of a drive, n of them, beside what the sensors say. ``fix`` (n, 3) is x, y, altitude, NaN if unknown.

    ``start_altitude`` (n,) is where a new state would begin, NaN where none can.
    """

    time_s: Floats
    restart: NDArray[np.bool_]
    has_fix: NDArray[np.bool_]
    fix: Floats
    speed_mps: Floats
    start_altitude: Floats


class Rules(NamedTuple):
    """What the loop goes by. ``linear``: the Kalman filter; ``process_noise`` (9,) are variances per second.

    ``half_rate`` is ``motion.half_rate``, ``..._var_...`` are squares of options; all others are the options so called.
    """

    linear: bool
    half_rate: float
    process_noise: Floats
    min_speed_mps: float
    match_gate: float
    antenna_height_m: float
    map_var_m2: float
    map_var_rad2: float
    gnss_correlation_s: float
    pitch_var_rad2: float
    pitch_correlation_s: float
    dem_var_m2: float
    dem_correlation_m: float


class Planes(NamedTuple):
    """The terrain under every segment of the network: its ``kind`` and, of planes, a, b, c, x0, y0, (segments, 5)."""

    kind: NDArray[np.int8]
    plane: Floats


class Now(NamedTuple):
    """Where the loop is: the Gaussian, and what of an epoch must outlive a question about the terrain.

    ``flags``: running, fixes rejected in a row, waiting for an answer, matched segment, moving. ``place``: matched x,
    y, direction; predicted x, y; way since the last epoch, metres; height of the ground.
    """

    mean: Floats
    covariance: Floats
    flags: Ints
    place: Floats

    @classmethod
    def begin(cls) -> Now:
        """Before the first epoch."""
        return cls(np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros(5, np.int64), np.zeros(7))


RUNNING, REJECTED, WAITING, SEGMENT, MOVING = range(5)
ROAD_X, ROAD_Y, ROAD_DIRECTION, PREDICTED_X, PREDICTED_Y, WAY, GROUND = range(7)


@compiled
def advance(
    drive: EpochInputs,
    sensors: SensorColumns,
    rules: Rules,
    grid: SegmentGrid,
    planes: Planes,
    rows: EpochRows,
    now: Now,
    e: int,
) -> int:
    """Filter from epoch ``e`` on; returns the number of epochs, or the epoch at which the terrain must be looked at.

    Then ``now`` says which segment and where. Fill in its plane, or for a surface of another kind the height itself,
    and call again with that epoch.
    """
    while e < len(drive.time_s):
        if now.flags[WAITING] == 0:
            if drive.restart[e]:
                now.flags[RUNNING] = 0
            if now.flags[RUNNING] == 0 and not _starts(drive, sensors, now, rows, e):
                e += 1
                continue
            _sense(drive, sensors, rules, now, rows, e)
            _match(grid, rules, now)
        if not _knows_ground(planes, now):
            return e
        _locate(rules, now)
        _record(now, rows, e)
        e += 1
    return e


@compiled
def _starts(drive: EpochInputs, sensors: SensorColumns, now: Now, rows: EpochRows, e: int) -> bool:
    """Begin around the epoch's fix; without one the filter waits."""
    if not (drive.has_fix[e] and np.isfinite(drive.start_altitude[e])):
        return False
    now.mean[:] = sensors.start_mean[e]
    now.mean[Z] = drive.start_altitude[e]
    now.covariance[:] = 0.0
    for a in range(STATES):
        now.covariance[a, a] = sensors.start_sigma[e, a] ** 2
    now.flags[REJECTED] = 0
    rows.start[e] = True
    return True


@compiled
def _sense(
    drive: EpochInputs, sensors: SensorColumns, rules: Rules, now: Now, rows: EpochRows, e: int
) -> None:
    """Predict, but not a state that begins here; correct by GNSS, acceleration and pitch."""
    speed, dt, use_fix = drive.speed_mps[e], 1.0, False
    if now.flags[RUNNING] == 1:
        dt = drive.time_s[e] - drive.time_s[e - 1]
        if not np.isfinite(speed):
            speed = math.hypot(now.mean[VX], now.mean[VY])
        use_fix = _plausible(drive, sensors, now, rows, e, dt)
        F = transition_matrix(dt, rules.half_rate * dt * dt)
        mean, covariance = predict(now.mean, now.covariance, F, np.diag(rules.process_noise * dt))
        now.mean[:], now.covariance[:] = mean, covariance
    elif not np.isfinite(speed):
        speed = 0.0
    now.flags[MOVING] = speed >= rules.min_speed_mps
    now.place[WAY] = max(speed * dt, SHORTEST_WAY_M)
    _correct_states(sensors, rules, now, e, dt, use_fix)
    if now.flags[MOVING] == 1 and np.isfinite(sensors.pitch_var[e]) and not rules.linear:
        pitch, row = pitch_measurement(now.mean)
        body = whitened(rules.pitch_var_rad2, dt, rules.pitch_correlation_s)
        correct_scalar(now.mean, now.covariance, sensors.pitch[e] - pitch, row, sensors.pitch_var[e] + body)


@compiled
def _plausible(
    drive: EpochInputs, sensors: SensorColumns, now: Now, rows: EpochRows, e: int, dt: float
) -> bool:
    """Whether there is a fix that can be where the vehicle is by now."""
    if not drive.has_fix[e]:
        return False
    _, _, h_sigma, z_sigma = attitude_and_spreads(now.mean, now.covariance)
    fits = fix_fits(drive.fix[e], sensors.fix_sigma[e], now.mean, (h_sigma, z_sigma), dt)
    now.flags[REJECTED] = 0 if fits else now.flags[REJECTED] + 1
    rows.outlier[e] = not fits
    return fits


@compiled
def _correct_states(sensors: SensorColumns, rules: Rules, now: Now, e: int, dt: float, use_fix: bool) -> None:
    """Position, velocity and acceleration, as far as they were measured."""
    unit = np.zeros(STATES)
    for state in range(STATES):
        variance = sensors.var[e, state]
        if not np.isfinite(variance) or (not use_fix and state in GNSS_STATES):
            continue
        if state == Z:
            variance = whitened(variance, dt, rules.gnss_correlation_s)
        unit[state] = 1.0
        correct_scalar(now.mean, now.covariance, sensors.z[e, state] - now.mean[state], unit, variance)
        unit[state] = 0.0


@compiled
def _match(grid: SegmentGrid, rules: Rules, now: Now) -> None:
    """The road point of (2.27)-(2.31) nearest to the prediction."""
    heading, row = heading_measurement(now.mean)
    covariance = map_covariance(now.covariance, row)
    covariance[0, 0] += rules.map_var_m2
    covariance[1, 1] += rules.map_var_m2
    covariance[2, 2] += rules.map_var_rad2
    if now.flags[MOVING] == 0:
        heading = np.nan
    x, y = now.mean[X], now.mean[Y]
    match = nearest_segment(grid, x, y, heading, covariance, rules.match_gate)
    if match.segment == NOT_POSITIVE:
        raise ValueError("the covariance of a match must be finite and positive definite")
    now.flags[SEGMENT] = match.segment
    now.place[ROAD_X], now.place[ROAD_Y], now.place[ROAD_DIRECTION] = match.x_m, match.y_m, match.heading_rad
    now.place[PREDICTED_X], now.place[PREDICTED_Y] = x, y


@compiled
def _knows_ground(planes: Planes, now: Now) -> bool:
    """Put the height of the ground in its place, NaN where there is none; False where it must be asked for."""
    segment = now.flags[SEGMENT]
    kind = NOTHING if segment < 0 else planes.kind[segment]
    answered = now.flags[WAITING] == 1 and kind == OTHER
    if kind == UNKNOWN or (kind == OTHER and not answered):
        now.flags[WAITING] = 1
        return False
    now.flags[WAITING] = 0
    if kind == NOTHING:
        now.place[GROUND] = np.nan
    elif kind == PLANE:
        a, b, c, x0, y0 = planes.plane[segment]
        now.place[GROUND] = a * (now.place[PREDICTED_X] - x0) + b * (now.place[PREDICTED_Y] - y0) + c
    return True


@compiled
def _locate(rules: Rules, now: Now) -> None:
    """Correct by the matched road and by the ground under the vehicle."""
    mean, covariance = now.mean, now.covariance
    if now.flags[SEGMENT] >= 0:
        unit = np.zeros(STATES)
        for state, at in ((X, now.place[ROAD_X]), (Y, now.place[ROAD_Y])):
            unit[state] = 1.0
            correct_scalar(mean, covariance, at - mean[state], unit, rules.map_var_m2)
            unit[state] = 0.0
        if now.flags[MOVING] == 1 and not rules.linear:
            heading, row = heading_measurement(mean)
            turn = _wrapped(now.place[ROAD_DIRECTION] - heading)
            correct_scalar(mean, covariance, turn, row, rules.map_var_rad2)
    if np.isfinite(now.place[GROUND]):
        height, row = ground_measurement(mean, rules.antenna_height_m)
        if rules.linear:
            # Only what is linear may enter: the antenna's height above the ground is taken as known.
            row[:] = 0.0
            row[Z] = 1.0
        variance = whitened(rules.dem_var_m2, now.place[WAY], rules.dem_correlation_m)
        correct_scalar(mean, covariance, now.place[GROUND] - height, row, variance)


@compiled
def _record(now: Now, rows: EpochRows, e: int) -> None:
    rows.done[e] = True
    rows.ground[e] = np.isfinite(now.place[GROUND])
    rows.state[e] = now.mean
    rows.heading_rad[e] = math.atan2(now.mean[VY], now.mean[VX])
    attitude = attitude_and_spreads(now.mean, now.covariance)
    rows.pitch_rad[e], rows.pitch_sigma_rad[e], rows.h_sigma_m[e], rows.z_sigma_m[e] = attitude
    rows.segment[e] = now.flags[SEGMENT]
    now.flags[RUNNING] = now.flags[REJECTED] < OUTLIERS_BEFORE_RESTART


@compiled
def _wrapped(angle_rad: float) -> float:
    return angle_rad - 2.0 * math.pi * math.floor((angle_rad + math.pi) / (2.0 * math.pi))
