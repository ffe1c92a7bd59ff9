"""How inertial data lie in time and in direction against GNSS: their lag, and the yaw of the sensor in the vehicle.

Arrays in, an estimate with its sigma out; what is done with it is not known here (``inertia``). Both come from the same
sums: changes of velocity over about a second by GNSS, against what the inertial sensor shows of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from fusion.frames import GRAVITY_MPS2, wrap_angle
from fusion.types import Bools, Floats, Ints

WINDOW_S = 1.0
"""Changes of velocity are taken over this long: of Doppler's 0.05 m/s they are clear, and no manoeuvre is lost."""
LONGEST_WINDOW_S = 2.5
"""Sparser velocities have lost the manoeuvres."""
MIN_SPEED_MPS = 3.0
"""Slower, the course is noise, and a vehicle may go backwards."""
BLOCK_S = 10.0
"""Grade, bias and mount hardly change in this time: each block has a level of its own. Blocks are also what is left out
in turn to see how sure an estimate is (jackknife; Efron and Tibshirani 1993, chapter 11)."""
MIN_BLOCKS = 5
MOST_GROUPS = 60
"""Blocks are left out together where there are many."""
LONGEST_LAG_S = 0.8
"""Lags are looked for up to here, every ``_STEP_S``."""
_STEP_S = 0.05
_FAR = 4.0
"""Changes that miss by so many robust sigmas are left out: kerbs, reflections, a hand on the phone."""
_NORMAL = 1.4826
"""Median absolute deviation of a Gaussian error to its sigma."""


class Estimate(NamedTuple):
    """A number and one sigma of it; NaN and infinity where the data say nothing."""

    value: float
    sigma: float


NOTHING = Estimate(float("nan"), float("inf"))


@dataclass(frozen=True, eq=False)
class Changes:
    """Changes of velocity between pairs of instants, by GNSS; columns of shape (n,).

    ``forward_mps``: of the speed; ``left_mps``: across, to the left; ``gravity_mps``: what the slope, by the climb, adds
    to the force forward (0 unknown); ``speed_mps``: the mean; ``block``: its number.
    """

    begin_s: Floats
    end_s: Floats
    forward_mps: Floats
    left_mps: Floats
    gravity_mps: Floats
    speed_mps: Floats
    block: Ints

    def __len__(self) -> int:
        return len(self.begin_s)

    def take(self, keep: Bools) -> Changes:
        """Some of them."""
        return Changes(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Cue:
    """An inertial signal (m,) at ``time_s``, and the changes ``wanted`` (n,) that its own should be proportional to.

    ``factor`` (n,) is what a change of the signal's integral is multiplied with; an ``angle`` is an integral already.
    """

    time_s: Floats
    signal: Floats
    wanted: Floats
    factor: Floats
    angle: bool = False

    def shown(self, begin_s: Floats, end_s: Floats) -> Floats:
        """What the signal shows between instants, shape (n,)."""
        start = self.time_s[0]
        spline = self._spline
        return np.asarray(self.factor * (spline(end_s - start) - spline(begin_s - start)))

    @cached_property
    def _spline(self) -> scipy.interpolate.PPoly:
        """The integral of the signal between its samples."""
        spline = scipy.interpolate.CubicSpline(self.time_s - self.time_s[0], self.signal)
        return spline if self.angle else spline.antiderivative()


def changes_of(time_s: Floats, north_mps: Floats, east_mps: Floats, down_mps: Floats) -> Changes:
    """The changes of a Doppler velocity, where it moves on without gaps."""
    known = np.isfinite(north_mps + east_mps)
    time, north, east, down = (c[known] for c in (time_s, north_mps, east_mps, down_mps))
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    apart = max(1, round(WINDOW_S / step))
    if not len(time) > apart or step * apart > LONGEST_WINDOW_S:
        return Changes(*np.empty((6, 0)), np.empty(0, np.int64))
    begin, end = slice(None, -apart), slice(apart, None)
    speed = np.hypot(north, east)
    turned = wrap_angle(np.diff(np.arctan2(north, east), prepend=0.0))  # anticlockwise, sample by sample
    angle = np.concatenate([[0.0], np.cumsum(turned[1:])])
    middle = 0.5 * (speed[begin] + speed[end])
    left = middle * (angle[end] - angle[begin])
    climb = -0.5 * np.nan_to_num(down[begin] + down[end]) / np.maximum(middle, MIN_SPEED_MPS)
    gravity = GRAVITY_MPS2 * climb * (time[end] - time[begin])
    block = np.floor((time[begin] - time[0]) / BLOCK_S).astype(np.int64)
    found = Changes(time[begin], time[end], speed[end] - speed[begin], left, gravity, middle, block)
    whole = found.end_s - found.begin_s < 1.2 * step * apart
    return found.take(whole & (np.minimum(speed[begin], speed[end]) > MIN_SPEED_MPS))


def time_lag(changes: Changes, cues: Sequence[Cue]) -> Estimate:
    """How late the inertial signals are against GNSS, s."""
    return _together([_lag_of(changes, cue) for cue in cues])


def _together(estimates: Sequence[Estimate]) -> Estimate:
    """Their mean by their weights; where they contradict each other the sigma says so (Birge 1932)."""
    known = [e for e in estimates if np.isfinite(e.sigma)]
    if not known:
        return NOTHING
    value, sigma = np.array(known).T
    weight = sigma**-2.0
    mean = float(np.average(value, weights=weight))
    apart = float(np.sum(weight * (value - mean) ** 2)) / max(len(known) - 1, 1)
    return Estimate(mean, float(np.sqrt(max(apart, 1.0) / weight.sum())))


def _lag_of(changes: Changes, cue: Cue) -> Estimate:
    """The lag at which one signal correlates best with the changes that it should show."""
    lags = np.arange(-LONGEST_LAG_S, LONGEST_LAG_S + _STEP_S / 2, _STEP_S)
    keep = _recorded(cue.time_s, changes.begin_s - LONGEST_LAG_S, changes.end_s + LONGEST_LAG_S)
    keep &= np.isfinite(cue.wanted)
    if not keep.any():
        return NOTHING
    wanted, block = cue.wanted[keep], changes.block[keep]
    shown = np.array([cue.shown(changes.begin_s + lag, changes.end_s + lag)[keep] for lag in lags])
    for _ in range(2):
        best = int(np.argmax(_correlation(_block_sums(shown, wanted, block).sum(axis=-1))))
        near = _not_far(shown[best], wanted, block)
        shown, wanted, block = shown[:, near], wanted[near], block[near]
    return _jackknife(_block_sums(shown, wanted, block), lambda total: _peak(lags, _correlation(total)))


def mount_yaw(changes: Changes, time_s: Floats, forward_mps2: Floats, left_mps2: Floats) -> Estimate:
    """How far an accelerometer's forward axis points to the left of the vehicle's, rad; samples of shape (m,).

    Of the acceleration across by GNSS both axes show a part: their ratio is the angle's tangent. Change of speed (and
    the squat with it) and gravity on slopes are taken out first. That the force across is also gravity's, where the body
    rolls, is no harm: what leaks into the forward axis is what was felt.
    """
    keep = _recorded(time_s, changes.begin_s, changes.end_s)
    if not keep.any():
        return NOTHING
    changes = changes.take(keep)
    one = np.ones(len(changes))
    felt = [
        Cue(time_s, f, one, one).shown(changes.begin_s, changes.end_s) for f in (forward_mps2, left_mps2)
    ]
    columns = np.array([*felt, changes.left_mps, changes.forward_mps, changes.gravity_mps])
    block = changes.block
    for _ in range(2):
        part = _partial(_crossed(columns, block).sum(axis=-1))
        near = _near(part @ _centred(columns, block)[2:] - _centred(columns, block)[0])
        columns, block = columns[:, near], block[near]
    return _jackknife(_crossed(columns, block), _yaw)


def _partial(total: Floats) -> Floats:
    """Regression of the first column on the last three by their sums of products (5, 5): coefficients (3,)."""
    return np.linalg.lstsq(total[2:, 2:], total[2:, 0], rcond=1e-9)[0]


def _yaw(total: Floats) -> float:
    """The angle by sums of products (5, 5) of the forces forward and left, and of changes left, forward, by gravity."""
    share = np.linalg.lstsq(total[3:, 3:], total[3:, 2], rcond=1e-9)[0]
    forward, left = total[:2, 2] - total[:2, 3:] @ share
    return float(np.arctan2(forward, left))


def _crossed(columns: Floats, block: Ints) -> Floats:
    """Sums of products of all pairs of columns (k, n) in each block, shape (k, k, blocks)."""
    centred = _centred(columns, block)
    return np.array([[np.bincount(block, a * b) for b in centred] for a in centred])


def _recorded(time_s: Floats, begin_s: Floats, end_s: Floats) -> Bools:
    """Whether the samples go through from ``begin_s`` to ``end_s``."""
    if len(time_s) < 4:
        return np.zeros(len(begin_s), bool)
    step = np.diff(time_s)
    gaps = np.concatenate([[0], np.cumsum(step > max(2.5 * float(np.median(step)), 0.3))])
    inside = (begin_s >= time_s[0]) & (end_s <= time_s[-1])
    first = np.searchsorted(time_s, begin_s, side="right") - 1
    last = np.searchsorted(time_s, end_s, side="left")
    return np.asarray(inside & (gaps[np.clip(first, 0, None)] == gaps[np.clip(last, None, len(time_s) - 1)]))


def _centred(value: Floats, block: Ints) -> Floats:
    """``value`` (..., n) less its mean in each block."""
    count = np.maximum(np.bincount(block), 1)
    rows = value.reshape(-1, value.shape[-1])
    means = np.array([np.bincount(block, row, len(count)) / count for row in rows])
    return np.asarray((rows - means[:, block]).reshape(value.shape))


def _products(value: Floats, other: Floats, block: Ints) -> Floats:
    """Sums of ``value`` (k, n) times ``other`` (n,) or (k, n) in each block, both centred; shape (k, blocks)."""
    product = _centred(value, block) * _centred(other, block)
    return np.array([np.bincount(block, row) for row in product])


def _block_sums(shown: Floats, wanted: Floats, block: Ints) -> Floats:
    """Of shown squared, of shown times wanted and of wanted squared, shape (3, k, blocks) for ``shown`` (k, n)."""
    square = _products(wanted[None], wanted, block)
    return np.array(
        [
            _products(shown, shown, block),
            _products(shown, wanted, block),
            np.broadcast_to(square, (len(shown), square.shape[1])),
        ]
    )


def _correlation(total: Floats) -> Floats:
    """Of shown and wanted by their sums (3, k)."""
    return np.asarray(total[1] / np.sqrt(np.maximum(total[0] * total[2], 1e-30)))


def _not_far(shown: Floats, wanted: Floats, block: Ints) -> Bools:
    """Which changes the signal shows to ``_FAR`` robust sigmas, at the gain that fits them all."""
    shown, wanted = _centred(shown, block), _centred(wanted, block)
    return _near(wanted - shown * np.sum(shown * wanted) / max(float(np.sum(shown**2)), 1e-30))


def _near(miss: Floats) -> Bools:
    miss = np.abs(miss)
    return np.asarray(miss <= _FAR * _NORMAL * np.median(miss) + 1e-9)


def _peak(lags: Floats, correlation: Floats) -> float:
    """Where a parabola through the highest value and its neighbours is highest; NaN at the edge of the search."""
    best = int(np.argmax(correlation))
    if best in (0, len(lags) - 1):
        return float("nan")
    low, middle, high = correlation[best - 1 : best + 2]
    curvature = low - 2 * middle + high
    return float(lags[best] + 0.5 * _STEP_S * (low - high) / curvature) if curvature < 0 else float(lags[best])


def _jackknife(sums: Floats, estimate: Callable[[Floats], float]) -> Estimate:
    """The estimate from sums (..., blocks) over all blocks, and its sigma from leaving out each block in turn."""
    some = np.flatnonzero(np.any(sums.reshape(-1, sums.shape[-1]) != 0, axis=0))
    if len(some) < MIN_BLOCKS:
        return NOTHING
    total = sums.sum(axis=-1)
    group = np.array_split(some, min(len(some), MOST_GROUPS))
    without = np.array([estimate(total - sums[..., g].sum(axis=-1)) for g in group])
    value = estimate(total)
    if not np.isfinite(value) or not np.isfinite(without).all():
        return NOTHING
    share = (len(group) - 1) / len(group)
    return Estimate(value, float(np.sqrt(share * np.sum((without - without.mean()) ** 2))))
