"""The unscented filter: the printed sums where those are sound, exact moments where known, and alpha = 1e-3."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters import kalman
from fusion.filters.unscented import Unscented

filters = st.builds(Unscented, st.floats(0.3, 2.0), st.floats(0.0, 4.0), st.floats(-0.5, 3.0))


def wrap(angle_rad: np.ndarray) -> np.ndarray:
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def covariance(rng: np.random.Generator, n: int, rank: int | None = None) -> np.ndarray:
    root = rng.normal(size=(n, n if rank is None else rank))
    return root @ root.T


def printed_moments(
    unscented: Unscented, points: np.ndarray, images: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, covariance and cross covariance by Algorithm 3's own sums and the weights that it prints."""
    n = points.shape[1]
    lam = unscented.alpha**2 * (n + unscented.kappa) - n
    of_mean = np.array([lam / (n + lam)] + 2 * n * [1 / (2 * (n + lam))])
    of_covariance = of_mean.copy()
    of_covariance[0] += 1 - unscented.alpha**2 + unscented.beta
    mean = of_mean @ images
    away = images - mean
    return mean, (of_covariance * away.T) @ away, (of_covariance * (points - points[0]).T) @ away


@given(seed=st.integers(0, 2**31), unscented=filters, n=st.integers(1, 6))
def test_the_points_have_the_mean_and_the_covariance(seed: int, unscented: Unscented, n: int) -> None:
    rng = np.random.default_rng(seed)
    x, p = rng.normal(size=n), covariance(rng, n)
    points = unscented.sigma_points(x, p)
    assert points.shape == (2 * n + 1, n)
    assert np.array_equal(points[0], x)
    mean, spread, _ = printed_moments(unscented, points, points)
    assert mean == pytest.approx(x, abs=1e-9)
    assert spread == pytest.approx(p, abs=1e-9)


@given(seed=st.integers(0, 2**31), unscented=filters, n=st.integers(1, 5), m=st.integers(1, 4))
def test_differences_give_what_the_printed_sums_give(seed: int, unscented: Unscented, n: int, m: int) -> None:
    """Algorithm 3 literally, with points drawn anew for the correction, on a strongly bent model."""
    rng = np.random.default_rng(seed)
    x, p, q, r = rng.normal(size=n), covariance(rng, n), covariance(rng, n), covariance(rng, m) + np.eye(m)
    to_state, to_seen, z = rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=m)

    def f(points: np.ndarray) -> np.ndarray:
        return np.sin(points @ to_state) + points

    def h(points: np.ndarray) -> np.ndarray:
        return np.cos(points @ to_seen) + points @ to_seen

    points = unscented.sigma_points(x, p)
    mean, spread, _ = printed_moments(unscented, points, f(points))
    predicted = unscented.predict(x, p, f, q)
    assert predicted[0] == pytest.approx(mean, abs=1e-8)
    assert predicted[1] == pytest.approx(spread + q, abs=1e-8)

    p = p + q
    points = unscented.sigma_points(x, p)
    seen, p_zz, p_xz = printed_moments(unscented, points, h(points))
    gain = p_xz @ np.linalg.inv(p_zz + r)
    corrected = unscented.correct(x, p, z, h, r)
    assert corrected[0] == pytest.approx(x + gain @ (z - seen), rel=1e-6, abs=1e-6)
    assert corrected[1] == pytest.approx(p - gain @ (p_zz + r) @ gain.T, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("alpha", [1e-3, 1e-2, 0.5, 1.0])
@pytest.mark.parametrize("kappa", [0.0, 1.0, -1.0])
def test_the_mean_of_a_quadratic_is_exact(alpha: float, kappa: float) -> None:
    rng = np.random.default_rng(2)
    n, m = 4, 3
    x, p = 5 * rng.normal(size=n), covariance(rng, n)
    bend, slope, level = rng.normal(size=(m, n, n)), rng.normal(size=(m, n)), rng.normal(size=m)

    def quadratic(points: np.ndarray) -> np.ndarray:
        return np.einsum("kij,pi,pj->pk", bend, points, points) + points @ slope.T + level

    mean, _ = Unscented(alpha, kappa=kappa).predict(x, p, quadratic, np.zeros((m, m)))
    expected = quadratic(x[None])[0] + np.einsum("kij,ij->k", bend, p)
    assert mean == pytest.approx(expected, rel=1e-12 / alpha**2)


@pytest.mark.parametrize("alpha", [1e-3, 0.1, 1.0])
def test_the_variance_of_the_square_of_a_gaussian_is_exact(alpha: float) -> None:
    """4 mean^2 var + 2 var^2, which beta = 2 is made for."""
    mean, variance = 3.0, 2.0
    square, spread = Unscented(alpha).predict(
        np.array([mean]), np.array([[variance]]), np.square, np.zeros((1, 1))
    )
    assert square[0] == pytest.approx(mean**2 + variance, rel=1e-8)
    assert spread[0, 0] == pytest.approx(4 * mean**2 * variance + 2 * variance**2, rel=1e-8)


@given(
    seed=st.integers(0, 2**31),
    n=st.integers(1, 5),
    rank=st.integers(0, 5),
    alpha=st.sampled_from([1e-3, 0.1, 1.0]),
)
def test_semi_definite_covariances_are_taken_and_given(seed: int, n: int, rank: int, alpha: float) -> None:
    rng = np.random.default_rng(seed)
    x, p, r = rng.normal(size=n), covariance(rng, n, min(rank, n)), 0.01 * np.eye(1)
    bend = rng.normal(size=(n, 1))
    unscented = Unscented(alpha)
    _, predicted = unscented.predict(x, p, np.sin, np.zeros((n, n)))
    _, corrected = unscented.correct(x, p, np.ones(1), lambda points: np.square(points @ bend), r)
    for matrix in (predicted, corrected):
        assert np.array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix)[0] >= -1e-8 * max(np.trace(p), np.trace(matrix))


def test_what_it_cannot_work_with_is_refused() -> None:
    for alpha in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="alpha must be positive"):
            Unscented(alpha)
    with pytest.raises(ValueError, match="must be positive"):
        Unscented(kappa=-1.0).sigma_points(np.zeros(1), np.eye(1))
    Unscented(kappa=-1.0).sigma_points(np.zeros(2), np.eye(2))
    with pytest.raises(ValueError, match="semi-definite"):
        Unscented().sigma_points(np.zeros(2), np.diag([1.0, -1e-3]))


def corrected_heading(turn_rad: float, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """A vehicle that heads ``turn_rad``, and a compass that says a little less; headings are given in (-pi, pi]."""

    def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return wrap(a - b)

    def drift(points: np.ndarray) -> np.ndarray:
        return wrap(points + 0.01)

    unscented = Unscented(alpha)
    start = wrap(np.array([turn_rad])), np.array([[0.04]])
    x, p = unscented.predict(*start, drift, 1e-4 * np.eye(1), differ)
    return unscented.correct(x, p, wrap(np.array([turn_rad - 0.02])), wrap, 0.01 * np.eye(1), differ)


@pytest.mark.parametrize("alpha", [1e-3, 1.0])
@pytest.mark.parametrize("turn_rad", [np.pi - 0.01, np.pi - 0.005, np.pi, -np.pi + 1e-4, 3.0, 40.0])
def test_no_heading_is_worse_than_another(turn_rad: float, alpha: float) -> None:
    x, p = corrected_heading(turn_rad, alpha)
    expected_x, expected_p = corrected_heading(0.0, alpha)
    assert wrap(x - turn_rad) == pytest.approx(expected_x, abs=1e-8)
    assert p == pytest.approx(expected_p, rel=1e-8)


@pytest.mark.slow
def test_small_alpha_is_stable_over_thousands_of_steps() -> None:
    """A vehicle circles some kilometres from the origin: as with alpha = 1, near the extended filter and the truth."""
    rng = np.random.default_rng(3)
    q, r = np.diag([0.01, 0.01, 1e-4]), np.diag([25.0, 25.0, 0.0025])

    def move(points: np.ndarray) -> np.ndarray:
        heading = points[..., 2]
        step = np.stack([10 * np.cos(heading), 10 * np.sin(heading), np.full_like(heading, 0.02)], axis=-1)
        return points + step

    def slope(s: np.ndarray) -> np.ndarray:
        return np.array([[1, 0, -10 * np.sin(s[2])], [0, 1, 10 * np.cos(s[2])], [0, 0, 1.0]])

    def differ(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        away = a - b
        away[..., 2] = wrap(away[..., 2])
        return away

    truth = np.array([4000.0, -3000.0, 0.0])
    small = wide = linearised = (truth.copy(), np.diag([25.0, 25.0, 0.01]))
    squares, apart, bent = [], [], []
    for _ in range(3000):
        truth = move(truth) + rng.multivariate_normal(np.zeros(3), q)
        z = rng.multivariate_normal(truth, r)
        z[2] = wrap(z[2])
        small, wide = (
            u.correct(*u.predict(*state, move, q, differ), z, np.copy, r, differ)
            for u, state in ((Unscented(1e-3), small), (Unscented(1.0), wide))
        )
        predicted = kalman.predict_extended(*linearised, move, slope, q)
        linearised = kalman.correct_extended(*predicted, z, np.copy, lambda _: np.eye(3), r, differ)
        error = differ(truth, small[0])
        squares.append(error @ np.linalg.solve(small[1], error))
        apart.append(np.abs(small[0] - wide[0]).max())
        bent.append(np.abs(small[0] - linearised[0]).max())
    assert np.mean(squares) == pytest.approx(3.0, abs=0.4)
    assert max(apart) < 5e-3
    assert max(bent) < 0.15


@pytest.mark.parametrize("alpha", [1e-3, 1e-2, 1.0])
def test_on_a_linear_model_the_order_of_magnitude_of_states_does_no_harm(alpha: float) -> None:
    """A kilometre beside a milliradian: both stay at the Kalman filter's values to 1e-9 of their size."""
    scale = np.array([1e3, 1e-3])
    transition = np.array([[1.0, 0.1], [0.0, 1.0]]) * scale[:, None] / scale
    q, r = 0.1 * np.diag(scale**2), np.diag(scale**2)
    linear = general = (scale.copy(), np.diag(scale**2))
    unscented = Unscented(alpha)
    for value in np.random.default_rng(5).normal(size=(300, 2)):
        linear = kalman.predict(*linear, transition, q)
        general = unscented.predict(*general, lambda points: points @ transition.T, q)
        linear = kalman.correct(*linear, value * scale - linear[0], np.eye(2), r)
        general = unscented.correct(*general, value * scale, np.copy, r)
        assert general[0] / scale == pytest.approx(linear[0] / scale, abs=1e-9)
        assert general[1] / np.outer(scale, scale) == pytest.approx(
            linear[1] / np.outer(scale, scale), abs=1e-9
        )


def test_rounding_far_from_the_origin_is_not_taken_for_a_bend_of_the_model() -> None:
    """Nine states, 15 m/s, some kilometres away: weighed by 1e6, rounding would move the mean by 1e-7 m."""
    transition = np.kron(np.eye(3), [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.5, 1.0, 1.0]])
    design = np.eye(9)[2::3]
    q, r = np.diag(np.tile([0.1, 0.01, 0.01], 3)), 25.0 * np.eye(3)
    start = np.tile([0.0, 15.0, 5000.0], 3)
    linear = general = (start, np.diag(np.tile([1.0, 4.0, 25.0], 3)))
    unscented = Unscented(1e-3)
    for second, error in enumerate(np.random.default_rng(6).normal(0.0, 5.0, (200, 3)), start=1):
        z = 5000.0 + 15.0 * second + error
        x, p = kalman.predict(*linear, transition, q)
        linear = kalman.correct(x, p, z - design @ x, design, r)
        general = unscented.predict(*general, lambda points: points @ transition.T, q)
        general = unscented.correct(*general, z, lambda points: points[:, 2::3], r)
        assert general[0] == pytest.approx(linear[0], rel=0, abs=1e-8)
        assert general[1] == pytest.approx(linear[1], rel=0, abs=1e-6)
