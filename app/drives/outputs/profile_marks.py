"""What is drawn of a profile, as numbers on its axes: dots of the sensors, steps of the segments, stretches, limits.

Knows no figure and no matplotlib: ``profile_picture`` draws what is worked out here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.core.messages import say
from app.drives.outputs.profile import Profile
from fusion.messages import told
from fusion.types import DrawnMeasurements, Floats, Ints

Mask = NDArray[np.bool_]

NORMAL_95 = 1.96
"""Half the width of the band that holds 95 % of a normal distribution, in standard deviations."""
NEAR_S = 1.0
"""A measurement in an interruption belongs to an epoch that is no farther away."""
OTHER_DATUM_M = 10.0
"""Heights whose median lies farther from the estimate refer to something else, like the ellipsoid."""
MOST_DOTS = 4000
"""Of one sensor; of more, evenly many are left out."""
LEAST_HEIGHT_M, LEAST_SLOPE_PERCENT = 20.0, 8.0
"""Axes never show less than this, so that a flat road looks flat."""
MORE_SHARE = 0.15
"""Share of an axis by which measurements behind the estimates may widen it at either end."""
PAD_SHARE = 0.04
"""Share of an axis that stays empty at either end."""

_LOOKS = {
    "altitude": ("GNSS altitude", "#3f97d0"),
    "barometer": ("barometer, drift taken off", "#c0699c"),
    "dem": ("elevation model", "#8a8f45"),
    "doppler": ("Doppler", "#2a9d7c"),
    "pitch": ("pitch less mount", "#8d6cc9"),
    "specific force": ("specific force less mount", "#d29a2e"),
}
_OTHER_LOOK = "#8a8f94"


@dataclass(frozen=True, eq=False)
class Dots:
    """One sensor's measurements on the profile's axes: ``value`` in m or in %, shape (n,) like ``distance_m``."""

    label: str
    colour: str
    is_height: bool
    distance_m: Floats
    value: Floats


class Sensed(NamedTuple):
    """One sensor's measurements on the profile's axis, shape (n,) each: heights in m, grades in percent."""

    name: str
    is_height: bool
    along_m: Floats
    time_s: Floats
    value: Floats
    shift_m: float | None
    """What moves heights on another datum to the profile's; None for grades."""


def sensed(profile: Profile, measurements: DrawnMeasurements) -> Iterator[Sensed]:
    """Each sensor's measurements; those that lie where the profile knows no place are left out."""
    along_m = placed_m(profile, measurements.time_s)
    usable = np.isfinite(along_m) & np.isfinite(measurements.value)
    for code, name in enumerate(measurements.names):
        mine = np.flatnonzero(usable & (measurements.sensor == code))
        if not len(mine):
            continue
        where, value = along_m[mine], measurements.value[mine]
        is_height = bool(measurements.is_height[mine[0]])
        shift_m = datum_shift_m(profile, where, value) if is_height else None
        value = value if is_height else 100 * value
        yield Sensed(name, is_height, where, measurements.time_s[mine], value, shift_m)


def dots_of(profile: Profile, measurements: DrawnMeasurements) -> Iterator[Dots]:
    """Each sensor's dots, thinned evenly to ``MOST_DOTS``; heights on another datum moved, which the label says."""
    for one in sensed(profile, measurements):
        label, colour = _LOOKS.get(one.name, (one.name, _OTHER_LOOK))
        moved = one.shift_m or 0.0
        thinning = slice(None, None, -(-len(one.value) // MOST_DOTS))
        label = told(say("picture.moved", name=label, metres=moved) if moved else label)
        yield Dots(label, colour, one.is_height, one.along_m[thinning], one.value[thinning] + moved)


def placed_m(profile: Profile, time_s: Floats) -> Floats:
    """Distance on the profile's axis at each time; NaN where the profile knows no position near that time."""
    if not len(profile):
        return np.full(len(time_s), np.nan)
    own = profile.time_s
    right = np.clip(np.searchsorted(own, time_s), 0, len(own) - 1)
    left = np.maximum(right - 1, 0)
    inside = (time_s >= own[0]) & (time_s <= own[-1]) & (~profile.gap[right] | (own[right] == time_s))
    nearest = np.where(np.abs(time_s - own[left]) <= np.abs(own[right] - time_s), left, right)
    near = np.abs(own[nearest] - time_s) <= NEAR_S
    outside = np.where(near, profile.distance_m[nearest], np.nan)
    return np.where(inside, np.interp(time_s, own, profile.distance_m), outside)


def datum_shift_m(profile: Profile, distance_m: Floats, height_m: Floats) -> float:
    """What to add to heights that refer to something else than the estimate does; 0 where they agree roughly."""
    finite = np.isfinite(profile.alt_m)
    if not finite.any():
        return 0.0
    shift = float(
        np.median(np.interp(distance_m, profile.distance_m[finite], profile.alt_m[finite]) - height_m)
    )
    return shift if abs(shift) > OTHER_DATUM_M else 0.0


@dataclass(frozen=True, eq=False)
class Steps:
    """The slopes of the segments driven over, k of them in order; ``from_m`` and ``to_m`` on the distance axis."""

    from_m: Floats
    to_m: Floats
    slope_percent: Floats
    sigma_percent: Floats


def steps_of(profile: Profile) -> Steps:
    """One step for each stay on a segment with a slope."""
    first, _, from_m, to_m = _runs(profile, profile.segment_id)
    estimated = np.isfinite(profile.slope_percent[first])
    columns = (from_m, to_m, profile.slope_percent[first], profile.slope_sigma_percent[first])
    return Steps(*(column[estimated] for column in columns))


def apart(profile: Profile, steps: Steps) -> Mask:
    """Which steps lie farther from the mean of the line over them than their 95 % bar reaches, shape (k,).

    The line is the grade at each place along the drive; a step is the slope of its whole segment. False where the
    line, or a step's sigma, is not known.
    """
    estimated = np.isfinite(profile.grade_percent)
    if estimated.sum() < 2 or not len(steps.slope_percent):
        return np.zeros(len(steps.slope_percent), np.bool_)
    at, grade = profile.distance_m[estimated], profile.grade_percent[estimated]
    climbed = np.concatenate([[0.0], np.cumsum(np.diff(at) * (grade[1:] + grade[:-1]) / 2)])
    length = steps.to_m - steps.from_m
    rise = np.interp(steps.to_m, at, climbed) - np.interp(steps.from_m, at, climbed)
    on_line = (np.searchsorted(at, steps.to_m, "right") - np.searchsorted(at, steps.from_m)) > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(rise / length - steps.slope_percent) > NORMAL_95 * steps.sigma_percent
    return np.asarray(off & on_line & (length > 0), np.bool_)


def datum_words(report: Mapping[str, Any]) -> str:
    """What the heights of a drive refer to, by its report."""
    datum, dem = report.get("height_datum"), report.get("dem_datum")
    if datum:
        return say("picture.datum", datum=datum)
    return say("picture.dem", dem=dem) if dem else say("picture.no_datum")


def stretches(profile: Profile, mask: Mask, least_s: float = 0.0) -> Floats:
    """(from_m, to_m) of each run of epochs in ``mask`` that lasts ``least_s``, shape (k, 2)."""
    first, last, from_m, to_m = _runs(profile, mask)
    is_long = mask[first] & (profile.time_s[last] - profile.time_s[first] >= least_s)
    return np.column_stack([from_m, to_m])[is_long]


def interruptions(profile: Profile) -> Floats:
    """(from_m, to_m) of what was driven while nothing was estimated, shape (k, 2)."""
    after = np.flatnonzero(profile.gap[1:]) + 1
    return np.column_stack([profile.distance_m[after - 1], profile.distance_m[after]])


def broken(column: Floats, profile: Profile) -> Floats:
    """The column with a NaN before each interruption, so that nothing is drawn across it."""
    return np.insert(column.astype(float), np.flatnonzero(profile.gap[1:]) + 1, np.nan)


def limits(value: Floats, sigma: Floats, least: float, behind: Floats) -> tuple[float, float] | None:
    """Lower and upper end of an axis: every estimate, the band but for its widest parts, what lies near behind.

    The band widens the axis by at most the estimates' own range (or ``least``) on either side, the measurements
    ``behind`` by at most ``MORE_SHARE`` of what there is then. None if nothing is estimated.
    """
    finite = np.isfinite(value)
    if not finite.any():
        return None
    value, half = value[finite], NORMAL_95 * np.nan_to_num(sigma[finite])
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
