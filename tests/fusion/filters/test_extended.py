"""The extended filter: the linear filter on a linear model, Jacobians where they belong, wrapped angles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters import kalman


def wrap(angle_rad: np.ndarray) -> np.ndarray:
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


@given(seed=st.integers(0, 2**31), n=st.integers(1, 5), m=st.integers(1, 3))
def test_on_a_linear_model_it_is_the_kalman_filter(seed: int, n: int, m: int) -> None:
    rng = np.random.default_rng(seed)
    x, f, h, z = rng.normal(size=n), rng.normal(size=(n, n)), rng.normal(size=(m, n)), rng.normal(size=m)
    p, q, r = np.cov(rng.normal(size=(n, 30))).reshape(n, n), np.eye(n), np.eye(m)
    linear = kalman.predict(x, p, f, q)
    general = kalman.predict_extended(x, p, lambda x: f @ x, lambda _: f, q)
    assert general[0] == pytest.approx(linear[0], rel=1e-12, abs=1e-12)
    assert np.array_equal(general[1], linear[1])
    corrected = kalman.correct_extended(*linear, z, lambda x: h @ x, lambda _: h, r)
    expected = kalman.correct(*linear, z - h @ linear[0], h, r)
    assert corrected[0] == pytest.approx(expected[0], rel=1e-12, abs=1e-12)
    assert np.array_equal(corrected[1], expected[1])


def test_each_jacobian_is_taken_at_the_newest_mean() -> None:
    """x -> x^2 from 3: the transition's slope is 6, and the measurement's, at the predicted 9, is 18."""
    one = np.eye(1)
    x, p = kalman.predict_extended(
        3.0 * np.ones(1), 0.5 * one, np.square, lambda x: 2 * x.reshape(1, 1), 2.0 * one
    )
    assert (x[0], p[0, 0]) == pytest.approx((9.0, 36 * 0.5 + 2.0))
    x, p = kalman.correct_extended(
        x, p, np.array([85.0]), np.square, lambda x: 2 * x.reshape(1, 1), 3.0 * one
    )
    gain = 20.0 * 18.0 / (18.0 * 20.0 * 18.0 + 3.0)
    assert x[0] == pytest.approx(9.0 + gain * 4.0)
    assert p[0, 0] == pytest.approx(20.0 * 3.0 / (18.0 * 20.0 * 18.0 + 3.0))


def test_an_angle_is_corrected_the_short_way_round() -> None:
    one = np.eye(1)
    x, _ = kalman.correct_extended(
        np.array([np.pi - 0.01]), one, np.array([-np.pi + 0.03]), np.copy, lambda _: one, one,
        subtract=lambda a, b: wrap(a - b),
    )  # fmt: skip
    assert x[0] == pytest.approx(np.pi + 0.01)


def test_a_turning_vehicle_is_followed_with_honest_covariances() -> None:
    """Saadaoui's three states: speed as command, positions and headings measured, many turns in all."""
    rng = np.random.default_rng(11)
    q, r = np.diag([0.25, 0.25, 4e-4]), np.diag([100.0, 100.0, 0.0025])
    truth, x, p, squares = np.zeros(3), np.zeros(3), np.diag([100.0, 100.0, 0.01]), []
    truth = rng.multivariate_normal(x, p)

    def move(s: np.ndarray) -> np.ndarray:
        return s + np.array([10 * np.cos(s[2]), 10 * np.sin(s[2]), 0.05])

    def slope(s: np.ndarray) -> np.ndarray:
        return np.array([[1, 0, -10 * np.sin(s[2])], [0, 1, 10 * np.cos(s[2])], [0, 0, 1.0]])

    def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.append(a[:2] - b[:2], wrap(a[2:] - b[2:]))

    for _ in range(1000):
        truth = move(truth) + rng.multivariate_normal(np.zeros(3), q)
        x, p = kalman.predict_extended(x, p, move, slope, q)
        z = rng.multivariate_normal(truth, r)
        z[2] = wrap(z[2])
        x, p = kalman.correct_extended(x, p, z, np.copy, lambda _: np.eye(3), r, differ)
        error = differ(truth, x)
        squares.append(error @ np.linalg.solve(p, error))
    # Errors of neighbouring epochs hang together, so that the mean of 1000 scatters about 3 by some tenths.
    assert np.mean(squares) == pytest.approx(3.0, abs=0.6)
