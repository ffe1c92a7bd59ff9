"""The samples of a drive: checked, thinned to those that are matched, and how far was driven between these.

Knows no road.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fusion.compiled import compiled
from fusion.types import Floats, Ints

_SPEED_STEP_S = 3.0  # speeds farther apart than this are a hole: what was driven in between is not known


class DriveSamples(NamedTuple):
    """The samples of a drive, checked: shape (n,) each, NaN where unknown."""

    time_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    speed_mps: Floats
    sigma_m: Floats

    @classmethod
    def of(cls, time_s: ArrayLike, *columns: ArrayLike | None) -> DriveSamples:
        """Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall."""
        time = np.ascontiguousarray(time_s, np.float64)
        filled = [
            np.full(time.shape, np.nan) if c is None else np.ascontiguousarray(c, np.float64) for c in columns
        ]
        if time.ndim != 1 or any(c.shape != time.shape for c in filled):
            raise ValueError(
                f"the columns of a drive must be vectors of one length, not {[c.shape for c in filled]}"
            )
        if not np.isfinite(time).all() or np.any(np.diff(time) < 0):
            raise ValueError("the times of a drive must be known and must not fall")
        return cls(time, *filled)


@compiled
def thin(drive: DriveSamples, spacing: float, dwell_s: float, dwell_mps: float, widest: float) -> Ints:
    """Indices of the samples to keep: each ``spacing`` metres from the one before.

    After ``dwell_s`` without a kept sample the spacing grows by ``dwell_mps`` up to ``widest``. Samples that are
    known to stand still (speed below 0.3 m/s) are kept only beyond ``widest``, since positions wander while a vehicle
    stands. The last sample is kept if it lies a quarter of the spacing from the last kept one.
    """
    time, x, y, speed = drive.time_s, drive.x_m, drive.y_m, drive.speed_mps
    n = len(x)
    chosen = np.empty(n, np.int64)
    count, last = 0, -1
    final = -1
    for i in range(n):
        if not (math.isfinite(x[i]) and math.isfinite(y[i]) and math.isfinite(time[i])):
            continue
        final = i
        if last >= 0:
            idle = time[i] - time[last] - dwell_s
            need = spacing if idle <= 0 else min(spacing + dwell_mps * idle, widest)
            if speed[i] < 0.3:
                need = widest
            if (x[i] - x[last]) ** 2 + (y[i] - y[last]) ** 2 < need * need:
                continue
        chosen[count] = i
        count += 1
        last = i
    if final >= 0 and final != last:
        moved = math.hypot(x[final] - x[last], y[final] - y[last])
        if moved >= 0.25 * spacing and not speed[final] < 0.3 and time[final] - time[last] <= dwell_s:
            chosen[count] = final
            count += 1
    return chosen[:count]


def driven_m(drive: DriveSamples, thinned: Ints) -> Floats:
    """Distance driven from each kept sample to the next by the speeds, NaN where they have outages; (m - 1,)."""
    known = np.flatnonzero(np.isfinite(drive.speed_mps))
    if len(known) < 2:
        return np.full(max(len(thinned) - 1, 0), np.nan)
    time, speed = drive.time_s[known], drive.speed_mps[known]
    lapse = np.diff(time)
    way = np.concatenate([[0.0], np.cumsum(lapse * (speed[1:] + speed[:-1]) / 2)])
    outages = np.concatenate([[0], np.cumsum(lapse > _SPEED_STEP_S)])
    at = drive.time_s[thinned]
    before = np.clip(np.searchsorted(time, at), 0, len(time) - 1)
    outside = (at < time[0] - 1.0) | (at > time[-1] + 1.0)
    broken = (np.diff(outages[before]) > 0) | outside[1:] | outside[:-1]
    return np.where(broken, np.nan, np.diff(np.interp(at, time, way)))
