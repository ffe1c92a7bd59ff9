"""From a log's cumulative wheel rotations to what each wheel turned between two epochs, and to a filter's readings.

Resets and outages of the counters end here; what a rotation says about the motion is the filter's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fusion.published.epochs.table import Epochs
from fusion.published.nine_state.protocol import Measurement, WheelReading
from fusion.published.nine_state.sensors import Sensors
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.types import DriveLog, Floats

# What a counter may do from one sample to the next before it counts as begun anew.
_FASTEST_RADPS = 400.0  # no wheel turns faster: 120 m/s on 0.3 m
_QUICKEST_RADPS2 = 35.0  # nor gathers or loses speed quicker: 10 m/s2 on 0.3 m
_JITTER_RAD = 0.7  # a tick of the coarsest counters, and some
_LONGEST_STEPS = 2.5  # of the usual time between samples: after a longer one nothing is known


@dataclass(frozen=True)
class Rotations:
    """What the wheels turned since the epoch before, radians, forwards positive; NaN where that is not known."""

    left_rad: Floats
    right_rad: Floats

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether both are."""
        return np.isfinite(self.left_rad) & np.isfinite(self.right_rad)


@dataclass(frozen=True)
class WheelSensors(Sensors):
    """``Sensors`` with wheels of ``radii_m``: at every epoch, or only ``in_outages``, where no fix is used."""

    rotations: Rotations = field(kw_only=True)
    radii_m: tuple[float, float] = field(kw_only=True)
    in_outages: bool = field(kw_only=True)

    def at(self, e: int, dt_s: float, *, use_fix: bool, moving: bool) -> Measurement:
        """See ``Sensors.at``."""
        measured = super().at(e, dt_s, use_fix=use_fix, moving=moving)
        if self.in_outages and use_fix:
            return measured
        left, right = float(self.rotations.left_rad[e]), float(self.rotations.right_rad[e])
        speed = float(self.epochs.odo_mps[e])
        if not math.isfinite(speed):
            # One wheel alone is a speed signal.
            ways = left * self.radii_m[0], right * self.radii_m[1]
            speed = next((way / dt_s for way in ways if math.isfinite(way)), math.nan)
        return replace(measured, wheels=WheelReading(left, right, abs(speed)))


def rotations_between(log: DriveLog, epochs: Epochs) -> Rotations:
    """Rotations at the epochs of a drive, each (n,): the counters read between their samples, never across outages."""
    left, right = (
        _steps(log.odometry.time_s, column, log.outages_s, epochs.time_s)
        for column in (log.odometry.wheel_left_rad, log.odometry.wheel_right_rad)
    )
    return Rotations(left, right)


def with_inertial_turns(rotations: Rotations, epochs: Epochs, options: OdometerMapOptions) -> Rotations:
    """What two wheels would have turned, by a speed signal and a gyroscope or else a yaw, where they are not known."""
    step_s = np.diff(epochs.time_s, prepend=np.nan)
    way = _mean_with_previous(epochs.odo_mps) * step_s
    turn = _mean_with_previous(epochs.turn_radps) * step_s
    by_yaw = np.remainder(np.pi - np.diff(epochs.yaw_rad, prepend=np.nan), 2 * np.pi) - np.pi
    turn = np.where(np.isfinite(turn), turn, by_yaw)
    apart = 0.5 * options.track_width_m * turn
    left = (way - apart) / options.wheel_radius_left_m
    right = (way + apart) / options.wheel_radius_right_m
    known = rotations.known
    return Rotations(np.where(known, rotations.left_rad, left), np.where(known, rotations.right_rad, right))


def _mean_with_previous(values: Floats) -> Floats:
    before = np.concatenate([[np.nan], values[:-1]])
    return 0.5 * (before + values)


def _steps(time_s: Floats, counter_rad: Floats, outages_s: Floats, epochs_s: Floats) -> Floats:
    known = np.isfinite(counter_rad)
    time_s, counter_rad = time_s[known], counter_rad[known]
    unknown = np.full(len(epochs_s), np.nan)
    if len(time_s) < 2:
        return unknown
    unbroken = _unbroken(time_s, counter_rad, outages_s)
    total = np.concatenate([[0.0], np.cumsum(np.where(unbroken, np.diff(counter_rad), 0.0))])
    run = np.concatenate([[0], np.cumsum(~unbroken)])
    here = np.interp(epochs_s, time_s, total, left=np.nan, right=np.nan)
    before = np.clip(np.searchsorted(time_s, epochs_s, side="right") - 1, 0, None)
    after = np.clip(np.searchsorted(time_s, epochs_s, side="left"), None, len(time_s) - 1)
    here[run[before] != run[after]] = np.nan
    steps = unknown
    steps[1:] = np.where(run[before][1:] == run[before][:-1], np.diff(here), np.nan)
    return steps


def _unbroken(time_s: Floats, counter_rad: Floats, outages_s: Floats) -> NDArray[np.bool_]:
    """Whether a counter went on from one sample to the next, (n - 1,): no outage, no reset, no step like no other.

    A counter that begins anew or wraps jumps by more than wheels turn, or at least turns unlike before and after.
    """
    step_s = np.diff(time_s)
    rate = np.diff(counter_rad) / step_s
    unbroken = (step_s <= _LONGEST_STEPS * float(np.median(step_s))) & (np.abs(rate) <= _FASTEST_RADPS)
    for outage in outages_s.tolist():
        unbroken[(time_s[:-1] < outage) & (time_s[1:] >= outage)] = False
    if len(rate) > 1:
        around_s = 0.5 * (step_s[1:] + step_s[:-1])
        change = np.abs(np.diff(rate)) > _QUICKEST_RADPS2 * around_s + _JITTER_RAD / around_s
        # The first and the last step have one neighbour, which decides alone.
        from_left, from_right = np.concatenate([change[:1], change]), np.concatenate([change, change[-1:]])
        unbroken &= ~(from_left & from_right)
    return unbroken
