"""Resampling schemes of a particle filter: weights in, ancestors out (Al Assaad 2020, section 1.4.3.4).

A scheme maps the weights of n particles to n ancestor indices, ascending, so that particle i has on average n w_i
descendants (unbiased) and one of weight 0 has none. All schemes lay ascending points on [0, 1) and take the particle in
whose part (1.52) of the cumulative weights each falls; they differ in where the points lie. In the code a scheme says
for each particle how many points lie below its end of the line, which needs no branch that a processor could guess
wrongly. The draws come from streams keyed by (seed, step, block): the same on any number of threads.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numba import prange

from fusion.compiled import compiled, compiled_parallel
from fusion.filters.random import fill_uniforms, seed_stream
from fusion.registry import Registry
from fusion.types import Floats, Ints


class Resampler(Protocol):
    """``weights`` (n,) are not negative and need not sum to 1; ``seed`` and ``step`` key the random draws.

    Returns the ancestors (n,), ascending. Raises ``ValueError`` for weights without a positive, finite sum.
    """

    def __call__(self, weights: Floats, seed: int, step: int) -> Ints: ...


RESAMPLERS: Registry[Resampler] = Registry("resampling scheme")

_BLOCK = 4096  # weights that one thread takes at a time; draws are keyed by it, so another gives other draws
_BELOW_ONE = 1.0 - 2.0**-53
_ROUNDING = 1e-9  # relative; so much may be lost where an expected number of descendants should be whole


def normalised(log_weights: Floats) -> Floats:
    """Weights (n,) that sum to 1, (1.47); -inf is a weight of 0. Raises ``ValueError`` where none is finite."""
    top = float(np.max(log_weights))
    if not math.isfinite(top):
        raise ValueError("no particle has a finite log weight, or one is NaN or +inf")
    weights: Floats = np.exp(log_weights - top)
    weights /= weights.sum()
    return weights


def multinomial(weights: Floats, seed: int, step: int) -> Ints:
    """Independent draws (1.51), the scheme of the thesis's experiment."""
    return _ancestors(_points_below(_ends(weights), _sorted_uniforms(seed, step, len(weights))))


def residual(weights: Floats, seed: int, step: int) -> Ints:
    """The whole part of n w_i copies of each particle (1.53); independent draws from what is left over (1.54).

    The thesis's text rounds n w_i to the nearest number, which may make more than n copies; spec 1 takes the floor.
    """
    copies, left_over = _whole_parts(weights, _cumulative(weights)[-1])
    below = np.cumsum(copies)
    missing = len(weights) - int(below[-1])
    if missing:
        below += _points_below(_ends(left_over), _sorted_uniforms(seed, step, missing))
    return _ancestors(below)


def stratified(weights: Floats, seed: int, step: int) -> Ints:
    """One independent draw in each of n equal parts of [0, 1)."""
    return _ancestors(_strata_below(_ends(weights), _uniforms(seed, step, len(weights))))


def systematic(weights: Floats, seed: int, step: int) -> Ints:
    """One draw and equal steps (1.55): each particle gets floor or ceil of its expected number of descendants."""
    return _ancestors(_strata_below(_ends(weights), _uniforms(seed, step, 1)))


RESAMPLERS.add("multinomial", multinomial)
RESAMPLERS.add("residual", residual)
RESAMPLERS.add("stratified", stratified)
RESAMPLERS.add("systematic", systematic)


def _cumulative(weights: Floats) -> Floats:
    sums: Floats = _running_sums(np.ascontiguousarray(weights, np.float64))
    if not 0.0 < sums[-1] < math.inf:
        raise ValueError(f"the weights of particles must have a positive, finite sum, not {sums[-1]}")
    return sums


def _ends(weights: Floats) -> Floats:
    """Where the part of each particle ends on [0, 1]: the cumulative weights (1.52); the last is 1 exactly."""
    sums = _cumulative(weights)
    sums /= sums[-1]
    return sums


@compiled_parallel
def _running_sums(weights: Floats) -> Floats:
    """Block by block: on any number of threads the same, and nearer to the true sums than one chain of additions."""
    n = len(weights)
    blocks = (n + _BLOCK - 1) // _BLOCK
    out, totals = np.empty(n), np.empty(blocks)
    for b in prange(blocks):
        begin, end = b * _BLOCK, min(n, (b + 1) * _BLOCK)
        totals[b] = _chain(weights[begin:end], out[begin:end])
    before = np.zeros(blocks)
    _chain(totals[: blocks - 1], before[1:])
    for b in prange(blocks):
        for k in range(b * _BLOCK, min(n, (b + 1) * _BLOCK)):
            out[k] += before[b]
    return out


@compiled
def _chain(values: Floats, out: Floats) -> float:
    """Running sums in the written order: a value of 0 repeats the sum before it to the last bit."""
    total = 0.0
    for k in range(len(values)):
        total += values[k]
        out[k] = total
    return total


@compiled_parallel
def _whole_parts(weights: Floats, total: float) -> tuple[Ints, Floats]:
    """The whole part of n w / total and what is left of it."""
    n = len(weights)
    copies, left_over = np.empty(n, np.int64), np.empty(n)
    for i in prange(n):
        expected = n * (weights[i] / total)
        copies[i] = math.floor((1.0 + _ROUNDING) * expected)
        left_over[i] = max(expected - copies[i], 0.0)
    return copies, left_over


@compiled_parallel
def _points_below(ends: Floats, points: Floats) -> Ints:
    """How many of the ascending points of [0, 1) lie below each end: a merge of the two."""
    n, m = len(ends), len(points)
    out = np.empty(n, np.int64)
    for b in prange((n + _BLOCK - 1) // _BLOCK):
        i, stop = b * _BLOCK, min(n, (b + 1) * _BLOCK)
        k = np.searchsorted(points, ends[i])
        while i < stop and k < m:
            out[i] = k
            below = int(points[k] < ends[i])
            k += below
            i += 1 - below
        out[i:stop] = m
    return out


@compiled_parallel
def _strata_below(ends: Floats, uniforms: Floats) -> Ints:
    """How many of the points (k + u) / n, k < n, lie below each end; ``uniforms``: one u for all, or one each."""
    n, draws = len(ends), len(uniforms)
    out = np.empty(n, np.int64)
    for b in prange((n + _BLOCK - 1) // _BLOCK):
        for i in range(b * _BLOCK, min(n, (b + 1) * _BLOCK)):
            place = n * ends[i]
            stratum = min(int(place), n - 1)
            u = uniforms[min(stratum, draws - 1)]
            out[i] = stratum + int(u < place - stratum)
    return out


@compiled_parallel
def _ancestors(below: Ints) -> Ints:
    """The particle i of each point k: below[i - 1] <= k < below[i]. The last of ``below`` is their number.

    Each particle writes its name where its points begin; one without points is overwritten by its successor.
    """
    n = below[-1]
    out = np.zeros(n, np.int64)
    for b in prange((n + _BLOCK - 1) // _BLOCK):
        begin, end = b * _BLOCK, min(n, (b + 1) * _BLOCK)
        first = np.searchsorted(below, begin, side="right")
        last = np.searchsorted(below, end - 1, side="right")
        out[begin] = first
        for i in range(first, last):
            out[below[i]] = i + 1
        for k in range(begin + 1, end):
            out[k] = max(out[k], out[k - 1])
    return out


@compiled_parallel
def _sorted_uniforms(seed: int, step: int, n: int) -> Floats:
    """``n`` sorted uniforms in O(n): partial sums of n + 1 exponential gaps, over the sum of all."""
    gaps = np.empty(n + 1)
    blocks = n // _BLOCK + 1
    sums = np.zeros(blocks)
    for b in prange(blocks):
        state = np.empty(4, np.uint64)
        seed_stream(seed, step, -1 - b, state)
        part = gaps[b * _BLOCK : min(n + 1, (b + 1) * _BLOCK)]
        fill_uniforms(state, part)
        total = 0.0
        for k in range(len(part)):
            total -= math.log(1.0 - part[k])
            part[k] = total
        sums[b] = total
    before = np.cumsum(sums)
    for b in prange(blocks):
        offset = before[b] - sums[b]
        for k in range(b * _BLOCK, min(n + 1, (b + 1) * _BLOCK)):
            gaps[k] = min((gaps[k] + offset) / before[blocks - 1], _BELOW_ONE)
    return gaps[:n]


@compiled_parallel
def _uniforms(seed: int, step: int, n: int) -> Floats:
    """``n`` independent draws from [0, 1)."""
    out = np.empty(n)
    for b in prange((n + _BLOCK - 1) // _BLOCK):
        state = np.empty(4, np.uint64)
        seed_stream(seed, step, -1 - b, state)
        fill_uniforms(state, out[b * _BLOCK : min(n, (b + 1) * _BLOCK)])
    return out
