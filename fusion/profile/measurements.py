"""What a drive's sensors say about height and grade of its path: one table, each measurement at its own time.

Knows sensors and the path, but neither how measurements are weighed nor what is estimated from them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.arrays import ColumnTable, nearest
from fusion.frames import GRAVITY_MPS2
from fusion.profile.barometer import pressure_heights
from fusion.profile.blocks import binned
from fusion.profile.path import DrivenPath, Speeds, ground_speed
from fusion.terrain.dem import Dem
from fusion.types import CUES, Bools, DriveLog, Floats, Ints

ALTITUDE, DOPPLER, PITCH, FORCE, BARO, TERRAIN = range(6)
SENSORS = (*CUES, "dem")
"""The kinds of measurements, in the order of their codes."""

PERIOD_S = (1.0, 0.5, 0.5, 0.5, 1.0, 0.0)
"""Of each kind: denser samples are averaged over slots this long."""
MIN_SPEED_MPS = 1.0
"""Below this nothing is said of grades (spec 7)."""
MAX_GRADE = 0.6
"""Steeper than any road: such a value is an error."""
DEM_SPACING_M = 25.0
DEM_CLEARANCE_M = 60.0
"""The DEM is read every so many metres of the path, and not so near to a bridge or tunnel."""
_DOPPLER_FLOOR = 0.002
"""What a grade by Doppler is wrong by at any speed (spec 7: 0.2 %)."""
_DEFAULT_DOPPLER_MPS = 0.3
"""Accuracy of vertical velocities of a log that states none."""


Column = tuple[Floats, Floats, Floats]
"""Of one sensor: times, values, and sigmas as the log states them."""


@dataclass(frozen=True, eq=False)
class Measurements(ColumnTable):
    """m measurements ordered by time, columns of shape (m,); those for pictures are ``fusion.types.DrawnMeasurements``.

    ``sensor``: code; ``value``: m or grade; ``stated_sigma``: one sigma as the log states it (NaN unknown); ``along_m``
    and ``run``: where on the path; ``acceleration_mps2``: along the path (0 unknown); ``turn``: 1 - cosine of the angle
    between course and path (0 unknown).
    """

    time_s: Floats
    along_m: Floats
    run: Ints
    sensor: Ints
    value: Floats
    stated_sigma: Floats
    speed_mps: Floats
    acceleration_mps2: Floats
    turn: Floats

    def of(self, *sensors: int) -> Bools:
        """Which are of any of these sensors, (m,)."""
        wanted = np.zeros(len(SENSORS), bool)
        wanted[list(sensors)] = True
        return wanted[self.sensor]


def build_measurements(
    log: DriveLog,
    path: DrivenPath,
    dem: Dem | None,
    use: frozenset[int],
    altitude_lag_s: float = 0.0,
) -> Measurements:
    """All measurements of the sensors ``use`` that lie on the path; ``log`` has its inertial data set right.

    Altitudes that are late by ``altitude_lag_s`` belong to where the vehicle was then.
    """
    driven = speeds(log, path)
    parts = []
    for sensor, build in enumerate((_altitude, _doppler, _pitch, _force, _pressure)):
        if sensor in use:
            time, value, stated_sigma = build(log, path, driven)
            time = time - altitude_lag_s if sensor == ALTITUDE else time
            parts.append(_placed(path, sensor, (time, value, stated_sigma), driven, _turn(log, path, time)))
    if TERRAIN in use and dem is not None:
        parts.append(_terrain(path, dem, driven))
    measured = Measurements.empty().joined(*parts)
    return measured.take(np.lexsort((measured.sensor, measured.time_s)))


def _placed(path: DrivenPath, sensor: int, column: Column, driven: Speeds, turn: Floats) -> Measurements:
    """Measurements at their places; slopes only in motion, forwards along the path."""
    time, value, stated_sigma = column
    along, run = path.at(time)
    here = np.interp(time, *driven)
    keep = (run >= 0) & np.isfinite(value)
    if sensor in (DOPPLER, PITCH, FORCE):
        keep &= (here > MIN_SPEED_MPS) & (np.abs(value) < MAX_GRADE)
    rate = acceleration(time, *driven)
    measured = Measurements(
        time, along, run, np.full(len(time), sensor), value, stated_sigma, here, np.nan_to_num(rate), turn
    )
    return measured.take(keep)


def _turn(log: DriveLog, path: DrivenPath, time: Floats) -> Floats:
    """1 - cosine of the angle between the vehicle's course and the path; 0 where it stands or nothing is known."""
    v = log.velocity
    known = np.isfinite(v.vel_n_mps + v.vel_e_mps)
    if not known.any() or not len(time):
        return np.zeros(len(time))
    north, east = (np.interp(time, v.time_s[known], c[known]) for c in (v.vel_n_mps, v.vel_e_mps))
    along, _ = path.at(time)
    angle = np.arctan2(north, east) - path.direction_rad(along)
    right = np.clip(np.searchsorted(v.time_s[known], time), 0, int(known.sum()) - 1)
    near = np.abs(v.time_s[known][right] - time) < 2.0
    usable = near & np.isfinite(angle) & (np.hypot(north, east) > MIN_SPEED_MPS)
    return np.where(usable, 1 - np.cos(np.where(usable, angle, 0.0)), 0.0)


def acceleration(time: Floats, speed_time: Floats, speed: Floats) -> Floats:
    """Change of speed at ``time`` (m/s^2), by the five-point rule; NaN where speeds are too far apart.

    The rule of two points takes a mean over two seconds of a log at 1 Hz, which at the same bends and crossings errs in
    the same direction in every drive; five points are right to the fourth order and a third noisier.
    """
    if len(speed_time) < 2:
        return np.full(len(time), np.nan)
    step_s = 1.0 if np.median(np.diff(speed_time)) > 0.6 else 0.5
    right = np.clip(np.searchsorted(speed_time, time), 1, len(speed_time) - 1)
    near = speed_time[right] - speed_time[right - 1] < 2.5
    near &= (time > speed_time[0]) & (time < speed_time[-1])
    v = [np.interp(time + h * step_s, speed_time, speed) for h in (-2, -1, 1, 2)]
    return np.where(near, (v[0] - 8 * v[1] + 8 * v[2] - v[3]) / (12 * step_s), np.nan)


def _altitude(log: DriveLog, path: DrivenPath, driven: Speeds) -> Column:
    """Heights on one datum, the one that more fixes have: a mixture would jump by the geoid's tens of metres."""
    fix = log.fix
    level = np.isfinite(fix.alt_msl_m).sum() >= np.isfinite(fix.height_ell_m).sum()
    height = fix.alt_msl_m if level else fix.height_ell_m
    if not np.isfinite(height).any():
        return np.empty(0), np.empty(0), np.empty(0)
    stated_sigma = np.where(np.isfinite(fix.v_acc_m), fix.v_acc_m, 0.0)
    time, value, stated = binned(fix.time_s, PERIOD_S[ALTITUDE], height, stated_sigma)
    fresh = ~_held(time, value, driven)
    return time[fresh], value[fresh], np.where(stated > 0, stated, np.nan)[fresh]


def _held(time: Floats, value: Floats, driven: Speeds) -> Bools:
    """Which heights (m,) a receiver merely repeats while the vehicle stands.

    Many receivers freeze their position below walking speed. Taken for measurements, the same height again and again
    says that heights do not drift at all.
    """
    again = np.zeros(len(time), bool)
    again[1:] = (value[1:] == value[:-1]) & (np.interp(time[1:], *driven) < MIN_SPEED_MPS)
    return again


def _doppler(log: DriveLog, path: DrivenPath, driven: Speeds) -> Column:
    """Climb over ground speed, where the vehicle moves forwards along the path."""
    v = log.velocity
    stated = np.where(np.isfinite(v.s_acc_mps) & (v.s_acc_mps > 0), v.s_acc_mps, _DEFAULT_DOPPLER_MPS)
    time, north, east, down, stated_sigma = binned(
        v.time_s, PERIOD_S[DOPPLER], v.vel_n_mps, v.vel_e_mps, v.vel_d_mps, stated
    )
    if not len(time):
        return time, time, time
    ground = np.hypot(north, east)
    along, _ = path.at(time)
    forwards = np.cos(np.arctan2(north, east) - path.direction_rad(along)) > 0.0
    moving = (ground > MIN_SPEED_MPS) & forwards
    safe = np.maximum(ground, MIN_SPEED_MPS)
    return time, np.where(moving, -down / safe, np.nan), np.hypot(stated_sigma / safe, _DOPPLER_FLOOR)


def _pitch(log: DriveLog, path: DrivenPath, driven: Speeds) -> Column:
    """Tangent of the sensor's pitch, mount and all; not while the vehicle goes backwards."""
    a = log.attitude
    backwards = _backwards(log, a.time_s, a.yaw_rad)
    grade = np.where(backwards, np.nan, np.tan(np.clip(a.pitch_rad, -1.0, 1.0)))
    stated = np.where(np.isfinite(a.pitch_acc_rad), a.pitch_acc_rad, 0.0)
    time, value, stated_sigma = binned(a.time_s, PERIOD_S[PITCH], grade, stated)
    return time, value, np.where(stated_sigma > 0, stated_sigma, np.nan)


def _backwards(log: DriveLog, time: Floats, yaw_rad: Floats) -> Bools:
    """Whether the vehicle moves against its nose; false where that is not known."""
    v = log.velocity
    if not v.has("vel_n_mps", "vel_e_mps") or not len(time):
        return np.zeros(len(time), bool)
    known = np.isfinite(v.vel_n_mps + v.vel_e_mps)
    seen_s = v.time_s[known]
    north, east = (np.interp(time, seen_s, c[known]) for c in (v.vel_n_mps, v.vel_e_mps))
    near = np.abs(seen_s[nearest(seen_s, time)] - time) < 1.0  # through an outage the vehicle may have turned
    moving = np.hypot(north, east) > MIN_SPEED_MPS
    return near & moving & (np.cos(yaw_rad - np.arctan2(east, north)) < -0.5)


def _force(log: DriveLog, path: DrivenPath, driven: Speeds) -> Column:
    """Grade that the accelerometer feels beyond the change of speed: sin(pitch) = (f - dv/dt) / g."""
    f, a = log.force, log.attitude
    nose = np.isfinite(a.yaw_rad)
    yaw = (
        np.interp(f.time_s, a.time_s[nose], np.unwrap(a.yaw_rad[nose]))
        if nose.any()
        else np.full(len(f), np.nan)
    )
    facing = np.where(_backwards(log, f.time_s, yaw), np.nan, f.acc_x_mps2)
    time, forward = binned(f.time_s, PERIOD_S[FORCE], facing)
    felt = (forward - acceleration(time, *driven)) / GRAVITY_MPS2
    with np.errstate(invalid="ignore"):
        sine = np.where(np.abs(felt) < MAX_GRADE, felt, np.nan)
        return time, sine / np.sqrt(1 - sine**2), np.full(len(time), np.nan)


def _pressure(log: DriveLog, path: DrivenPath, driven: Speeds) -> Column:
    """Height by the air's pressure; its drift and what driving does to it are the filter's affair."""
    at, height = pressure_heights(log.pressure)
    time, value = binned(at, PERIOD_S[BARO], height)
    return time, value, np.full(len(time), np.nan)


def _terrain(path: DrivenPath, dem: Dem, driven: Speeds) -> Measurements:
    """DEM heights every ``DEM_SPACING_M`` of the path, away from bridges and tunnels."""
    step = np.floor(path.along_m / DEM_SPACING_M)
    new = np.concatenate([[True], np.diff(step) > 0])
    time, along = path.time_s[new], path.along_m[new]
    row, distance = path.match.position_on(along)
    inside = row >= 0
    segment = path.match.segment[row]
    table, network = path.network.table, path.network
    share = distance / np.maximum(network.length_m[segment], 0.1)
    lon = table.lon0_deg[segment] + share * (table.lon1_deg - table.lon0_deg)[segment]
    lat = table.lat0_deg[segment] + share * (table.lat1_deg - table.lat0_deg)[segment]
    height = np.full(len(time), np.nan)
    clear = inside & ~_near_structure(path, along)
    if clear.any():
        height[clear] = dem.heights(lon[clear], lat[clear])
    column = time, height, np.full(len(time), np.nan)
    return _placed(path, TERRAIN, column, driven, np.zeros(len(time)))


def _near_structure(path: DrivenPath, along: Floats) -> Bools:
    """Whether a bridge or tunnel of the path lies within ``DEM_CLEARANCE_M``."""
    match, table = path.match, path.network.table
    structure = (table.bridge | table.tunnel)[match.segment]
    start = match.start_m[structure] - DEM_CLEARANCE_M
    end = match.start_m[structure] + np.abs(match.leave_m - match.enter_m)[structure] + DEM_CLEARANCE_M
    # Starts grow along the path, so the last stretch that begins before a place reaches farthest.
    last = np.searchsorted(start, along, side="right") - 1
    reach = np.maximum.accumulate(end) if len(end) else end
    return (last >= 0) & (along <= reach[np.maximum(last, 0)]) if len(end) else np.zeros(len(along), bool)


def speeds(log: DriveLog, path: DrivenPath) -> Speeds:
    """Times and ground speeds; by the positions, for logs that have no others."""
    time, speed, _ = ground_speed(log)
    if len(time):
        return time, speed
    time, step = path.time_s, np.diff(path.time_s)
    same = np.diff(path.run) == 0
    speed = np.where(same, np.diff(path.along_m) / np.maximum(step, 1e-3), 0.0)
    return time, np.concatenate([speed[:1], 0.5 * (speed[1:] + speed[:-1]), speed[-1:]])
