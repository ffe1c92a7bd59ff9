"""What a profile's picture is made of: lines that break where the drive does, steps, stretches, limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.outputs.profile import Profile
from fusion.types import Floats

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
    """One step for each stay on a segment with a slope, to halfway between its last epoch and the next's first."""
    if not len(profile):
        return Steps(*(np.empty(0) for _ in range(4)))
    first = np.flatnonzero(np.r_[True, (np.diff(profile.segment_id) != 0) | profile.gap[1:]])
    last = np.r_[first[1:], len(profile)] - 1
    start, stop = profile.distance_m[first], profile.distance_m[last]
    touching = ~profile.gap[first[1:]]
    middle = 0.5 * (stop[:-1] + start[1:])
    start = np.r_[start[:1], np.where(touching, middle, start[1:])]
    stop = np.r_[np.where(touching, middle, stop[:-1]), stop[-1:]]
    known = np.isfinite(profile.slope_percent[first])
    columns = (start, stop, profile.slope_percent[first], profile.slope_sigma_percent[first])
    return Steps(*(column[known] for column in columns))


def stretches(profile: Profile, mask: Mask, least_s: float = 0.0) -> Floats:
    """(from_m, to_m) of each run of epochs in ``mask`` that lasts ``least_s``, shape (k, 2); up to its neighbours'.

    A run ends at an interruption.
    """
    edges = (
        np.flatnonzero(np.r_[True, (np.diff(mask) != 0) | profile.gap[1:]]) if len(mask) else np.empty(0, int)
    )
    runs = [
        (first, last)
        for first, last in zip(edges, np.r_[edges[1:], len(mask)] - 1, strict=True)
        if mask[first] and profile.time_s[last] - profile.time_s[first] >= least_s
    ]
    return np.array(
        [
            (_edge(profile, int(first) - 1, int(first)), _edge(profile, int(last), int(last) + 1))
            for first, last in runs
        ]
    ).reshape(-1, 2)


def _edge(profile: Profile, before: int, after: int) -> float:
    """Halfway between two epochs that follow each other; else the place of the one that exists or belongs."""
    if before < 0:
        return float(profile.distance_m[after])
    if after >= len(profile) or profile.gap[after]:
        return float(profile.distance_m[before])
    return float(profile.distance_m[[before, after]].mean())


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
