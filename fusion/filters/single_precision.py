"""Elementary functions in single precision that compilers can turn into vector instructions, for loops over particles.

The library's functions take 5 to 30 ns each and can't be vectorised. These are polynomials without branches, accurate
to a few units of single precision (the tests say how many). Arguments and results are ``float32``: a literal such as
2.0 would make the arithmetic around it double, which is why the constants have names.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled_vector
from fusion.types import Floats

Single = np.float32
Singles = NDArray[np.float32]
Rank = np.int32

LEAST_RANK = Rank(-(2**31))


def _fitted(function: Callable[[Floats], Floats], low: float, high: float, terms: int) -> list[Single]:
    """Coefficients of a polynomial near the minimax one on [low, high]: interpolation at Chebyshev points."""
    nodes = np.cos(np.pi * (2 * np.arange(terms) + 1) / (2 * terms))
    at = 0.5 * (low + high) + 0.5 * (high - low) * nodes
    return [Single(c) for c in np.polynomial.polynomial.polyfit(at, function(at), terms - 1)]


_ZERO, _HALF, _ONE = Single(0.0), Single(0.5), Single(1.0)
_LN_2, _PER_LN_2 = Single(math.log(2.0)), Single(1.0 / math.log(2.0))
_PI, _HALF_PI = Single(math.pi), Single(0.5 * math.pi)
_TINY = Single(1e-30)
_LEAST_EXPONENT = Single(-40.0)

# A float32 is 2^(bits >> 23 - 127) times a mantissa in its 23 lower bits.
_MANTISSA_BITS, _EXPONENT_BIAS = np.int32(23), np.int32(127)
_SIGN_SHIFT, _BELOW_SIGN = np.int32(31), np.int32(0x7FFFFFFF)
_BITS_OF_SQRT_HALF = np.int32(np.sqrt(Single(0.5)).view(np.int32))

_E0, _E1, _E2, _E3, _E4, _E5, _E6 = _fitted(np.exp, -0.5 * math.log(2.0), 0.5 * math.log(2.0), 7)
_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7 = _fitted(
    lambda f: (np.log1p(f) - f + 0.5 * f * f) / f**3, math.sqrt(0.5) - 1.0, math.sqrt(2.0) - 1.0, 8
)
_S0, _S1, _S2, _S3, _S4 = _fitted(lambda u: np.sin(0.5 * np.pi * np.sqrt(u)) / np.sqrt(u), 0.0, 1.0, 5)
_C0, _C1, _C2, _C3, _C4 = _fitted(lambda u: np.cos(0.5 * np.pi * np.sqrt(u)) / (1.0 - u), 0.0, 1.0, 5)
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7 = _fitted(lambda u: np.arctan(np.sqrt(u)) / np.sqrt(u), 0.0, 1.0, 8)


@compiled_vector
def exp_negative(x: Single) -> Single:
    """e^x for x <= 0; exactly 0 from -40 on, so that even products of such weights stay normal numbers."""
    # Truncation rounds to the nearest whole number, since x is not positive.
    halvings = np.int32(x * _PER_LN_2 - _HALF) if x > _LEAST_EXPONENT else np.int32(0)
    f = x - Single(halvings) * _LN_2
    tail = _E3 + f * (_E4 + f * (_E5 + f * _E6))
    value = _E0 + f * (_E1 + f * (_E2 + f * tail))
    power = np.int32(np.int32(halvings + _EXPONENT_BIAS) << _MANTISSA_BITS).view(np.float32)
    return value * power if x > _LEAST_EXPONENT else _ZERO


@compiled_vector
def log_positive(x: Single) -> Single:
    """ln x for a positive normal number."""
    bits = np.float32(x).view(np.int32)
    power = np.int32(np.int32(bits - _BITS_OF_SQRT_HALF) >> _MANTISSA_BITS)
    f = np.int32(bits - np.int32(power << _MANTISSA_BITS)).view(np.float32) - _ONE
    tail = _L4 + f * (_L5 + f * (_L6 + f * _L7))
    tail = _L0 + f * (_L1 + f * (_L2 + f * (_L3 + f * tail)))
    return Single(power) * _LN_2 + (f - f * f * (_HALF - f * tail))


@compiled_vector
def sin_quarters(x: Single) -> Single:
    """Sine of ``x`` quarter turns, |x| <= 1."""
    u = x * x
    return x * (_S0 + u * (_S1 + u * (_S2 + u * (_S3 + u * _S4))))


@compiled_vector
def cos_quarters(x: Single) -> Single:
    """Cosine of ``x`` quarter turns, |x| <= 1."""
    u = x * x
    return (_ONE - u) * (_C0 + u * (_C1 + u * (_C2 + u * (_C3 + u * _C4))))


@compiled_vector
def atan2_single(y: Single, x: Single) -> Single:
    """atan2(y, x) in [-pi, pi]; 0 within 1e-30 of the origin where x is not negative."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay, _TINY)
    u = t * t
    tail = _A4 + u * (_A5 + u * (_A6 + u * _A7))
    angle = t * (_A0 + u * (_A1 + u * (_A2 + u * (_A3 + u * tail))))
    angle = _HALF_PI - angle if ay > ax else angle
    angle = _PI - angle if x < _ZERO else angle
    return -angle if y < _ZERO else angle


@compiled_vector
def rank_of(x: Single) -> Rank:
    """A whole number that grows with ``x`` (not NaN): of those a loop finds the greatest by whole vector registers."""
    bits = np.float32(x).view(np.int32)
    return np.int32(bits ^ np.int32(np.int32(bits >> _SIGN_SHIFT) & _BELOW_SIGN))


@compiled_vector
def from_rank(rank: Rank) -> Single:
    """The number of this ``rank_of``."""
    return np.int32(rank ^ np.int32(np.int32(rank >> _SIGN_SHIFT) & _BELOW_SIGN)).view(np.float32)
