"""Pass factors as bytes and back, bit by bit."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.pass_factor import PassFactor, symmetric

numbers = st.floats(allow_nan=False, allow_infinity=False)


def factor_of(seed: int, size: int, segments: tuple[int, ...] = (7,), **given_values: float) -> PassFactor:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size)) * 10.0 ** rng.integers(-8, 8, (size, 1))
    values = {
        "slope_percent": 3.1,
        "slope_sigma_percent": 0.2,
        "start_m": 0.0,
        "end_m": 31.0,
        "roughness": 3e-5,
        "observations": 4,
        "first_time_s": 1_717_394_400.125,
        "last_time_s": 1_717_394_405.375,
    } | given_values
    return PassFactor(segments, symmetric((root @ root.T)[np.triu_indices(size)], size), root[0], **values)  # type: ignore[arg-type]


def assert_same(left: PassFactor, right: PassFactor) -> None:
    for field in fields(PassFactor):
        a, b = getattr(left, field.name), getattr(right, field.name)
        assert type(a) is type(b), field.name
        if isinstance(a, np.ndarray):
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
        else:
            assert a == b, field.name


@given(
    seed=st.integers(0, 2**31),
    size=st.integers(2, 60),
    slope=numbers,
    roughness=numbers,
    time_s=st.floats(0, 4e9),
    observations=st.integers(1, 10**9),
    segments=st.lists(st.integers(0, 2**62), min_size=1, max_size=5).map(tuple),
)
def test_what_is_encoded_comes_back_bit_by_bit(
    seed: int,
    size: int,
    slope: float,
    roughness: float,
    time_s: float,
    observations: int,
    segments: tuple[int, ...],
) -> None:
    factor = factor_of(
        seed, size, segments, slope_percent=slope, roughness=roughness, first_time_s=time_s, observations=observations
    )  # fmt: skip
    data = factor.encode()
    again = PassFactor.decode(data, segments)
    assert_same(factor, again)
    assert again.encode() == data


def test_a_factor_is_as_large_as_its_numbers() -> None:
    """What a thousand drives over a road cost on disk: nine numbers, the vector, half of the matrix."""
    assert len(factor_of(1, 8).encode()) == 8 * (9 + 8 + 36)


def test_a_decoded_factor_may_be_changed_like_any_other() -> None:
    """Arrays over a buffer of bytes are read-only; a factor's are its own."""
    again = PassFactor.decode(factor_of(2, 4).encode(), (7,))
    again.vector[0] += 1.0
    again.information[0, 0] += 1.0


def test_numpy_numbers_are_stored_like_pythons() -> None:
    plain = factor_of(3, 4)
    numpy = factor_of(3, 4, slope_percent=np.float64(3.1), roughness=np.float64(3e-5))
    assert plain.encode() == numpy.encode()


@given(size=st.integers(1, 12), seed=st.integers(0, 2**31))
def test_the_upper_triangle_makes_the_whole_matrix(size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(size, size))
    whole = half + half.T
    made = symmetric(whole[np.triu_indices(size)], size)
    assert np.array_equal(made, whole)


def test_half_a_factor_is_refused() -> None:
    data = factor_of(4, 6).encode()
    with pytest.raises(ValueError):
        PassFactor.decode(data[:-8], (7,))
