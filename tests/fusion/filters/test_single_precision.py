"""The polynomials in single precision against the library's functions in double."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters import single_precision as fm

ULP = 2.0**-23
numbers = st.floats(-(2.0**20), 2.0**20, width=32).filter(lambda v: v == 0 or abs(v) > 2.0**-40)


def singles(low: float, high: float) -> np.ndarray:
    return np.linspace(low, high, 20_001).astype(np.float32)


def worst(function, reference, at: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    found = np.array([float(function(x)) for x in at])
    return float(np.max(np.abs(found - reference(at.astype(float)))))


def test_exponential_of_what_is_not_positive() -> None:
    def relative(x: np.float32) -> float:
        return float(fm.exp_negative(x)) / math.exp(float(x)) - 1.0

    assert worst(relative, np.zeros_like, singles(-1.0, 0.0)) < 1.5 * ULP
    # The argument's own last bit is worth more, the larger it is.
    assert worst(relative, np.zeros_like, singles(-39.9, 0.0)) < 12 * ULP
    assert fm.exp_negative(np.float32(0.0)) == 1.0


@pytest.mark.parametrize("x", [-40.0, -87.0, -1e30, -math.inf])
def test_weights_too_small_to_count_are_exactly_zero(x: float) -> None:
    assert fm.exp_negative(np.float32(x)) == 0.0


def test_logarithm_to_the_last_bits_also_near_one() -> None:
    def relative(x: np.float32) -> float:
        return float(fm.log_positive(x)) / math.log(float(x)) - 1.0

    assert worst(relative, np.zeros_like, np.geomspace(1e-37, 0.999, 20_001).astype(np.float32)) < 2 * ULP
    assert worst(relative, np.zeros_like, 1.0 - 2.0 ** -np.arange(1.0, 24.0, dtype=np.float32)) < 2 * ULP
    assert fm.log_positive(np.float32(1.0)) == 0.0


def test_quarter_circle() -> None:
    grid = singles(-1.0, 1.0)
    assert worst(fm.sin_quarters, lambda x: np.sin(0.5 * np.pi * x), grid) < 2 * ULP
    assert worst(fm.cos_quarters, lambda x: np.cos(0.5 * np.pi * x), grid) < 2 * ULP


@given(numbers, numbers)
def test_atan2(y: float, x: float) -> None:
    difference = float(fm.atan2_single(np.float32(y), np.float32(x))) - math.atan2(y, x)
    # -0.0 and 0.0 differ by a full turn in the library, where a heading of pi and of -pi is the same.
    assert abs(math.remainder(difference, 2 * math.pi)) < 5e-7 or (x == 0 and y == 0)


def test_the_origin_and_the_axes() -> None:
    def at(y: float, x: float) -> float:
        return float(fm.atan2_single(np.float32(y), np.float32(x)))

    assert at(0.0, 0.0) == 0.0
    assert at(1.0, 0.0) == -at(-1.0, 0.0) == pytest.approx(0.5 * math.pi, abs=1e-7)
    assert at(0.0, -1.0) == pytest.approx(math.pi, abs=2e-7)


@given(st.floats(width=32, allow_nan=False), st.floats(width=32, allow_nan=False))
def test_ranks_are_ordered_as_the_numbers_are(a: float, b: float) -> None:
    # Sorting keeps 0 and -0 as they come, and -0 ranks below.
    low, high = (fm.rank_of(np.float32(v)) for v in sorted((a, b), key=lambda v: (v, math.copysign(1.0, v))))
    assert low <= high
    assert low > fm.LEAST_RANK
    assert fm.from_rank(low) == min(a, b)
