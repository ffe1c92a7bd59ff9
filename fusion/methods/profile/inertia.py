"""Inertial data put right before they are used: their lag against GNSS, and the yaw of their sensor in the vehicle.

Both are learned from the drive itself (``alignment``), and nothing is done where they are not clear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.methods.profile.alignment import Changes, Cue, Estimate, changes_of, mount_yaw, time_lag
from fusion.methods.profile.sampling import binned
from fusion.types import DriveLog

SAMPLE_S = 0.1
"""Denser inertial samples are averaged over slots this long before they are compared."""
CLEAR = 4.0
"""A lag or a yaw is set right from so many sigmas on: below, the estimate may do more harm than the error."""
LAG_FLOOR_S = 0.01
YAW_FLOOR_RAD = np.radians(0.25)
"""One sigma of what the method itself may be wrong by: interpolation, a receiver's own filter, the antenna's place. With
``CLEAR`` the least that is set right is 0.04 s and 1 degree, which move a grade by less than 0.5 %."""
MOST_YAW_RAD = np.radians(45.0)
"""A larger angle is an axis that is not the forward one."""
_FEW = 8
"""Fewer samples are no signal."""


@dataclass(frozen=True)
class Inertia:
    """What is known of a drive's inertial data; ``lag_s`` and ``yaw_rad`` are what was set right (0 where not clear)."""

    lag: Estimate
    yaw: Estimate
    lag_s: float
    yaw_rad: float


def set_right(log: DriveLog) -> tuple[DriveLog, Inertia]:
    """The log with its inertial data at the times and along the axes of the vehicle, and what was found."""
    v = log.velocity
    changes = changes_of(v.time_s, v.vel_n_mps, v.vel_e_mps, v.vel_d_mps)
    lag = _with_floor(time_lag(changes, _cues(log, changes)), LAG_FLOOR_S)
    lag_s = lag.value if _clear(lag) else 0.0
    if lag_s:
        early = {name: getattr(log, name) for name in ("force", "rate", "attitude")}
        log = replace(log, **{name: replace(t, time_s=t.time_s - lag_s) for name, t in early.items()})
    f = log.force
    yaw = _with_floor(mount_yaw(changes, *binned(f.time_s, SAMPLE_S, f.acc_x_mps2, f.acc_y_mps2)), YAW_FLOOR_RAD)
    yaw_rad = yaw.value if _clear(yaw) and abs(yaw.value) < MOST_YAW_RAD else 0.0
    if yaw_rad:
        forward = np.cos(yaw_rad) * f.acc_x_mps2 - np.sin(yaw_rad) * f.acc_y_mps2
        left = np.sin(yaw_rad) * f.acc_x_mps2 + np.cos(yaw_rad) * f.acc_y_mps2
        log = replace(log, force=replace(f, acc_x_mps2=forward, acc_y_mps2=left))
    return log, Inertia(lag, yaw, lag_s, yaw_rad)


def _cues(log: DriveLog, changes: Changes) -> list[Cue]:
    """What shows the lag: forces forward and across, and the turning by gyroscope and by attitude."""
    f, a, w = log.force, log.attitude, log.rate
    known = np.isfinite(a.yaw_rad)
    course = np.unwrap(a.yaw_rad[known])
    one = np.ones(len(changes))
    found = [
        (binned(f.time_s, SAMPLE_S, f.acc_x_mps2), changes.forward_mps, one, False),
        (binned(f.time_s, SAMPLE_S, f.acc_y_mps2), changes.left_mps, one, False),
        (binned(w.time_s, SAMPLE_S, w.gyr_z_radps), changes.left_mps, changes.speed_mps, False),
        (binned(a.time_s[known], SAMPLE_S, course), changes.left_mps, -changes.speed_mps, True),
    ]
    return [
        Cue(time, signal, wanted, factor, angle)
        for (time, signal), wanted, factor, angle in found
        if len(time) >= _FEW
    ]


def _with_floor(estimate: Estimate, floor: float) -> Estimate:
    return Estimate(estimate.value, float(np.hypot(estimate.sigma, floor)))


def _clear(estimate: Estimate) -> bool:
    return bool(abs(estimate.value) > CLEAR * estimate.sigma)
