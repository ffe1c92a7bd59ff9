"""What a log's other sensors say at the epochs of its raw measurements: speed along the ground and yaw rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.gnss.measurements import Aids
from fusion.types import DriveLog, Floats

NEAR_S = 0.6
"""A reading farther from an epoch than this says nothing of it: sensors of cars come once a second or more often."""
SPEED_SIGMA_MPS, SPEED_SCALE = 0.1, 0.01
"""Of a vehicle's speed signal: its steps, and the error of its scale (tyres)."""
HEIGHT_SIGMA_M = 3.0
"""Of the height of a road in an elevation model (notes 6)."""


def aids_of(log: DriveLog, time_s: Floats) -> Aids:
    """What the log's odometer and gyroscope say at times (m,)."""
    speed = _at(log.odometry.time_s, log.odometry.speed_mps, time_s)
    return replace(
        Aids.none(len(time_s)),
        speed_mps=speed,
        speed_sigma_mps=np.hypot(SPEED_SIGMA_MPS, SPEED_SCALE * speed),
        yaw_rate_radps=-_at(log.rate.time_s, log.rate.gyr_z_radps, time_s),
    )


def with_heights(aids: Aids, height_m: Floats) -> Aids:
    """The same with heights of the road above the ellipsoid, (m,), NaN where there is none."""
    sigma = np.where(np.isfinite(height_m), HEIGHT_SIGMA_M, np.nan)
    return replace(aids, height_m=np.asarray(height_m, float), height_sigma_m=sigma)


def _at(time_s: Floats, value: Floats, at_s: Floats) -> Floats:
    """Values at times, interpolated between readings that are near."""
    measured = np.isfinite(value)
    time_s, value = time_s[measured], value[measured]
    if not len(time_s):
        return np.full(len(at_s), np.nan)
    after = np.clip(np.searchsorted(time_s, at_s), 0, len(time_s) - 1)
    before = np.maximum(after - 1, 0)
    near = np.minimum(np.abs(time_s[after] - at_s), np.abs(time_s[before] - at_s)) <= NEAR_S
    return np.where(near, np.interp(at_s, time_s, value), np.nan)
