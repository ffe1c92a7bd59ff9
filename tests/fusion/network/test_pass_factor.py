"""Pass factors as bytes and back, bit by bit."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.pass_factor import DRIVEN_BYTES, NUISANCES, SPEED_PRESSURE, PassFactor, symmetric

numbers = st.floats(allow_nan=False, allow_infinity=False)
masks = st.lists(st.booleans(), min_size=NUISANCES, max_size=NUISANCES)


def factor_of(
    seed: int, knots: int = 4, used: list[bool] | None = None, sequence: int = 3, **given_values: object
) -> PassFactor:
    """A factor over so many knot variables and the nuisances ``used`` (else all)."""
    rng = np.random.default_rng(seed)
    kept = np.concatenate([np.ones(knots, bool), np.ones(NUISANCES, bool) if used is None else used])
    size = len(kept)
    root = rng.normal(size=(size, size)) * 10.0 ** rng.integers(-8, 8, (size, 1)) * kept
    values: dict[str, object] = {
        "mount": 2,
        "square": 71.25,
        "rows": 12,
        "walk_m2_per_s": (0.15, 0.01),
        "start_m": 0.0,
        "end_m": 31.0,
        "roughness": 3e-5,
        "observations": 4,
        "first_time_s": 1_717_394_400.125,
        "last_time_s": 1_717_394_405.375,
        "lag_s": 1.5,
    }
    information = symmetric((root.T @ root)[np.triu_indices(size)], size)
    return PassFactor(7, sequence, information=information, vector=root[0].copy(), **(values | given_values))  # type: ignore[arg-type]


def assert_same(left: PassFactor, right: PassFactor) -> None:
    for field in fields(PassFactor):
        a, b = getattr(left, field.name), getattr(right, field.name)
        assert type(a) is type(b), field.name
        if isinstance(a, np.ndarray):
            # A zero without a word may have lost its sign.
            assert (a.dtype, a.shape, (a + 0.0).tobytes()) == (b.dtype, b.shape, (b + 0.0).tobytes()), (
                field.name
            )
        else:
            assert a == b, field.name


@given(
    seed=st.integers(0, 2**31),
    intervals=st.integers(1, 16),
    used=masks,
    square=numbers,
    walk=st.tuples(numbers, numbers),
    lag_s=st.floats(0, 10),
    length_m=st.floats(0, 1e9),
    time_s=st.floats(0, 4e9),
    counts=st.tuples(*[st.integers(0, 10**9)] * 4),
)
def test_what_is_encoded_comes_back_bit_by_bit(
    seed: int,
    intervals: int,
    used: list[bool],
    square: float,
    walk: tuple[float, float],
    lag_s: float,
    length_m: float,
    time_s: float,
    counts: tuple[int, int, int, int],
) -> None:
    factor = factor_of(
        seed, 2 * (intervals + 1), used, square=square, walk_m2_per_s=walk, lag_s=lag_s, first_time_s=time_s,
        observations=counts[0], rows=counts[1], mount=counts[2], place=counts[3], grade_length_m=length_m,
    )  # fmt: skip
    data = factor.encode()
    again = PassFactor.decode(data, 7, 3)
    assert_same(factor, again)
    assert again.used.tolist() == used
    assert again.encode() == data


@given(st.lists(st.tuples(st.integers(0, 2**31), st.integers(1, 3), masks), max_size=8))
def test_many_are_encoded_as_each_is(shapes: list[tuple[int, int, list[bool]]]) -> None:
    factors = [factor_of(seed, 2 * (intervals + 1), used) for seed, intervals, used in shapes]
    assert PassFactor.encode_all(factors) == [factor.encode() for factor in factors]


def test_the_place_of_a_pass_is_not_in_its_bytes() -> None:
    """Segment and sequence are columns of whoever stores it."""
    data = factor_of(1).encode()
    assert data == factor_of(1, sequence=9).encode()
    again = PassFactor.decode(data, 2**62, 41)
    assert (again.segment, again.sequence) == (2**62, 41)


@given(used=masks)
def test_a_factor_is_as_large_as_what_it_speaks_of(used: list[bool]) -> None:
    """What a thousand drives over a road cost on disk: sixteen numbers, the vector, half of the matrix."""
    size = 4 + sum(used)
    assert len(factor_of(1, 4, used).encode()) == 8 * (16 + size + size * (size + 1) // 2)


@given(seed=st.integers(0, 2**31), intervals=st.integers(1, 4), used=masks)
def test_factors_of_version_0_2_are_read(seed: int, intervals: int, used: list[bool]) -> None:
    """They began with the mount, knew of no length of grades, and had no speed pressure among their unknowns."""
    used[SPEED_PRESSURE] = False
    factor = factor_of(seed, 2 * (intervals + 1), used)
    new = np.frombuffer(factor.encode(), "<f8")
    before = [k for k in range(NUISANCES) if k != SPEED_PRESSURE]
    mask = sum(1 << place for place, k in enumerate(before) if used[k])
    old = np.concatenate([new[1:14], [mask], new[16:]]).astype("<f8").tobytes()
    assert_same(factor, PassFactor.decode(old, 7, 3))
    told = [(factor.start_m, factor.end_m, factor.first_time_s, factor.last_time_s)] * 2
    assert PassFactor.driven([old, factor.encode()[:DRIVEN_BYTES]]).tolist() == [list(row) for row in told]
    assert PassFactor.driven([]).shape == (0, 4)


@given(seed=st.integers(0, 2**31), widening=st.floats(1.0, 5.0))
def test_a_widened_pass_states_larger_sigmas_and_nothing_else(seed: int, widening: float) -> None:
    factor = factor_of(seed)
    wide = factor.widened(widening)
    assert wide.information * widening**2 == pytest.approx(factor.information)
    assert wide.vector * widening**2 == pytest.approx(factor.vector)
    assert wide.square * widening**2 == pytest.approx(factor.square)
    assert wide.walk_m2_per_s == pytest.approx([widening**2 * walk for walk in factor.walk_m2_per_s])
    assert (wide.rows, wide.end_m, wide.roughness) == (factor.rows, factor.end_m, factor.roughness)
    assert_same(factor.widened(1.0), factor)


def test_a_decoded_factor_may_be_changed_like_any_other() -> None:
    """Arrays over a buffer of bytes are read-only; a factor's are its own."""
    again = PassFactor.decode(factor_of(2).encode(), 7, 3)
    again.vector[0] += 1.0
    again.information[0, 0] += 1.0


def test_numpy_numbers_are_stored_like_pythons() -> None:
    plain = factor_of(3)
    numpy = factor_of(3, roughness=np.float64(3e-5), rows=np.int64(12), lag_s=np.float64(1.5))
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
        PassFactor.decode(data[:-8], 7, 3)
