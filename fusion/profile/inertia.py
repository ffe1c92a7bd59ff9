"""Inertial data put right before they are used: their lag against GNSS, and the yaw of their sensor in the vehicle.

Both are learned from the drive itself (``alignment``), and nothing is done where they are not clear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.profile.alignment import (
    INERTIAL_SAMPLE_S,
    Changes,
    Cue,
    Signal,
    changes_of,
    mount_yaw,
    time_lag,
)
from fusion.profile.blocks import Estimate
from fusion.profile.sampling import binned
from fusion.types import DriveLog, Floats

LAG_FLOOR_S = 0.01
YAW_FLOOR_RAD = np.radians(0.25)
"""One sigma of what the method itself may be wrong by: interpolation, a receiver's own filter, the antenna's place. So
the least that is set right is 0.03 s and 1 degree."""
USUAL_LAG_S, USUAL_YAW_RAD = 0.2, np.radians(5.0)
"""How large such errors usually are, where there are any: filters of a few samples, a phone in its holder."""
CLEAR_YAW = 4.0
"""Sigmas from which on a yaw is set right: few bends can look like one (1 drive in 60 by 3 sigma), and forces that are
turned wrongly do more harm than those that are a little late."""
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
