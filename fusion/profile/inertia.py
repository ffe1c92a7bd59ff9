"""Inertial data put right before they are used: their lag against GNSS, and the yaw of their sensor in the vehicle.

Both are learned from the drive itself: changes of velocity by GNSS, over about a second, are compared with what the
inertial sensor shows of them. Where a lag or a yaw is not clear, nothing is done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from fusion.arrays import ColumnTable
from fusion.frames import GRAVITY_MPS2, wrap_angle
from fusion.profile.blocks import (
    NOTHING,
    Estimate,
    alone,
    binned,
    blocks_of,
    centred,
    crossed,
    inliers,
    jackknife,
    together,
)
from fusion.types import Bools, DriveLog, Floats, Ints

WINDOW_S = 1.0
"""Changes of velocity are taken over this long: they are far above Doppler's 0.05 m/s, and no manoeuvre is lost."""
LONGEST_WINDOW_S = 2.5
"""Sparser velocities have lost the manoeuvres."""
MIN_SPEED_MPS = 3.0
"""Slower, the course is noise, and a vehicle may go backwards."""
BLOCK_S = 10.0
"""Grade, bias and mount hardly change in this time, and a manoeuvre fits into it."""
SAMPLE_S = 0.25
"""Denser velocities are averaged over slots this long, and inertial samples over ``INERTIAL_SAMPLE_S``."""
INERTIAL_SAMPLE_S = 0.1
LONGEST_LAG_S = 0.7
"""Lags are looked for up to here, every ``_STEP_S``: half a second is much, even for a slow device."""
_STEP_S = 0.1
_HOLE_S, _HOLE_STEPS = 0.3, 2.5
"""Samples that are farther apart than both this and so many usual steps have a hole between them."""


@dataclass(frozen=True, eq=False)
class Changes(ColumnTable):
    """Changes of velocity between pairs of instants, by GNSS; columns of shape (n,).

    ``forward_mps``: of the speed; ``left_mps``: across, to the left; ``gravity_mps``: what the slope, by the climb,
    adds to the force forward (0 unknown); ``speed_mps``: the mean; ``block``: its number.
    """

    begin_s: Floats
    end_s: Floats
    forward_mps: Floats
    left_mps: Floats
    gravity_mps: Floats
    speed_mps: Floats
    block: Ints


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples (m,) of an inertial sensor. The changes of an ``angle`` count, and the integrals of all others."""

    time_s: Floats
    value: Floats
    angle: bool = False

    def over(self, begin_s: Floats, end_s: Floats) -> Floats:
        """Its change or integral between instants, shape (n,)."""
        start = self.time_s[0]
        return np.asarray(self._integral(end_s - start) - self._integral(begin_s - start))

    @cached_property
    def _integral(self) -> PPoly:
        spline = CubicSpline(self.time_s - self.time_s[0], self.value)
        return spline if self.angle else spline.antiderivative()

    def covers(self, begin_s: Floats, end_s: Floats) -> Bools:
        """Whether samples go through from ``begin_s`` to ``end_s`` without a hole."""
        time = self.time_s
        if len(time) < 4:
            return np.zeros(len(begin_s), bool)
        step = np.diff(time)
        hole = step > max(_HOLE_STEPS * float(np.median(step)), _HOLE_S)
        holes = np.concatenate([[0], np.cumsum(hole)])
        first = np.clip(np.searchsorted(time, begin_s, side="right") - 1, 0, None)
        last = np.clip(np.searchsorted(time, end_s, side="left"), None, len(time) - 1)
        inside = (begin_s >= time[0]) & (end_s <= time[-1])
        return np.asarray(inside & (holes[first] == holes[last]))


@dataclass(frozen=True, eq=False)
class Cue:
    """A signal whose integral, times ``factor`` (n,), should be proportional to ``wanted`` (n,), changes by GNSS."""

    signal: Signal
    wanted: Floats
    factor: Floats


def changes_of(time_s: Floats, north_mps: Floats, east_mps: Floats, down_mps: Floats) -> Changes:
    """The changes of a Doppler velocity, samples of shape (m,), where it goes on without outages and fast enough."""
    known = np.isfinite(north_mps + east_mps)
    velocity = (c[known] for c in (north_mps, east_mps, np.nan_to_num(down_mps)))
    time, north, east, down = binned(time_s[known], SAMPLE_S, *velocity)
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    apart = max(1, round(WINDOW_S / step))
    if len(time) <= apart or step * apart > LONGEST_WINDOW_S:
        return Changes.empty()
    begin, end = slice(None, -apart), slice(apart, None)
    speed = np.hypot(north, east)
    turned = wrap_angle(np.diff(np.arctan2(north, east)))  # anticlockwise
    course = np.concatenate([[0.0], np.cumsum(turned)])
    middle = 0.5 * (speed[begin] + speed[end])
    lasted = time[end] - time[begin]
    slope = -0.5 * (down[begin] + down[end]) / np.maximum(middle, MIN_SPEED_MPS)
    changes = Changes(
        time[begin],
        time[end],
        speed[end] - speed[begin],
        middle * (course[end] - course[begin]),
        GRAVITY_MPS2 * slope * lasted,
        middle,
        blocks_of(time[begin], BLOCK_S),
    )
    return changes.take(
        (lasted < 1.2 * step * apart) & (np.minimum(speed[begin], speed[end]) > MIN_SPEED_MPS)
    )


def time_lag(changes: Changes, cues: Sequence[Cue]) -> Estimate:
    """How late the inertial signals are against GNSS, s."""
    return together([_lag_of(changes, cue) for cue in cues])


def _lag_of(changes: Changes, cue: Cue) -> Estimate:
    """The lag at which one signal correlates best with the changes that it should show."""
    lags = np.arange(-LONGEST_LAG_S, LONGEST_LAG_S + _STEP_S / 2, _STEP_S)
    keep = cue.signal.covers(changes.begin_s - LONGEST_LAG_S, changes.end_s + LONGEST_LAG_S)
    if not keep.any():
        return NOTHING
    begin, end, block = changes.begin_s[keep], changes.end_s[keep], changes.block[keep]
    wanted = cue.wanted[keep]
    shown = np.array([cue.factor[keep] * cue.signal.over(begin + lag, end + lag) for lag in lags])
    for _ in range(2):
        best = int(np.argmax(_correlation(_products(shown, wanted, block).sum(axis=-1))))
        near = inliers(np.array([wanted, shown[best]]), block)
        shown, wanted, block = shown[:, near], wanted[near], block[near]
    return jackknife(_products(shown, wanted, block), lambda total: _peak(lags, _correlation(total)))


def _products(shown: Floats, wanted: Floats, block: Ints) -> Floats:
    """Sums in each block of shown (k, n) squared, of shown times wanted and of wanted squared: (3, k, blocks)."""
    own, want = centred(shown, block), centred(wanted[None], block)[0]
    squares, products = ([np.bincount(block, row) for row in rows] for rows in (own**2, own * want))
    return np.array([squares, products, [np.bincount(block, want**2)] * len(own)])


def _correlation(total: Floats) -> Floats:
    """Of shown and wanted by their sums (3, k)."""
    return np.asarray(total[1] / np.sqrt(np.maximum(total[0] * total[2], 1e-30)))


def _peak(lags: Floats, correlation: Floats) -> float:
    """Where a parabola through the highest value and its neighbours is highest; NaN at the edge of the search."""
    best = int(np.argmax(correlation))
    if best in (0, len(lags) - 1):
        return float("nan")
    low, middle, high = correlation[best - 1 : best + 2]
    curvature = low - 2 * middle + high
    return float(lags[best] + (0.5 * _STEP_S * (low - high) / curvature if curvature < 0 else 0.0))


def mount_yaw(changes: Changes, forward: Signal, left: Signal) -> Estimate:
    """How far an accelerometer's forward axis points to the left of the vehicle's, rad, by its two level axes.

    Both axes show a part of the acceleration across that GNSS knows; the ratio of the parts is the angle's tangent. The
    change of speed (with the squat) and gravity on slopes are taken out first. Where the body rolls, gravity is in the
    force across as well. That does no harm: what leaks into the forward axis is the force that was felt.
    """
    keep = forward.covers(changes.begin_s, changes.end_s)
    if not keep.any():
        return NOTHING
    change = changes.take(keep)
    felt = [signal.over(change.begin_s, change.end_s) for signal in (forward, left)]
    columns = np.array([felt[0], change.left_mps, change.forward_mps, change.gravity_mps, felt[1]])
    near = inliers(columns[:4], change.block)

    def angle(total: Floats) -> float:
        common = alone(total, 1, besides=(2, 3))
        return float(np.arctan2(common[0], common[4]))

    return jackknife(crossed(columns[:, near], change.block[near]), angle)


LAG_FLOOR_S = 0.01
YAW_FLOOR_RAD = np.radians(0.25)
"""One sigma of the method's own error: interpolation, a receiver's own filter, the antenna's place. So at least 0.03 s
and 1 degree are set right."""
USUAL_LAG_S, USUAL_YAW_RAD = 0.2, np.radians(5.0)
"""The usual size of such errors, where there are any: filters of a few samples, a phone in its holder."""
CLEAR_YAW = 4.0
"""Sigmas from which on a yaw is set right. A few bends can look like a yaw (3 sigmas in 1 drive of 60), and forces that
are turned wrongly do more harm than forces that are a little late."""
MOST_YAW_RAD = np.radians(45.0)
"""A larger angle is an axis that is not the forward one."""


@dataclass(frozen=True)
class Inertia:
    """What a drive shows of its inertial data; ``lag_s`` and ``yaw_rad`` were set right (0 where not clear)."""

    lag: Estimate
    yaw: Estimate
    lag_s: float
    yaw_rad: float


def set_right(log: DriveLog) -> tuple[DriveLog, Inertia]:
    """The log with its inertial data at the times and along the axes of the vehicle, and what was found."""
    v = log.velocity
    changes = changes_of(v.time_s, v.vel_n_mps, v.vel_e_mps, v.vel_d_mps)
    lag = time_lag(changes, _cues(log, changes)).with_floor(LAG_FLOOR_S)
    lag_s = lag.worth(USUAL_LAG_S)
    if lag_s:
        early = {name: getattr(log, name) for name in ("force", "rate", "attitude")}
        log = replace(log, **{name: replace(t, time_s=t.time_s - lag_s) for name, t in early.items()})
    f = log.force
    time, forward, left = binned(f.time_s, INERTIAL_SAMPLE_S, f.acc_x_mps2, f.acc_y_mps2)
    yaw = mount_yaw(changes, Signal(time, forward), Signal(time, left)).with_floor(YAW_FLOOR_RAD)
    yaw_rad = yaw.worth(USUAL_YAW_RAD, CLEAR_YAW) if abs(yaw.value) < MOST_YAW_RAD else 0.0
    if yaw_rad:
        turned = np.cos(yaw_rad) * f.acc_x_mps2 - np.sin(yaw_rad) * f.acc_y_mps2
        log = replace(log, force=replace(f, acc_x_mps2=turned))
    return log, Inertia(lag, yaw, lag_s, yaw_rad)


def _cues(log: DriveLog, changes: Changes) -> list[Cue]:
    """What shows the lag: forces forward and across, and the turning by gyroscope and by attitude."""
    f, a, w = log.force, log.attitude, log.rate
    known = np.isfinite(a.yaw_rad)
    nose = np.unwrap(a.yaw_rad[known])  # clockwise
    one = np.ones(len(changes))
    return [
        Cue(_signal(f.time_s, f.acc_x_mps2), changes.forward_mps, one),
        Cue(_signal(f.time_s, f.acc_y_mps2), changes.left_mps, one),
        Cue(_signal(w.time_s, w.gyr_z_radps), changes.left_mps, changes.speed_mps),
        Cue(_signal(a.time_s[known], nose, angle=True), changes.left_mps, -changes.speed_mps),
    ]


def _signal(time_s: Floats, value: Floats, angle: bool = False) -> Signal:
    time, mean = binned(time_s, INERTIAL_SAMPLE_S, value)
    return Signal(time, mean, angle)
