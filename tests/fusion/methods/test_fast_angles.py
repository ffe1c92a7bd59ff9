"""The polynomial arctangents against the library's."""

import math

from hypothesis import given
from hypothesis import strategies as st

from fusion.methods.fast_angles import fast_atan, fast_atan2

numbers = st.floats(-1e6, 1e6, allow_subnormal=False).filter(lambda v: v == 0 or abs(v) > 1e-150)


@given(numbers)
def test_atan(value: float) -> None:
    assert abs(fast_atan(value) - math.atan(value)) < 2e-8


@given(numbers, numbers)
def test_atan2(y: float, x: float) -> None:
    difference = fast_atan2(y, x) - math.atan2(y, x)
    # -0.0 and 0.0 differ by a full turn in the library, where a heading of pi and of -pi is the same.
    assert abs(math.remainder(difference, 2 * math.pi)) < 2e-8 or (x == 0 and y == 0)


def test_the_origin_and_the_axes() -> None:
    assert fast_atan2(0.0, 0.0) == 0.0
    assert fast_atan2(1.0, 0.0) == math.pi / 2
    assert abs(fast_atan2(0.0, -1.0) - math.pi) < 1e-15
