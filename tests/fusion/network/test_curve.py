"""Heights between knots against the process they stand for: an integrated random walk, computed densely."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dense_adjustment import slope_row, smoothness
from fusion.network.curve import (
    MAX_INTERVALS,
    SPACING_M,
    grade_rows,
    grade_variance,
    height_rows,
    height_variance,
    interval_count,
    place_rows,
    slope_rows,
    smoothness_block,
    variable_count,
)

lengths = st.floats(0.5, 500.0)


def walk_covariance(h_at: np.ndarray, g_at: np.ndarray) -> np.ndarray:
    """Covariance of heights at ``h_at`` and grades at ``g_at`` (m from the start), q = 1, both 0 at the start.

    The grade is a Brownian motion W and the height its integral: double integrals of min(s, t).
    """

    def heights(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        low, high = np.minimum(x, y), np.maximum(x, y)
        return np.asarray(low**3 / 3 + low**2 * (high - low) / 2)

    def across(x: np.ndarray, y: np.ndarray) -> np.ndarray:  # height at x, grade at y
        return np.where(x <= y, x**2 / 2, x * y - y**2 / 2)

    hh = heights(h_at[:, None], h_at[None, :])
    hg = across(h_at[:, None], g_at[None, :])
    gg = np.minimum(g_at[:, None], g_at[None, :])
    return np.block([[hh, hg], [hg.T, gg]])


def knots_of(length: float) -> np.ndarray:
    return np.linspace(0.0, length, int(interval_count(length)) + 1)


def sampled(length: float, height: np.polynomial.Polynomial) -> np.ndarray:
    """Knot variables of a road whose height is a polynomial."""
    at = knots_of(length)
    return np.column_stack([height(at), height.deriv()(at)]).ravel()


@pytest.mark.parametrize(
    ("length", "intervals"),
    [(0.1, 1), (19.9, 1), (20.0, 1), (20.01, 2), (40.0, 2), (100.0, 5), (319.0, 16), (320.0, 16), (5e3, 16)],
)
def test_the_number_of_intervals_follows_from_the_length_alone(length: float, intervals: int) -> None:
    assert int(interval_count(length)) == intervals <= MAX_INTERVALS
    assert int(variable_count(length)) == 2 * (intervals + 1)
    assert variable_count(np.array([length, 20.0])).tolist() == [2 * (intervals + 1), 4]
    assert length / intervals <= SPACING_M * (1 + 1e-9) or intervals == MAX_INTERVALS


def test_rounding_of_a_length_does_not_change_its_knots() -> None:
    multiples = SPACING_M * np.arange(1, 17)
    for nearly in (multiples, np.nextafter(multiples, 0), np.nextafter(multiples, np.inf)):
        assert interval_count(nearly).tolist() == list(range(1, 17))


@given(length=lengths, seed=st.integers(0, 2**31))
def test_roads_that_are_cubics_are_met_exactly(length: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    height = np.polynomial.Polynomial(rng.normal(size=4) * [100.0, 0.1, 1e-3, 1e-5])
    x = rng.uniform(0, length, 20)
    knots = sampled(length, height)
    assert height_rows(x, length) @ knots == pytest.approx(height(x), rel=1e-9, abs=1e-9)
    assert grade_rows(x, length) @ knots == pytest.approx(height.deriv()(x), rel=1e-8, abs=1e-9)


@given(length=lengths, seed=st.integers(0, 2**31))
def test_grades_are_the_derivative_of_heights(length: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    step = 1e-4 * length / int(interval_count(length))
    x = rng.uniform(step, length - step, 15)
    low, high = height_rows(x - step, length), height_rows(x + step, length)
    numeric = (high - low) / (2 * step)
    assert grade_rows(x, length) == pytest.approx(numeric, abs=1e-3 * max(1.0, 1 / length))


def test_at_the_knots_heights_and_grades_are_the_variables() -> None:
    length = 87.0
    at = knots_of(length)
    assert height_rows(at, length) == pytest.approx(np.eye(2 * len(at))[0::2], abs=1e-12)
    assert grade_rows(at, length) == pytest.approx(np.eye(2 * len(at))[1::2], abs=1e-12)


def test_distances_beyond_the_ends_are_those_of_the_ends() -> None:
    beyond, ends = np.array([-3.0, 45.0]), np.array([0.0, 42.0])
    assert np.array_equal(height_rows(beyond, 42.0), height_rows(ends, 42.0))
    assert np.array_equal(grade_rows(beyond, 42.0), grade_rows(ends, 42.0))


@given(length=lengths, roughness=st.floats(1e-7, 1e-3), seed=st.integers(0, 2**31))
def test_between_knots_lie_conditional_mean_and_variance_of_the_process(
    length: float, roughness: float, seed: int
) -> None:
    """Conditioning one interval's inside on both of its ends, from the dense covariance of the process."""
    d = length / int(interval_count(length))
    x = np.random.default_rng(seed).uniform(0, d, 6)
    joint = walk_covariance(np.append(x, d), np.append(x, d))
    end = [len(x), 2 * len(x) + 1]
    inside = [i for i in range(len(joint)) if i not in end]
    gain = np.linalg.solve(joint[np.ix_(end, end)], joint[np.ix_(end, inside)]).T
    left = joint[np.ix_(inside, inside)] - gain @ joint[np.ix_(end, inside)]
    # What the start alone says, h0 + g0 x and g0, and the correction by what the end is beyond that.
    start = np.concatenate([np.column_stack([np.ones(6), x]), np.column_stack([np.zeros(6), np.ones(6)])])
    rows = np.hstack([start - gain @ np.array([[1.0, d], [0.0, 1.0]]), gain])
    unit = max(1.0, d)
    assert height_rows(x, length)[:, :4] == pytest.approx(rows[:6], abs=1e-7 * unit)
    assert grade_rows(x, length)[:, :4] == pytest.approx(rows[6:], abs=1e-7 * max(1.0, 1 / d))
    variance = roughness * np.diag(left)
    assert height_variance(x, length, roughness) == pytest.approx(
        variance[:6], rel=1e-5, abs=1e-8 * roughness * d**3
    )
    assert grade_variance(x, length, roughness) == pytest.approx(
        variance[6:], rel=1e-5, abs=1e-8 * roughness * d
    )


def test_variances_vanish_at_the_knots_and_repeat_in_every_interval() -> None:
    length = 100.0
    assert height_variance(knots_of(length), length, 1e-4) == pytest.approx(np.zeros(6), abs=1e-20)
    assert grade_variance(knots_of(length), length, 1e-4) == pytest.approx(np.zeros(6), abs=1e-20)
    x = np.array([3.0, 7.5, 10.0])
    for variance in (height_variance, grade_variance):
        assert variance(x + 60.0, length, 1e-4) == pytest.approx(variance(x, length, 1e-4))
        assert np.all(variance(x, length, 1e-4) >= 0)
        assert variance(x, length, 3e-4) == pytest.approx(3 * variance(x, length, 1e-4))


@given(length=st.floats(0.5, 350.0), roughness=st.floats(1e-7, 1e-3))
def test_smoothness_is_the_information_of_the_process_at_its_knots(length: float, roughness: float) -> None:
    """From the dense covariance of all knots beyond the first, of which nothing is known."""
    at = knots_of(length)
    order = np.arange(2 * len(at) - 2).reshape(2, -1).T.ravel()  # height, grade, height, grade ...
    covariance = roughness * walk_covariance(at[1:], at[1:])[np.ix_(order, order)]
    from_start = np.concatenate([[[1.0, x], [0.0, 1.0]] for x in at[1:]])
    beyond = np.hstack([-from_start, np.eye(len(order))])
    expected = beyond.T @ np.linalg.solve(covariance, beyond)
    found = smoothness(length, roughness)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert found / scale == pytest.approx(expected / scale, abs=1e-5)


def test_straight_roads_cost_nothing_and_kinks_do() -> None:
    length = 90.0
    straight = sampled(length, np.polynomial.Polynomial([300.0, 0.08]))
    assert straight @ smoothness(length, 1e-5) @ straight == pytest.approx(0.0, abs=1e-6)
    bent = sampled(length, np.polynomial.Polynomial([0.0, 0.0, 1e-3]))
    # The grade changes by 2e-3 per metre: a random walk's exponent is the square of it times length over q.
    assert bent @ smoothness(length, 1e-5) @ bent == pytest.approx((2e-3) ** 2 * length / 1e-5)


def test_every_interval_may_have_its_own_roughness() -> None:
    length, q = 60.0, np.array([1e-5, 1e-4, 1e-3])
    expected = np.zeros((8, 8))
    for j in range(3):
        expected[2 * j : 2 * j + 4, 2 * j : 2 * j + 4] += smoothness_block(20.0) / q[j]
    assert smoothness(length, q) == pytest.approx(expected)
    assert smoothness(length, 1e-5) == pytest.approx(smoothness(length, np.full(3, 1e-5)))


@given(length=lengths, cut=st.tuples(st.floats(0, 1), st.floats(0, 1)), seed=st.integers(0, 2**31))
def test_slopes_are_regressions_of_height_on_distance(
    length: float, cut: tuple[float, float], seed: int
) -> None:
    start, end = (length * share for share in sorted(cut))
    if end - start < 0.02 * length:
        start, end = 0.0, length
    edges = np.linspace(start, end, 4001)
    middles = 0.5 * (edges[1:] + edges[:-1])
    knots = (
        np.random.default_rng(seed).normal(size=int(variable_count(length)))
        * np.tile([1.0, 0.1], 200)[: int(variable_count(length))]
    )
    line = np.polyfit(middles - middles.mean(), height_rows(middles, length) @ knots, 1)
    size = np.abs(slope_row(start, end, length)) @ np.abs(knots)
    assert slope_row(start, end, length) @ knots == pytest.approx(line[0], abs=1e-5 * size)


@given(length=st.floats(1.0, 350.0), seed=st.integers(0, 2**31))
def test_moving_an_end_changes_the_slope_as_it_is_said(length: float, seed: int) -> None:
    """Against differences of the regression over parts that begin or end a little inside."""
    size = int(variable_count(length))
    knots = np.random.default_rng(seed).normal(size=size) * np.tile([1.0, 0.1], size // 2)
    h = 1e-4 * length / int(interval_count(length))
    whole, near, far = (
        [slope_row(low, length - high, length) @ knots for low, high in ((k * h, 0.0), (0.0, k * h))]
        for k in range(3)
    )
    start, end = ((4 * near[k] - 3 * whole[k] - far[k]) / (2 * h) for k in (0, 1))
    found = [float(rows[0] @ knots) for rows in place_rows(np.array([length]))]
    scale = float(sum(np.abs(rows[0]) @ np.abs(knots) for rows in place_rows(np.array([length]))))
    assert found == pytest.approx([start, -end], abs=1e-5 * scale)


def test_where_the_grade_is_even_it_does_not_matter_where_a_segment_ends() -> None:
    lengths = np.array([41.0, 55.0, 60.0])
    start, end = place_rows(lengths)
    for k, length in enumerate(lengths.tolist()):
        even = sampled(length, np.polynomial.Polynomial([250.0, -0.07]))
        assert start[k] @ even == pytest.approx(0.0, abs=1e-12)
        assert end[k] @ even == pytest.approx(0.0, abs=1e-12)


def test_slopes_of_many_segments_at_once_are_those_of_each() -> None:
    rng = np.random.default_rng(1)
    length = rng.uniform(60.5, 79.5, 30)
    start = rng.uniform(0, 0.5, 30) * length
    end = start + rng.uniform(0.1, 0.5, 30) * length
    together = slope_rows(start, end, length)
    alone = [slope_row(*(float(v) for v in each)) for each in zip(start, end, length, strict=True)]
    assert together == pytest.approx(np.array(alone), rel=1e-12, abs=1e-15)


def test_the_slope_of_a_straight_part_is_its_grade_wherever_it_is_cut() -> None:
    length = 133.0
    knots = sampled(length, np.polynomial.Polynomial([250.0, -0.07]))
    for start, end in ((0.0, 133.0), (0.0, 1.0), (18.0, 21.0), (66.0, 67.0), (132.0, 133.0)):
        assert slope_row(start, end, length) @ knots == pytest.approx(-0.07)


def test_a_slope_needs_a_part_of_positive_length() -> None:
    for start, end in ((5.0, 5.0), (8.0, 3.0), (np.nan, 3.0)):
        with pytest.raises(ValueError, match="positive length"):
            slope_row(start, end, 30.0)
    assert slope_rows(*np.empty((3, 0))).shape[0] == 0
