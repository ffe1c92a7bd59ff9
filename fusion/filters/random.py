"""Random numbers for compiled loops that come out the same on any number of threads.

Particles are processed in fixed blocks; each block of each step owns xoshiro256++ streams (Blackman and Vigna 2021)
keyed by (seed, step, block), so neither the number of threads nor their order can change a draw. Where many normals are
needed, a block runs 64 such streams side by side, which processors advance by whole vector registers, and turns pairs
of uniforms into pairs of normals (Box and Muller 1958) by polynomials: below a nanosecond each.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled, compiled_vector
from fusion.filters.single_precision import Single, Singles, cos_quarters, log_positive, sin_quarters
from fusion.types import Floats

Stream = NDArray[np.uint64]
"""Four words of state of one stream."""

LANES = 64  # streams side by side: some vector registers full of 64-bit words
LANE_WORDS = 8 * LANES
Lanes = NDArray[np.uint64]
"""``LANE_WORDS`` words: four rows of state of ``LANES`` streams, then four rows for what they give in four steps."""

GROUP = 8 * LANES
"""Number of 32-bit draws in those four rows."""

# SplitMix64: the step of its counter, and the factors of its finaliser.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_U64 = np.uint64

_I32 = np.int32
_ONE_BIT, _31_BITS = np.int32(1), np.int32(0x7FFFFFFF)
_STEP_31 = Single(2.0**-31)
_ZERO, _HALF, _MINUS_TWO = Single(0.0), Single(0.5), Single(-2.0)


@compiled
def _mix(value: Any) -> Any:
    """SplitMix64's finaliser: spreads a counter over 64 bits."""
    value = (value ^ (value >> _U64(30))) * _MIX_1
    value = (value ^ (value >> _U64(27))) * _MIX_2
    return value ^ (value >> _U64(31))


@compiled
def _key(seed: int, step: int, block: int) -> Any:
    key = _mix(_U64(seed) + _GOLDEN) ^ _mix(_U64(step) * _GOLDEN + _MIX_1)
    return _mix(key + _U64(block) * _MIX_2 + _GOLDEN)


@compiled
def seed_stream(seed: int, step: int, block: int, state: Stream) -> None:
    """Fill ``state`` (uint64[4]) with the stream keyed by (seed, step, block)."""
    key = _key(seed, step, block)
    for k in range(4):
        key = key + _GOLDEN
        state[k] = _mix(key)


@compiled_vector
def _next(s0: Any, s1: Any, s2: Any, s3: Any) -> Any:
    """64 random bits of xoshiro256++, and the state that follows."""
    total = s0 + s3
    bits = ((total << _U64(23)) | (total >> _U64(41))) + s0
    shifted = s1 << _U64(17)
    s2 ^= s0
    s3 ^= s1
    return bits, s0 ^ s3, s1 ^ s2, s2 ^ shifted, (s3 << _U64(45)) | (s3 >> _U64(19))


@compiled
def next_uint64(state: Stream) -> Any:
    """Advance xoshiro256++ by one and return 64 random bits."""
    bits, s0, s1, s2, s3 = _next(state[0], state[1], state[2], state[3])
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3
    return bits


@compiled
def next_uniform(state: Stream) -> float:
    """A uniform draw from [0, 1) on a grid of 2^-53."""
    return float(next_uint64(state) >> _U64(11)) * (1.0 / 9007199254740992.0)


@compiled
def fill_uniforms(state: Stream, out: Floats) -> None:
    """Fill the 1-D array ``out`` with independent uniform draws from [0, 1)."""
    for i in range(out.shape[0]):
        out[i] = next_uniform(state)


@compiled_vector
def seed_lanes(seed: int, step: int, block: int, lanes: Lanes) -> None:
    """Fill ``lanes`` with the streams keyed by (seed, step, block)."""
    key = _key(seed, step, block)
    for i in range(4 * LANES):
        key = key + _GOLDEN
        lanes[i] = _mix(key)


@compiled_vector
def _advance(lanes: Lanes) -> None:
    """Advance every lane by four, so that states are loaded and stored once for four draws."""
    for i in range(LANES):
        s0, s1, s2, s3 = lanes[i], lanes[LANES + i], lanes[2 * LANES + i], lanes[3 * LANES + i]
        first, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
        second, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
        third, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
        fourth, s0, s1, s2, s3 = _next(s0, s1, s2, s3)
        lanes[i], lanes[LANES + i], lanes[2 * LANES + i], lanes[3 * LANES + i] = s0, s1, s2, s3
        lanes[4 * LANES + i], lanes[5 * LANES + i] = first, second
        lanes[6 * LANES + i], lanes[7 * LANES + i] = third, fourth


@compiled_vector
def _fraction(bits: np.int32) -> Single:
    """A uniform draw from (0, 1] out of the 31 upper ones of 32 random bits."""
    return (Single(_I32(_I32(bits >> _ONE_BIT) & _31_BITS)) + _HALF) * _STEP_31


@compiled_vector
def _fill_pairs(lanes: Lanes, out: Singles) -> None:
    """Fill ``out`` (GROUP,) with normals, in pairs that lie half a group apart."""
    _advance(lanes)
    bits = lanes[4 * LANES :].view(np.int32)
    for i in range(GROUP // 2):
        first, second = bits[i], bits[GROUP // 2 + i]
        # The radius ends at 6.7; the bit that it leaves over is the half of the circle.
        radius = Single(math.sqrt(max(_MINUS_TWO * log_positive(_fraction(first)), _ZERO)))
        quarters = Single(second) * _STEP_31
        across = radius * cos_quarters(quarters)
        out[i] = radius * sin_quarters(quarters)
        out[GROUP // 2 + i] = -across if first & _ONE_BIT else across


@compiled_vector
def fill_normals(lanes: Lanes, out: Singles) -> None:
    """Fill the 1-D array ``out`` with independent standard normal draws of single precision, |draw| < 6.7.

    Each call begins with a fresh group of draws; what the last group of a call leaves over is lost.
    """
    n = len(out)
    whole = n - n % GROUP
    for begin in range(0, whole, GROUP):
        _fill_pairs(lanes, out[begin : begin + GROUP])
    if whole < n:
        rest = np.empty(GROUP, np.float32)
        _fill_pairs(lanes, rest)
        for i in range(whole, n):
            out[i] = rest[i - whole]
