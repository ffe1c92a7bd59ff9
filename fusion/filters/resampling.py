"""Resampling schemes of a particle filter: weights in, ancestors out.

A scheme maps normalised weights to ``n`` ancestor indices, ascending, so that particle ``i`` has on average
``n * weights[i]`` descendants (unbiased). Al Assaad 2020, section 1.4.3.4.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numba import prange
from numpy.typing import NDArray

from fusion.compiled import compiled, compiled_parallel
from fusion.filters.random import fill_uniforms, seed_stream
from fusion.registry import Registry

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Resampler(Protocol):
    """``weights`` of shape (n,), non-negative, with a positive sum; ``seed`` and ``step`` key the random draws."""

    def __call__(self, weights: Floats, seed: int, step: int) -> Ints: ...


RESAMPLERS: Registry[Resampler] = Registry("resampling scheme")


_BLOCK = 4096


@compiled_parallel
def _ancestors(weights: Floats, sorted_uniforms: Floats) -> Ints:
    """Invert the cumulative weights at ascending points of [0, 1); rounding in the sum can't lead past the end."""
    n = len(weights)
    cumulative = np.cumsum(weights)
    last = n - 1
    while last > 0 and weights[last] <= 0.0:
        last -= 1
    out = np.empty(len(sorted_uniforms), np.int64)
    for b in prange((len(out) + _BLOCK - 1) // _BLOCK):
        begin = b * _BLOCK
        i = min(np.searchsorted(cumulative, sorted_uniforms[begin] * cumulative[n - 1], side="right"), last)
        for k in range(begin, min(len(out), begin + _BLOCK)):
            target = sorted_uniforms[k] * cumulative[n - 1]
            while i < last and cumulative[i] <= target:
                i += 1
            out[k] = i
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
            gaps[k] = (gaps[k] + offset) / before[blocks - 1]
    return gaps[:n]


@compiled
def _first_uniform(seed: int, step: int) -> float:
    state = np.empty(4, np.uint64)
    seed_stream(seed, step, -1, state)
    out = np.empty(1)
    fill_uniforms(state, out)
    return float(out[0])


def multinomial(weights: Floats, seed: int, step: int) -> Ints:
    """Independent draws (1.51), the scheme of the thesis's experiment."""
    ancestors: Ints = _ancestors(weights, _sorted_uniforms(seed, step, len(weights)))
    return ancestors


def systematic(weights: Floats, seed: int, step: int) -> Ints:
    """One draw and equal steps (1.55): each particle gets floor or ceil of its expected number of descendants."""
    n = len(weights)
    ancestors: Ints = _ancestors(weights, (np.arange(n) + _first_uniform(seed, step)) / n)
    return ancestors


RESAMPLERS.add("multinomial", multinomial)
RESAMPLERS.add("systematic", systematic)
