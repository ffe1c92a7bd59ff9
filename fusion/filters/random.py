"""Random numbers for compiled loops that come out the same on any number of threads.

Particles are processed in fixed blocks; each block of each step owns a xoshiro256++ stream (Blackman and
Vigna 2021) keyed by (seed, step, block), so neither the number of threads nor their order can change a
draw. Normals come from a 256-layer ziggurat (Marsaglia and Tsang 2000), a few nanoseconds each.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled

Floats = NDArray[np.float64]
Stream = NDArray[np.uint64]
"""Four words of state of one stream."""

_LAYERS = 256
_TAIL_START = 3.6541528853610088  # right edge of the base layer for 256 layers of equal area
_LAYER_AREA = 4.92867323399e-3

_MASK_53 = np.uint64(0x1FFFFFFFFFFFFF)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_U64 = np.uint64


def _ziggurat_edges() -> Floats:
    """Edges x[0] > x[1] > ... > x[256] = 0 of the layers under exp(-x^2/2); x[0] stands for the tail's box."""
    edges = np.zeros(_LAYERS + 1)
    edges[1] = _TAIL_START
    density = math.exp(-0.5 * _TAIL_START**2)
    edges[0] = _LAYER_AREA / density
    for layer in range(2, _LAYERS):
        density += _LAYER_AREA / edges[layer - 1]
        edges[layer] = math.sqrt(-2 * math.log(density))
    return edges


_EDGES = _ziggurat_edges()
_SCALED_EDGES = _EDGES / 2.0**53
_HEIGHTS = np.exp(-0.5 * _EDGES**2)


@compiled
def _mix(value: Any) -> Any:
    """SplitMix64's finaliser: spreads a counter over 64 bits."""
    value = (value ^ (value >> _U64(30))) * _MIX_1
    value = (value ^ (value >> _U64(27))) * _MIX_2
    return value ^ (value >> _U64(31))


@compiled
def seed_stream(seed: int, step: int, block: int, state: Stream) -> None:
    """Fill ``state`` (uint64[4]) with the stream keyed by (seed, step, block)."""
    key = _mix(_U64(seed) + _GOLDEN) ^ _mix(_U64(step) * _GOLDEN + _MIX_1)
    key = _mix(key + _U64(block) * _MIX_2 + _GOLDEN)
    for k in range(4):
        key = key + _GOLDEN
        state[k] = _mix(key)


@compiled
def next_uint64(state: Stream) -> Any:
    """Advance xoshiro256++ by one and return 64 random bits."""
    total = state[0] + state[3]
    result = ((total << _U64(23)) | (total >> _U64(41))) + state[0]
    shifted = state[1] << _U64(17)
    state[2] ^= state[0]
    state[3] ^= state[1]
    state[1] ^= state[2]
    state[0] ^= state[3]
    state[2] ^= shifted
    state[3] = (state[3] << _U64(45)) | (state[3] >> _U64(19))
    return result


@compiled
def next_uniform(state: Stream) -> float:
    """A uniform draw from [0, 1) on a grid of 2^-53."""
    return float(next_uint64(state) >> _U64(11)) * (1.0 / 9007199254740992.0)


@compiled
def _rare_normal(state: Stream, layer: np.int64, x: float) -> tuple[bool, float]:
    """The 1.2 % of draws that fall outside a layer's rectangle: (accepted, |value|)."""
    if layer == 0:
        while True:
            tail = -math.log(1.0 - next_uniform(state)) / _TAIL_START
            if -2.0 * math.log(1.0 - next_uniform(state)) > tail * tail:
                return True, _TAIL_START + tail
    height = _HEIGHTS[layer] + next_uniform(state) * (_HEIGHTS[layer + 1] - _HEIGHTS[layer])
    return height < math.exp(-0.5 * x * x), x


@compiled
def fill_normals(state: Stream, out: Floats) -> None:
    """Fill the 1-D array ``out`` with independent standard normal draws from the stream ``state``.

    The stream's words live in local variables inside the loop: as array elements each draw would load and
    store them anew, since the compiler cannot know that ``out`` does not overlap them.
    """
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    i = 0
    n = out.shape[0]
    while i < n:
        total = s0 + s3
        bits = ((total << _U64(23)) | (total >> _U64(41))) + s0
        shifted = s1 << _U64(17)
        s2 ^= s0
        s3 ^= s1
        s1 ^= s2
        s0 ^= s3
        s2 ^= shifted
        s3 = (s3 << _U64(45)) | (s3 >> _U64(19))
        layer = np.int64(bits & _U64(255))
        x = np.float64(np.int64(bits >> _U64(11))) * _SCALED_EDGES[layer]
        if x >= _EDGES[layer + 1]:
            state[0], state[1], state[2], state[3] = s0, s1, s2, s3
            accepted, x = _rare_normal(state, layer, x)
            s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
            if not accepted:
                continue
        out[i] = -x if bits & _U64(256) else x
        i += 1
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3


@compiled
def fill_uniforms(state: Stream, out: Floats) -> None:
    """Fill the 1-D array ``out`` with independent uniform draws from [0, 1)."""
    for i in range(out.shape[0]):
        out[i] = next_uniform(state)
