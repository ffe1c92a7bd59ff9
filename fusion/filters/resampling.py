"""Resampling schemes of a particle filter: weights in, ancestors out.

A scheme maps normalised weights to ``n`` ancestor indices, ascending, so that particle ``i`` has on average
``n * weights[i]`` descendants (unbiased). Al Assaad 2020, section 1.4.3.4.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.filters.random import fill_uniforms, seed_stream
from fusion.registry import Registry

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Resampler(Protocol):
    """``weights`` of shape (n,), non-negative, with a positive sum; ``seed`` and ``step`` key the random draws."""

    def __call__(self, weights: Floats, seed: int, step: int) -> Ints: ...


RESAMPLERS: Registry[Resampler] = Registry("resampling scheme")


@compiled
def _ancestors(weights: Floats, sorted_uniforms: Floats) -> Ints:
    """Invert the cumulative weights at ascending points of [0, 1); rounding in the sum can't lead past the end."""
    n = weights.shape[0]
    total = 0.0
    last = 0
    for i in range(n):
        total += weights[i]
        if weights[i] > 0.0:
            last = i
    out = np.empty(sorted_uniforms.shape[0], np.int64)
    cumulative = weights[0]
    i = 0
    for k in range(sorted_uniforms.shape[0]):
        target = sorted_uniforms[k] * total
        while i < last and cumulative <= target:
            i += 1
            cumulative += weights[i]
        out[k] = i
    return out


@compiled
def _sorted_uniforms(seed: int, step: int, n: int) -> Floats:
    """``n`` sorted uniforms in O(n): normalised partial sums of exponentials."""
    state = np.empty(4, np.uint64)
    seed_stream(seed, step, -1, state)
    gaps = np.empty(n + 1)
    fill_uniforms(state, gaps)
    total = 0.0
    for k in range(n + 1):
        total -= np.log1p(-gaps[k])
        gaps[k] = total
    gaps /= total
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
