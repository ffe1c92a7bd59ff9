"""What a profile's picture is made of: lines that break where the drive does, steps, stretches, limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.outputs.profile import Profile
from fusion.types import Floats, Ints

NORMAL_95 = 1.96
Mask = NDArray[np.bool_]

LEAST_HEIGHT_M, LEAST_SLOPE_PERCENT = 20.0, 8.0
"""Axes never show less than this, so that a flat road looks flat."""
MOST_SLOPE_PERCENT = 50.0
LEAST_OUTAGE_S = 3.0
MORE_SHARE, PAD_SHARE = 0.15, 0.04


@dataclass(frozen=True, eq=False)
class Steps:
    """The slopes of the segments driven over, k of them in order; ``from_m`` and ``to_m`` on the distance axis."""

    from_m: Floats
    to_m: Floats
    slope_percent: Floats
    sigma_percent: Floats


def broken(column: Floats, profile: Profile) -> Floats:
    """The column with a NaN before each interruption, so that nothing is drawn across it."""
    return np.insert(column.astype(float), np.flatnonzero(profile.gap[1:]) + 1, np.nan)


def steps_of(profile: Profile) -> Steps:
    """One step for each stay on a segment with a slope."""
    first, _, from_m, to_m = _runs(profile, profile.segment_id)
    known = np.isfinite(profile.slope_percent[first])
    columns = (from_m, to_m, profile.slope_percent[first], profile.slope_sigma_percent[first])
    return Steps(*(column[known] for column in columns))


def stretches(profile: Profile, mask: Mask, least_s: float = 0.0) -> Floats:
    """(from_m, to_m) of each run of epochs in ``mask`` that lasts ``least_s``, shape (k, 2)."""
    first, last, from_m, to_m = _runs(profile, mask)
    chosen = mask[first] & (profile.time_s[last] - profile.time_s[first] >= least_s)
    return np.column_stack([from_m, to_m])[chosen]


def _runs(profile: Profile, column: Ints | Mask) -> tuple[Ints, Ints, Floats, Floats]:
    """First and last epoch of each run of equal values, and from where to where it reaches on the distance axis.

    Runs meet halfway between the last epoch of one and the first of the next, but not across an interruption.
    """
    if not len(profile):
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0)
    first = np.flatnonzero(np.r_[True, (column[1:] != column[:-1]) | profile.gap[1:]])
    last = np.r_[first[1:], len(profile)] - 1
    from_m, to_m = profile.distance_m[first], profile.distance_m[last]
    touching = ~profile.gap[first[1:]]
    border = 0.5 * (to_m[:-1] + from_m[1:])
    from_m = np.r_[from_m[0], np.where(touching, border, from_m[1:])]
    to_m = np.r_[np.where(touching, border, to_m[:-1]), to_m[-1]]
    return first, last, from_m, to_m


def interruptions(profile: Profile) -> Floats:
    """(from_m, to_m) of what was driven while nothing was estimated, shape (k, 2)."""
    after = np.flatnonzero(profile.gap[1:]) + 1
    return np.column_stack([profile.distance_m[after - 1], profile.distance_m[after]])


def limits(value: Floats, sigma: Floats, least: float, behind: Floats) -> tuple[float, float] | None:
    """Lower and upper end of an axis: every estimate, the band but for its widest parts, what lies near behind.

    The band widens the axis by at most the estimates' own range (or ``least``) on either side, the measurements
    ``behind`` by at most ``MORE_SHARE`` of what there is then. None if nothing is estimated.
    """
    known = np.isfinite(value)
    if not known.any():
        return None
    value, half = value[known], NORMAL_95 * np.nan_to_num(sigma[known])
    low, high = float(value.min()), float(value.max())
    room = max(high - low, least)
    bottom = max(min(low, float(np.quantile(value - half, 0.02))), low - room)
    top = min(max(high, float(np.quantile(value + half, 0.98))), high + room)
    missing = max(least - (top - bottom), 0.0)
    bottom, top = bottom - missing / 2, top + missing / 2
    more = MORE_SHARE * (top - bottom)
    if len(behind):
        lowest, highest = np.quantile(behind, (0.005, 0.995))
        bottom, top = (
            min(bottom, max(float(lowest), bottom - more)),
            max(top, min(float(highest), top + more)),
        )
    pad = PAD_SHARE * (top - bottom)
    return bottom - pad, top + pad
