"""A drive log laid on one clock for the methods that work epoch by epoch.

The log's tables keep their own rates; here each epoch takes from every sensor what was measured around it,
and NaN where nothing was. Epochs follow the GNSS fixes; in an outage they go on at the pace of the other
sensors, so that a filter can bridge it. No road, no terrain and no filter is known here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fusion.arrays import ColumnTable
from fusion.frames import GRAVITY_MPS2, LocalProjection, acceleration_enu
from fusion.types import LONGEST_BRIDGED_OUTAGE_S, DriveLog, Floats, SensorTable

PITCH_FROM_FORCE_SIGMA_RAD = 0.03
"""Accuracy of a pitch that comes from the accelerometer and the change of speed: 2 % by the notes on slopes, more with
the noise of a differentiated speed."""

UNKNOWN_ALTITUDE_SIGMA_M = 5.0
"""Accuracy of altitudes about which neither the log nor its scatter says anything."""

MAD_TO_SIGMA = 1.4826
"""The median of absolute deviations of a Gaussian, times this, is its sigma."""


@dataclass(frozen=True)
class Epochs(ColumnTable):
    """One row per epoch, ``n`` rows; NaN where not measured. Metres in the local plane, ENU, SI units.

    ``acc_*`` is the kinematic acceleration (gravity taken off), ``pitch_rad`` the sensor's pitch as logged
    (mount offset included), ``rate_*`` the rate of change of the fixes themselves, ``speed_mps`` the best ground
    speed, ``after_outage`` marks epochs to which nothing may be carried over from the one before. ``yaw_rad`` is the
    sensor's yaw as logged (clockwise from north), ``turn_radps`` what its gyroscope feels about its z axis (positive
    to the left), ``odo_mps`` the vehicle's own speed signal.
    """

    time_s: Floats
    x_m: Floats
    y_m: Floats
    alt_m: Floats
    h_acc_m: Floats
    v_acc_m: Floats
    vel_e_mps: Floats
    vel_n_mps: Floats
    vel_u_mps: Floats
    s_acc_mps: Floats
    rate_e_mps: Floats
    rate_n_mps: Floats
    rate_u_mps: Floats
    acc_e_mps2: Floats
    acc_n_mps2: Floats
    acc_u_mps2: Floats
    pitch_rad: Floats
    pitch_acc_rad: Floats
    speed_mps: Floats
    yaw_rad: Floats
    turn_radps: Floats
    odo_mps: Floats
    after_outage: NDArray[np.bool_]

    @property
    def has_gnss(self) -> NDArray[np.bool_]:
        """Whether the epoch has a position."""
        return np.isfinite(self.x_m)

    def take(self, keep: NDArray[Any] | slice) -> Self:
        """The epochs selected; an outage among those left out counts at the next one that is kept."""
        stretch = np.cumsum(self.after_outage)[keep]
        return replace(super().take(keep), after_outage=np.diff(stretch, prepend=-1) > 0)

    def with_fix(self) -> Self:
        """The epochs that have a position."""
        return self.take(self.has_gnss)


def build_epochs(log: DriveLog, projection: LocalProjection, period_s: float = 1.0) -> Epochs:
    """Lay ``log`` on epochs at least 0.95 ``period_s`` apart; samples are averaged over the epochs' usual spacing."""
    time_s = _epoch_times(log, period_s)
    fix = _nearest(log.fix, time_s, 0.45 * period_s)
    x_m, y_m = projection.to_xy(fix["lon_deg"], fix["lat_deg"])
    altitude = _altitude(fix)
    window_s = max(period_s, float(np.median(np.diff(time_s)))) if len(time_s) > 1 else period_s
    velocity = _window_mean(log.velocity, time_s, window_s)
    attitude = _window_mean(log.attitude, time_s, window_s)
    force = _window_mean(log.force, time_s, window_s)
    odometer = _window_mean(log.odometry, time_s, window_s)["speed_mps"]
    after_outage = _after_outages(time_s, log.outages_s)
    rate_e, rate_n, rate_u = (_rate(values, time_s, after_outage) for values in (x_m, y_m, altitude))
    speed = _ground_speed(velocity, odometer, np.hypot(rate_e, rate_n))
    acceleration = _acceleration(force, attitude)
    pitch, pitch_acc = _pitch_forwards(attitude, velocity), attitude["pitch_acc_rad"]
    if not np.isfinite(pitch).any():
        pitch = _pitch_from_force(time_s, force["acc_x_mps2"], speed)
        pitch_acc = np.full(len(time_s), PITCH_FROM_FORCE_SIGMA_RAD)
    return Epochs(
        time_s=time_s,
        x_m=x_m,
        y_m=y_m,
        alt_m=altitude,
        h_acc_m=fix["h_acc_m"],
        v_acc_m=fix["v_acc_m"],
        vel_e_mps=velocity["vel_e_mps"],
        vel_n_mps=velocity["vel_n_mps"],
        vel_u_mps=-velocity["vel_d_mps"],
        s_acc_mps=velocity["s_acc_mps"],
        rate_e_mps=rate_e,
        rate_n_mps=rate_n,
        rate_u_mps=rate_u,
        acc_e_mps2=acceleration[:, 0],
        acc_n_mps2=acceleration[:, 1],
        acc_u_mps2=acceleration[:, 2],
        pitch_rad=pitch,
        pitch_acc_rad=pitch_acc,
        speed_mps=speed,
        yaw_rad=attitude["yaw_rad"],
        turn_radps=_window_mean(log.rate, time_s, window_s)["gyr_z_radps"],
        odo_mps=odometer,
        after_outage=after_outage,
    )


def white_altitude_sigma(epochs: Epochs) -> float:
    """White noise of the altitudes, m: from second differences, in which slow errors and even slopes cancel."""
    second = np.diff(epochs.alt_m, 2)
    regular = np.abs(np.diff(epochs.time_s, 2)) < 0.1
    usable = second[np.isfinite(second) & regular]
    if len(usable) < 5:
        return UNKNOWN_ALTITUDE_SIGMA_M
    return float(max(MAD_TO_SIGMA * np.median(np.abs(usable)) / np.sqrt(6), 0.01))


def _epoch_times(log: DriveLog, period_s: float) -> Floats:
    """Fix times, thinned; in their outages the times of the densest other sensor, thinned likewise."""
    fixes = _thin(log.fix.time_s, period_s)
    others = max((log.attitude, log.force, log.odometry, log.velocity), key=len, default=log.attitude).time_s
    inside = np.searchsorted(fixes, others)
    inner = (inside > 0) & (inside < len(fixes))
    others, inside = others[inner], inside[inner]
    clear = np.minimum(others - fixes[inside - 1], fixes[inside] - others) >= 0.95 * period_s
    return np.sort(np.concatenate([fixes, _thin(others[clear], period_s)]))


def _thin(time_s: Floats, period_s: float) -> Floats:
    """Keep each time that is at least 0.95 periods after the last one kept."""
    times: list[float] = []
    for t in time_s.tolist():
        if not times or t - times[-1] >= 0.95 * period_s:
            times.append(t)
    return np.array(times)


def _nearest(table: SensorTable, time_s: Floats, within_s: float) -> dict[str, Floats]:
    """The sample nearest to each time, NaN where none is ``within_s``."""
    if not len(table):
        return {name: np.full(len(time_s), np.nan) for name in table.columns()}
    after = np.clip(np.searchsorted(table.time_s, time_s), 1, max(len(table) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(table) - 1)
    left = np.abs(time_s - table.time_s[before]) <= np.abs(table.time_s[after] - time_s)
    index = np.where(left, before, after)
    near = np.abs(table.time_s[index] - time_s) <= within_s
    return {name: np.where(near, getattr(table, name)[index], np.nan) for name in table.columns()}


def _window_mean(table: SensorTable, time_s: Floats, window_s: float) -> dict[str, Floats]:
    """The mean of the samples within half a window of each time; yaw is averaged on the circle."""
    out: dict[str, Floats] = {}
    low = np.searchsorted(table.time_s, time_s - window_s / 2, side="left")
    high = np.searchsorted(table.time_s, time_s + window_s / 2, side="left")
    for name in table.columns():
        column = getattr(table, name)
        if name == "yaw_rad":
            sine, cosine = _means(np.sin(column), low, high), _means(np.cos(column), low, high)
            out[name] = np.arctan2(sine, cosine)
        else:
            out[name] = _means(column, low, high)
    return out


def _means(column: Floats, low: NDArray[np.intp], high: NDArray[np.intp]) -> Floats:
    """Means of ``column[low:high]``, NaN left out; NaN where nothing is left."""
    known = np.isfinite(column)
    # Cumulative sums about the column's own level: heights of 1e3 m and 1e6 samples would lose digits else.
    level = float(np.mean(column[known])) if known.any() else 0.0
    sums = np.concatenate([[0.0], np.cumsum(np.where(known, column - level, 0.0))])
    counts = np.concatenate([[0], np.cumsum(known)])
    count = counts[high] - counts[low]
    mean = (sums[high] - sums[low]) / np.maximum(count, 1) + level
    return np.where(count > 0, mean, np.nan)


def _after_outages(time_s: Floats, outages_s: Floats) -> NDArray[np.bool_]:
    """The first epoch, those after a stated outage, and those after an outage that is too long to bridge."""
    after_outage = np.zeros(len(time_s), bool)
    after_outage[:1] = True
    after_outage[1:] |= np.diff(time_s) > LONGEST_BRIDGED_OUTAGE_S
    for outage in outages_s.tolist():
        after = int(np.searchsorted(time_s, outage, side="left"))
        if 0 < after < len(time_s):
            after_outage[after] = True
    return after_outage


def _altitude(fix: dict[str, Floats]) -> Floats:
    """Heights on one datum, the one that more fixes have: a mixture would jump by the geoid's tens of metres."""
    level, ellipsoid = fix["alt_msl_m"], fix["height_ell_m"]
    return level if np.isfinite(level).sum() >= np.isfinite(ellipsoid).sum() else ellipsoid


def _rate(values: Floats, time_s: Floats, after_outage: NDArray[np.bool_]) -> Floats:
    """Rate of change at each epoch: mean of the steps before and after it, NaN where there is neither."""
    step = np.diff(values) / np.diff(time_s)
    step[after_outage[1:]] = np.nan
    around = np.full((2, len(time_s)), np.nan)
    around[0, 1:], around[1, :-1] = step, step
    count = np.isfinite(around).sum(axis=0)
    return np.where(count > 0, np.nansum(around, axis=0) / np.maximum(count, 1), np.nan)


def _ground_speed(velocity: dict[str, Floats], odometer_mps: Floats, by_position_mps: Floats) -> Floats:
    """Doppler speed, else the vehicle's own, else that of the positions."""
    doppler = np.hypot(velocity["vel_n_mps"], velocity["vel_e_mps"])
    speed = np.where(np.isfinite(doppler), doppler, odometer_mps)
    return np.where(np.isfinite(speed), speed, by_position_mps)


def _acceleration(force: dict[str, Floats], attitude: dict[str, Floats]) -> Floats:
    """ENU acceleration, shape (n, 3); NaN where force or attitude is missing.

    The attitude is the sensor's own, mount offset included: accelerometer and attitude come from one box.
    """
    body = np.column_stack([force["acc_x_mps2"], force["acc_y_mps2"], force["acc_z_mps2"]])
    roll = np.nan_to_num(attitude["roll_rad"])  # logs with pitch and yaw only: level across is the best guess
    return acceleration_enu(body, roll, attitude["pitch_rad"], attitude["yaw_rad"])


def _pitch_forwards(attitude: dict[str, Floats], velocity: dict[str, Floats]) -> Floats:
    """The sensor's pitch, NaN while the vehicle goes backwards: nose up is downhill then."""
    course = np.arctan2(velocity["vel_e_mps"], velocity["vel_n_mps"])
    moving = np.hypot(velocity["vel_e_mps"], velocity["vel_n_mps"]) > 1.0
    backwards = moving & (np.cos(attitude["yaw_rad"] - course) < 0)
    return np.where(backwards, np.nan, attitude["pitch_rad"])


def _pitch_from_force(time_s: Floats, forward_mps2: Floats, speed_mps: Floats) -> Floats:
    """Pitch of the sensor from what its forward axis feels beyond the change of speed: sin(pitch) = (f - dv/dt) / g."""
    if len(time_s) < 3:
        return np.full(len(time_s), np.nan)
    felt = (forward_mps2 - np.gradient(speed_mps, time_s)) / GRAVITY_MPS2
    return np.where(np.abs(felt) < 0.5, np.arcsin(np.clip(felt, -0.5, 0.5)), np.nan)
