"""Regressions over a drive in which each block of time has a level of its own, and how sure they are.

What changes slowly (grade, bias, mount, drift of a barometer) goes into the levels. Sums of products are kept for each
block. The estimate is made again without each block in turn, and the scatter of these estimates is its sigma, whatever
the errors are like (jackknife; Efron and Tibshirani 1993, chapter 11).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from fusion.types import Bools, Floats, Ints


def binned(time: Floats, period_s: float, *columns: Floats) -> tuple[Floats, ...]:
    """Means of columns over slots of ``period_s``, at their mean times; columns as given where they are sparser."""
    known = np.all(np.isfinite(columns), axis=0)
    time, values = time[known], [c[known] for c in columns]
    if len(time) < 2 or np.median(np.diff(time)) >= 0.95 * period_s:
        return (time, *values)
    slot = np.floor((time - time[0]) / period_s + 1e-6).astype(np.int64)
    _, start, count = np.unique(slot, return_index=True, return_counts=True)
    return tuple(np.add.reduceat(c, start) / count for c in (time, *values))


def spaced(time: Floats, period_s: float) -> Ints:
    """Indices of times at least ``period_s`` apart, the first included."""
    keep, last = [], -np.inf
    for k, t in enumerate(time.tolist()):
        if t - last >= period_s:
            keep.append(k)
            last = t
    return np.array(keep, np.int64)


MIN_BLOCKS = 6
"""Fewer do not show how sure an estimate is."""
MOST_GROUPS = 60
"""Blocks are left out together where there are many."""
CLEAR = 3.0
"""An error of a sensor is set right from so many sigmas on: below, the estimate may do more harm than the error."""
_FAR = 4.0
"""What misses by so many robust sigmas is left out: kerbs, reflections, a hand on the phone."""
_NORMAL = 1.4826
"""Median absolute deviation of a Gaussian error to its sigma."""


class Estimate(NamedTuple):
    """A number and one sigma of it; NaN and infinity where the data say nothing."""

    value: float
    sigma: float

    def worth(self, usual: float, clear: float = CLEAR) -> float:
        """How much to set right: nothing below ``clear`` sigmas, else the value, drawn to 0 by the ``usual`` size."""
        if not abs(self.value) > clear * self.sigma:
            return 0.0
        return self.value * usual**2 / (usual**2 + self.sigma**2)

    def with_floor(self, floor: float) -> Estimate:
        """With the error that the method itself may make."""
        return Estimate(self.value, float(np.hypot(self.sigma, floor)))


NOTHING = Estimate(float("nan"), float("inf"))


def blocks_of(time_s: Floats, length_s: float) -> Ints:
    """The number of each instant's block, shape (n,), from 0."""
    return np.floor((time_s - time_s[:1]) / length_s).astype(np.int64)


def centred(columns: Floats, block: Ints) -> Floats:
    """``columns`` (k, n) less their means in each block."""
    count = np.maximum(np.bincount(block), 1)
    means = np.array([np.bincount(block, row, len(count)) / count for row in columns])
    return np.asarray(columns - means[:, block])


def crossed(columns: Floats, block: Ints) -> Floats:
    """Sums of products of all pairs of columns (k, n), centred, in each block; shape (k, k, blocks)."""
    own = centred(columns, block)
    return np.array([[np.bincount(block, a * b) for b in own] for a in own])


def inliers(columns: Floats, block: Ints) -> Bools:
    """Where the other columns (k, n), fitted by least squares, explain the first as well as usual, shape (n,)."""
    keep = np.ones(columns.shape[1], bool)
    for _ in range(2):
        total = crossed(columns[:, keep], block[keep]).sum(axis=-1)
        part = np.linalg.lstsq(total[1:, 1:], total[1:, 0], rcond=1e-9)[0]
        own = centred(columns, block)
        miss = np.abs(own[0] - part @ own[1:])
        keep = miss <= _FAR * _NORMAL * np.median(miss) + 1e-9
    return keep


def alone(total: Floats, of: int, besides: Sequence[int]) -> Floats:
    """What each column has in common with the part of column ``of`` that ``besides`` do not explain, shape (k,).

    ``total`` are sums of products of all columns, (k, k).
    """
    others = list(besides)
    share = np.linalg.lstsq(total[np.ix_(others, others)], total[others, of], rcond=1e-9)[0]
    return np.asarray(total[:, of] - total[:, others] @ share)


def jackknife(sums: Floats, estimate: Callable[[Floats], float]) -> Estimate:
    """The estimate from sums (..., blocks) over all blocks, and its sigma from leaving out each block in turn.

    A sigma from few blocks is uncertain itself. It is widened until an error of ``CLEAR`` sigmas is as rare as it is
    for a Gaussian.
    """
    some = np.flatnonzero(np.any(sums.reshape(-1, sums.shape[-1]) != 0, axis=0))
    if len(some) < MIN_BLOCKS:
        return NOTHING
    total = sums.sum(axis=-1)
    group = np.array_split(some, min(len(some), MOST_GROUPS))
    without = np.array([estimate(total - sums[..., g].sum(axis=-1)) for g in group])
    value = estimate(total)
    if not np.isfinite(value) or not np.isfinite(without).all():
        return NOTHING
    freedom = len(group) - 1
    sigma = float(np.sqrt(freedom / len(group) * np.sum((without - without.mean()) ** 2)))
    if not sigma:  # all say the same: nothing that differs between them is measured
        return NOTHING
    return Estimate(value, sigma * float(stdtrit(freedom, ndtr(CLEAR))) / CLEAR)


def together(estimates: Sequence[Estimate]) -> Estimate:
    """The mean by their weights; where they contradict each other the sigma says so (Birge 1932)."""
    known = [e for e in estimates if np.isfinite(e.sigma)]
    if not known:
        return NOTHING
    value, sigma = np.array(known).T
    weight = sigma**-2.0
    mean = float(np.average(value, weights=weight))
    apart = float(np.sum(weight * (value - mean) ** 2)) / max(len(known) - 1, 1)
    return Estimate(mean, float(np.sqrt(max(apart, 1.0) / weight.sum())))
