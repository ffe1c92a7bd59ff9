"""What was measured of a chain of segments, all together: its slope, how sure that is, and where it is steepest.

All segments of a chain run in its direction. What is not known of a segment is NaN and counts nothing: unknown is
never 0. Nothing is known here of where the columns come from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.map.derived.chains import Chains
from fusion.network.segment_slopes import PLACE_SIGMA_M
from fusion.network.steepest import STRETCH_M
from fusion.types import Bools, Floats, Ints

_UNIT = 1e-8
"""Of sums along chains, m (of heights, hundredths of it)."""
_EQUAL = 1e-9
"""Of stretches as steep as each other the first counts; rounding must not choose."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Of n segments what drives measured, shape (n,) each; slopes of what none did (gaps too) are NaN."""

    length_m: Floats
    slope_percent: Floats
    sigma_percent: Floats
    height_from_m: Floats
    height_to_m: Floats
    height_sigma_m: Floats
    steepest_percent: Floats
    steepest_from_m: Floats
    steepest_to_m: Floats

    def along(self, rows: Ints) -> Measured:
        """These rows in this order."""
        return Measured(**{name: values[rows] for name, values in vars(self).items()})


@dataclass(frozen=True, eq=False)
class ChainSlopes:
    """Of m chains, shape (m,); NaN where nothing was measured."""

    length_m: Floats
    slope_percent: Floats
    sigma_percent: Floats
    measured_share: Floats
    steepest_percent: Floats
    steepest_from_m: Floats
    steepest_to_m: Floats


def slopes_along(chains: Chains, segments: Measured) -> ChainSlopes:
    """The mean slope over what was measured of each chain, by length, and the steepest ``STRETCH_M`` of it.

    Errors of neighbours go together, so the sigma of their mean is not smaller for being a mean: it is theirs, by
    length, which is right if they err as one and too large otherwise. What the network knows of the heights at both
    ends of a measured stretch often says more: it counts where it does (``_rise_sigma_m``). Stretches with a gap
    between them are taken to err as one, too.
    """
    s, chain, m = segments.along(chains.rows), chains.number(), len(chains)
    known = np.isfinite(s.slope_percent)
    length = np.asarray(np.bincount(chain, s.length_m, minlength=m), float)
    run = _runs(known, chain)
    measured_m = np.bincount(chain[known], s.length_m[known], minlength=m)
    rise = np.bincount(chain[known], (s.length_m * s.slope_percent)[known], minlength=m)
    first = np.flatnonzero(np.diff(run, prepend=-1) > 0)
    sigma_m = np.bincount(chain[first], _rise_sigma_m(s, known, run, first), minlength=m)
    with np.errstate(invalid="ignore"):
        slope, sigma = rise / measured_m, 100 * sigma_m / measured_m
    offset = _whole(s.length_m)[:-1]
    offset = offset - offset[chains.first[:-1]][chain]
    steepest, begin, end = _steepest(s, known, run, chain, offset, m)
    end = np.minimum(end, length)
    return ChainSlopes(length, slope, sigma, measured_m / length, steepest, begin, end)


def _whole(values: Floats) -> Ints:
    """Sums from 0 on, in whole ``_UNIT``: else the last digits would depend on what other chains come before."""
    return np.concatenate([[0], np.cumsum(np.rint(values / _UNIT).astype(np.int64))])


def _within(x: Ints, at: Ints) -> tuple[Ints, Floats]:
    """The segments between borders ``x`` that places lie in, and how far inside, m."""
    segment = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    return np.asarray(segment, np.int64), np.asarray(_UNIT * (at - x[segment]), float)


def _runs(known: Bools, chain: Ints) -> Ints:
    """The number of the uninterrupted measured stretch that each segment is in, growing; -1 where it is in none."""
    before = np.concatenate([[False], known[:-1]]) & (np.diff(chain, prepend=-1) == 0)
    return np.where(known, np.cumsum(known & ~before) - 1, -1)


def _rise_sigma_m(s: Measured, known: Bools, run: Ints, first: Ints) -> Floats:
    """One standard deviation of how far each run rises, (runs,), m: the smaller of two that both are too large.

    One takes its segments to err as one. The other is of the heights at its ends, as if these erred apart from each
    other, while all heights about a place err together; to it comes what the two say differently of the rise, and that
    nodes lie ``PLACE_SIGMA_M`` beside where the map has them, where the grade is not the mean.
    """
    n = len(first)
    mine, number = np.flatnonzero(known), run[known]
    together = np.bincount(number, (s.length_m * s.sigma_percent)[mine], minlength=n) / 100
    rise = np.bincount(number, (s.length_m * s.slope_percent)[mine], minlength=n) / 100
    length = np.bincount(number, s.length_m[mine], minlength=n)
    last = mine[np.searchsorted(number, np.arange(n), side="right") - 1]
    variance = s.height_sigma_m[first] ** 2 + s.height_sigma_m[last] ** 2
    variance += (s.height_to_m[last] - s.height_from_m[first] - rise) ** 2
    for end in (first, last):
        variance += (PLACE_SIGMA_M * (s.slope_percent[end] / 100 - rise / length)) ** 2
    alone = last == first
    return np.where(alone, together, np.fmin(together, np.sqrt(variance)))


def _steepest(
    s: Measured, known: Bools, run: Ints, chain: Ints, offset: Ints, chains: int
) -> tuple[Floats, Floats, Floats]:
    """Mean grade over the steepest stretch of each chain, %, and where it begins and ends, m from the chain's start.

    Of the heights inside segments only their own steepest stretch is kept; between nodes they are taken for straight.
    So every stretch of ``STRETCH_M`` that begins or ends at a node and lies in one measured run is looked at, which
    finds the steepest of straight pieces, and each segment's own. A chain of which no run is so long has that of the
    steepest of its runs, over all of the run.
    """
    mine = np.flatnonzero(known)
    if not len(mine):
        return np.full(chains, np.nan), np.full(chains, np.nan), np.full(chains, np.nan)
    slope, number = s.slope_percent[mine], run[mine]
    # All runs on one axis: where each segment begins and ends, and the heights there above where the first began.
    x, height = _whole(s.length_m[mine]), _whole(s.length_m[mine] * slope)
    runs = np.arange(number[-1] + 1)
    low = x[:-1][np.searchsorted(number, runs)][number]
    high = x[1:][np.searchsorted(number, runs, side="right") - 1][number]
    stretch = round(STRETCH_M / _UNIT)
    begin = np.concatenate([x[:-1], np.maximum(x[1:] - stretch, low)])
    end = np.concatenate([np.minimum(x[:-1] + stretch, high), x[1:]])
    ((i, left), (j, right)) = (_within(x, at) for at in (begin, end))
    rise = _UNIT * (height[j] - height[i]) + slope[j] * right - slope[i] * left
    grade = np.concatenate([rise / (_UNIT * (end - begin)), s.steepest_percent[mine]])
    # From the run's axis to the chain's.
    shift = np.tile(offset[mine] - x[:-1], 2)
    where = np.concatenate([_UNIT * (begin + shift), _UNIT * offset[mine] + s.steepest_from_m[mine]])
    until = np.concatenate([_UNIT * (end + shift), _UNIT * offset[mine] + s.steepest_to_m[mine]])
    of = np.tile(chain[mine], 3)
    full = (until - where) >= STRETCH_M - 1e-6
    usable = np.isfinite(grade + where + until)
    any_whole = np.zeros(chains, bool)
    any_whole[of[full & usable]] = True
    # A run that is shorter than the stretch counts as a whole, and only where no run is as long as that.
    entire = np.concatenate(
        [(begin <= np.tile(low, 2)) & (end >= np.tile(high, 2)), np.zeros(len(mine), bool)]
    )
    usable &= np.where(any_whole[of], full, entire)
    return _first_steepest(of[usable], grade[usable], where[usable], until[usable], chains)


def _first_steepest(
    of: Ints, grade: Floats, where: Floats, until: Floats, chains: int
) -> tuple[Floats, Floats, Floats]:
    most = np.full(chains, -1.0)
    np.maximum.at(most, of, np.abs(grade))
    steep = np.flatnonzero(np.abs(grade) >= most[of] - _EQUAL * np.maximum(1.0, most[of]))
    steep = steep[np.lexsort((where[steep], of[steep]))]
    chain, at = np.unique(of[steep], return_index=True)
    out = np.full((3, chains), np.nan)
    out[:, chain] = grade[steep[at]], where[steep[at]], until[steep[at]]
    return out[0], out[1], out[2]
