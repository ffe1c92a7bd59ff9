"""What a ride's height profile says to a rider: ascent and descent, the steepest stretch, climbs. Knows no drive.

The rules, with where they come from, stand in docs/reference/http.md#rides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.types import Bools, Floats, Ints

STEEPEST_M = 100.0
"""Over so much of the road it is said how steep it is at most."""
SMOOTHED_TURN_M, RAW_TURN_M = 2.0, 10.0
"""A rise or a fall counts from so much on: of heights that a method smoothed along the road, and of others."""
RAMP_PERCENT = 3.0
"""No beginning and no end of a climb is less steep on mean."""
LEAST_GAIN_M = 35.0
"""Of a climb: length (m) times mean grade (percent) is a hundred times its gain, at least 3500."""
LOSS_M, LOSS_SHARE = 15.0, 0.1
"""A climb ends where, after its highest place above the ramp, it has lost as much against it: metres, or a share of
what it has gained by then, whichever is more."""
CATEGORIES = ((80_000.0, "HC"), (64_000.0, "1"), (32_000.0, "2"), (16_000.0, "3"), (8_000.0, "4"))
"""The least score of each."""
_STEP_M = 10.0
_EQUAL = 1e-9
"""Of stretches as steep as each other the first counts; rounding must not choose."""


@dataclass(frozen=True, eq=False)
class HeightLine:
    """Heights along an uninterrupted part of a drive: ascending distances, (n,) each, n >= 2; unknown sigmas are NaN.

    ``grade_sigma_percent`` is known where a method estimated grades, and with them heights that are smooth.
    """

    along_m: Floats
    height_m: Floats
    height_sigma_m: Floats
    grade_sigma_percent: Floats


@dataclass(frozen=True)
class Stretch:
    """A stretch of a drive and its mean grade in the direction of travel; one sigma at most, NaN where unknown."""

    from_m: float
    to_m: float
    percent: float
    sigma_percent: float


@dataclass(frozen=True)
class Climb(Stretch):
    """A climb: from its foot to its top. ``category`` is HC, 1, 2, 3, 4 or None."""

    gain_m: float
    steepest: Stretch
    category: str | None


@dataclass(frozen=True)
class Ascent:
    """Metres climbed and descended, both at least 0; one sigma at most, NaN where unknown."""

    up_m: float
    up_sigma_m: float
    down_m: float
    down_sigma_m: float


def height_lines(
    along_m: Floats, height_m: Floats, height_sigma_m: Floats, grade_sigma_percent: Floats, starts: Bools
) -> list[HeightLine]:
    """The uninterrupted parts of a drive. Rows (n,) each, distances never falling; ``starts``: not joined to the row
    before. Rows without a height are left out; of a standing vehicle the mean counts."""
    known = np.isfinite(height_m)
    part = np.cumsum(starts)[known]
    columns = np.stack([along_m, height_m, height_sigma_m, grade_sigma_percent])[:, known]
    lines = []
    for rows in np.split(columns, np.flatnonzero(np.diff(part)) + 1, axis=1):
        along, row = np.unique(rows[0], return_inverse=True)
        if len(along) > 1:
            count = np.bincount(row)
            means = [np.bincount(row, column) / count for column in rows[1:]]
            lines.append(HeightLine(along, *means))
    return lines


def turns(height_m: Floats, least_m: float) -> Ints:
    """Rows at which heights (n,) turn, the first and the last among them: between the others every rise and fall is
    ``least_m`` or more, and what is less is passed over."""
    steps = np.sign(np.diff(height_m))
    bends = np.flatnonzero(steps[1:] != steps[:-1]) + 1
    found, way, low, high = [0], 0, 0, 0
    for row in (*bends.tolist(), len(height_m) - 1):
        if way >= 0 and height_m[row] > height_m[high]:
            high = row
        if way <= 0 and height_m[row] < height_m[low]:
            low = row
        if way >= 0 and height_m[high] - height_m[row] >= least_m:
            found.append(high)
            way, low = -1, row
        elif way <= 0 and height_m[row] - height_m[low] >= least_m:
            found.append(low)
            way, high = 1, row
    if way:
        found.append(high if way > 0 else low)
    return np.unique([*found, len(height_m) - 1])


def turn_m(line: HeightLine) -> float:
    """From how many metres on a rise or a fall of that line counts."""
    smoothed = np.isfinite(line.grade_sigma_percent).mean() > 0.5
    return SMOOTHED_TURN_M if smoothed else RAW_TURN_M


def ascent(lines: Iterable[HeightLine]) -> Ascent:
    """What was climbed and descended on all lines: their difference is that of the heights at their ends.

    The sigmas take the errors of heights at the turns as independent. They fade with the distance, so that a rise
    between neighbours is better known than that, never worse.
    """
    sums = np.zeros(2)
    variances = np.zeros(2)
    for line in lines:
        rows = turns(line.height_m, turn_m(line))
        legs = np.diff(line.height_m[rows])
        for k, counts in enumerate((legs > 0, legs < 0)):
            sums[k] += np.abs(legs[counts]).sum()
            weight = np.diff(np.r_[0, counts.astype(int), 0])  # of the height at each turn, but for its sign
            variances[k] += np.sum(weight[weight != 0] ** 2 * line.height_sigma_m[rows][weight != 0] ** 2)
    sigmas = np.sqrt(variances)
    return Ascent(float(sums[0]), float(sigmas[0]), float(sums[1]), float(sigmas[1]))


def steepest(lines: Iterable[HeightLine]) -> Stretch | None:
    """The steepest ``STEEPEST_M``, up or down; None where no line is as long."""
    all_of_them = (found for line in lines if (found := _steepest(line, up=False)) is not None)
    return max(all_of_them, key=lambda one: abs(one.percent), default=None)


def climbs(lines: Iterable[HeightLine]) -> list[Climb]:
    """The climbs in the order of driving; they never overlap."""
    return [_climb(line, foot, top) for line in lines for foot, top in _ramps(line)]


def category(score: float) -> str | None:
    """Of a climb by its length (m) times its mean grade (percent)."""
    return next((name for least, name in CATEGORIES if score >= least), None)


def _places(from_m: float, to_m: float) -> Floats:
    return np.linspace(from_m, to_m, max(int(np.ceil((to_m - from_m) / _STEP_M)), 1) + 1)


def _ramps(line: HeightLine) -> Sequence[tuple[float, float]]:
    """Where each climb begins and ends."""
    places = _places(float(line.along_m[0]), float(line.along_m[-1]))
    height = np.interp(places, line.along_m, line.height_m)
    above = height - RAMP_PERCENT / 100 * places
    found, foot, top = [], 0, 0
    for k in range(len(places)):
        if above[k] > above[top]:
            top = k
        loss = max(LOSS_M, LOSS_SHARE * (height[top] - height[foot]))
        ends = above[k] <= above[foot] or above[top] - above[k] >= loss or k == len(places) - 1
        if ends and height[top] - height[foot] >= LEAST_GAIN_M:
            found.append((float(places[foot]), float(places[top])))
        if ends:
            foot = top = k
    return found


def _climb(line: HeightLine, from_m: float, to_m: float) -> Climb:
    whole = _stretch(line, from_m, to_m)
    gain = whole.percent / 100 * (to_m - from_m)
    inside = (line.along_m > from_m) & (line.along_m < to_m)
    places: Floats = np.r_[from_m, line.along_m[inside], to_m]
    columns = (line.height_m, line.height_sigma_m, line.grade_sigma_percent)
    part = HeightLine(places, *(np.interp(places, line.along_m, column) for column in columns))
    return Climb(
        from_m,
        to_m,
        whole.percent,
        whole.sigma_percent,
        gain,
        _steepest(part, up=True) or whole,
        category(100 * gain),
    )


def _steepest(line: HeightLine, *, up: bool) -> Stretch | None:
    """The steepest stretch, up or (unless ``up``) down; None where the line is shorter."""
    first, last = float(line.along_m[0]), float(line.along_m[-1]) - STEEPEST_M
    if last < first:
        return None
    places = _places(first, last)
    rise = np.interp(places + STEEPEST_M, line.along_m, line.height_m)
    rise -= np.interp(places, line.along_m, line.height_m)
    size = rise if up else np.abs(rise)
    where = float(places[np.flatnonzero(size >= size.max() - _EQUAL)[0]])
    return _stretch(line, where, where + STEEPEST_M)


def _stretch(line: HeightLine, from_m: float, to_m: float) -> Stretch:
    """Its sigma is the lesser of two that it cannot be above: by the heights at its ends as if their errors were
    independent, and by its grades as if theirs were all the same."""
    ends = np.array([from_m, to_m])
    low, high = np.interp(ends, line.along_m, line.height_m)
    low_sigma, high_sigma = np.interp(ends, line.along_m, line.height_sigma_m)
    by_heights = 100 * np.hypot(low_sigma, high_sigma) / (to_m - from_m)
    by_grades = np.interp(_places(from_m, to_m), line.along_m, line.grade_sigma_percent).mean()
    return Stretch(
        from_m,
        to_m,
        float(100 * (high - low) / (to_m - from_m)),
        float(np.fmin(by_heights, by_grades)),
    )
