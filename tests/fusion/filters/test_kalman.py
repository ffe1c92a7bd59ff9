"""The Kalman filter against closed forms, its invariants, and the fast correction against the matrix form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from scipy import linalg, stats

from fusion.filters import kalman

Case = tuple[np.ndarray, ...]


def random_case(seed: int, n: int, m: int, rank: int) -> Case:
    """Mean, covariance (of this rank), transition, process noise, residual, design and measurement noise."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, min(rank, n))) * 10.0 ** rng.uniform(-3, 3, (n, 1))
    noise_root = rng.normal(size=(m, m))
    noise = noise_root @ noise_root.T * 10.0 ** rng.uniform(-4, 2) + 1e-6 * np.eye(m)
    process = rng.normal(size=(n, 1))
    return (
        rng.normal(size=n), root @ root.T, rng.normal(size=(n, n)), process @ process.T,
        rng.normal(size=m), rng.normal(size=(m, n)), noise,
    )  # fmt: skip


cases = st.builds(random_case, st.integers(0, 2**31), st.integers(1, 9), st.integers(1, 4), st.integers(0, 9))


def assert_covariance(matrix: np.ndarray, before: np.ndarray | None = None) -> None:
    """Symmetric to the last bit, and positive semi-definite up to rounding, here or of what it came from."""
    assert np.array_equal(matrix, matrix.T)
    scale = np.linalg.norm(matrix if before is None else before)
    assert np.linalg.eigvalsh(matrix)[0] >= -1e-13 * scale


def settle(transition: np.ndarray, noise: np.ndarray, design: np.ndarray, r: np.ndarray) -> Case:
    """Covariance before and after a measurement, once neither changes any more."""
    n = len(transition)
    after = 100.0 * np.eye(n)
    for _ in range(3000):
        _, before = kalman.predict(np.zeros(n), after, transition, noise)
        _, after = kalman.correct(np.zeros(n), before, np.zeros(len(design)), design, r)
    return before, after


@pytest.mark.parametrize(("q", "r"), [(0.25, 225.0), (0.25, 100.0), (4.0, 1.0), (1e-3, 10.0)])
def test_a_random_walk_settles_at_the_root_of_its_riccati_equation(q: float, r: float) -> None:
    one = np.eye(1)
    before, after = settle(one, q * one, one, r * one)
    expected = (q + np.sqrt(q * q + 4 * q * r)) / 2
    assert before[0, 0] == pytest.approx(expected, rel=1e-9)
    assert after[0, 0] == pytest.approx(expected * r / (expected + r), rel=1e-9)


def test_the_gains_that_are_known_for_saadaouis_positions() -> None:
    """w = 0.5 m, v = 15 and 10 m: the share of a new position that is believed, and the spread that remains."""
    one = np.eye(1)
    for sigma_m, gain, spread_m in ((15.0, 0.0328, 2.72), (10.0, 0.0488, 2.21)):
        _, after = settle(one, 0.25 * one, one, sigma_m**2 * one)
        assert after[0, 0] / sigma_m**2 == pytest.approx(gain, abs=1e-4)
        assert np.sqrt(after[0, 0]) == pytest.approx(spread_m, abs=0.01)


@pytest.mark.parametrize("index", [0.01, 0.3, 1.0, 5.0])
def test_constant_velocity_settles_at_kalatas_alpha_beta_filter(index: float) -> None:
    """Position measured with sigma 1, white acceleration of sigma ``index`` held over steps of 1 s (Kalata 1984)."""
    transition, design = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    push = np.array([0.5, 1.0]) * index
    noise = np.outer(push, push)
    before, after = settle(transition, noise, design, np.eye(1))
    damping = (4 + index - np.sqrt(8 * index + index**2)) / 4
    alpha = 1 - damping**2
    beta = 2 * (2 - alpha) - 4 * np.sqrt(1 - alpha)
    assert after[:, 0] == pytest.approx([alpha, beta], rel=1e-7)  # P H' / R is the gain
    assert before == pytest.approx(
        linalg.solve_discrete_are(transition.T, design.T, noise, np.eye(1)), rel=1e-7
    )


def test_a_constant_is_averaged() -> None:
    values = np.random.default_rng(1).normal(7.0, 2.0, 50)
    x, p, one = np.zeros(1), 1e6 * np.eye(1), np.eye(1)
    for value in values:
        x, p = kalman.correct(x, p, value - x, one, 4.0 * one)
    assert x[0] == pytest.approx(values.mean(), abs=1e-4)
    assert p[0, 0] == pytest.approx(4.0 / 50, rel=1e-5)


@given(case=cases)
def test_covariances_stay_symmetric_and_semi_definite(case: Case) -> None:
    x, p, transition, process, residual, design, noise = case
    x, p = kalman.predict(x, p, transition, process)
    assert_covariance(p)
    _, corrected = kalman.correct(x, p, residual, design, noise)
    assert_covariance(corrected, p)
    # A measurement takes nothing away from what is known.
    assert np.linalg.eigvalsh(p - corrected)[0] >= -1e-10 * np.trace(p)


@given(case=cases)
def test_a_correction_adds_the_information_of_the_measurement(case: Case) -> None:
    x, p, _, _, residual, design, noise = case
    sigma = np.sqrt(np.diag(p)) + 1e-6  # states of one size, for the sake of the inverses
    p = p / np.outer(sigma, sigma) + 1e-3 * np.eye(len(p))
    corrected_mean, corrected = kalman.correct(x, p, residual, design, noise)
    information = np.linalg.inv(p) + design.T @ np.linalg.solve(noise, design)
    assert corrected @ information == pytest.approx(np.eye(len(x)), abs=1e-5)
    score = design.T @ np.linalg.solve(noise, residual)
    assert information @ (corrected_mean - x) == pytest.approx(
        score, rel=1e-5, abs=1e-5 * np.abs(score).max()
    )


def exact_measurement(n: int) -> Case:
    """A vague start, every state measured at once and almost without error."""
    p = 1e10 * (np.eye(n) + 0.5)
    return p, np.tri(n), 1e-8 * np.eye(n)


def test_josephs_form_survives_where_the_printed_form_does_not() -> None:
    p, design, noise = exact_measurement(4)
    gain = np.linalg.solve(design @ p @ design.T + noise, design @ p).T
    printed = (np.eye(4) - gain @ design) @ p
    assert np.linalg.eigvalsh((printed + printed.T) / 2)[0] < 0.0
    _, corrected = kalman.correct(np.zeros(4), p, np.zeros(4), design, noise)
    assert_covariance(corrected)


@given(case=cases)
def test_scalars_one_after_another_are_the_matrix_correction(case: Case) -> None:
    x, before, _, _, measured, design, noise = case
    p, variance = before.copy(), np.diag(noise).copy()
    expected_mean, expected = kalman.correct(x, p, measured - design @ x, design, np.diag(variance))
    for row, value, r in zip(design, measured, variance, strict=True):
        kalman.correct_scalar(x, p, float(value - row @ x), row, float(r))
        assert_covariance(p, before)
    scale = np.sqrt(np.trace(before)) + 1.0
    assert x == pytest.approx(expected_mean, rel=1e-6, abs=1e-8 * scale)
    assert p == pytest.approx(expected, rel=1e-6, abs=1e-8 * scale)


def test_an_exact_scalar_after_a_vague_start_keeps_its_digits() -> None:
    p, design, noise = exact_measurement(4)
    x = np.zeros(4)
    for row in design:
        kalman.correct_scalar(x, p, 0.0, row, noise[0, 0])
        assert_covariance(p)
    # The measurements are the running sums of the states, so that a state is a difference of two of them.
    assert np.diag(p) == pytest.approx([1e-8, 2e-8, 2e-8, 2e-8], rel=1e-2)


def test_normalised_squares_follow_chi_square_where_the_covariances_are_right() -> None:
    rng = np.random.default_rng(7)
    transition = np.array([[1.0, 1.0], [0.0, 0.95]])
    process, design = np.diag([0.1, 0.3]), np.array([[1.0, 0.0], [1.0, 1.0]])
    noise = np.array([[2.0, 0.5], [0.5, 1.0]])
    x, p, squares = np.zeros(2), np.eye(2), []
    truth = rng.multivariate_normal(x, p)
    for _ in range(2000):
        truth = transition @ truth + rng.multivariate_normal(np.zeros(2), process)
        x, p = kalman.predict(x, p, transition, process)
        residual = rng.multivariate_normal(design @ truth, noise) - design @ x
        squares.append(kalman.normalised_square(p, residual, design, noise))
        x, p = kalman.correct(x, p, residual, design, noise)
    assert stats.kstest(squares, "chi2", args=(2,)).pvalue > 1e-6
    assert stats.chi2(4000).cdf(sum(squares)) == pytest.approx(0.5, abs=0.5 - 1e-6)


@njit
def compiled_loop(x, p, transition, process, design, variance, values):  # type: ignore[no-untyped-def]
    for k in range(len(values)):
        x, p = kalman.predict(x, p, transition, process)
        for i in range(len(variance)):
            residual = values[k, i] - design[i] @ x
            kalman.correct_scalar(x, p, residual, design[i], variance[i])
    return x, p


@pytest.mark.slow
def test_a_compiled_loop_may_call_the_filter() -> None:
    x, p, transition, process, _, design, noise = random_case(3, 5, 3, 5)
    transition = transition / np.abs(np.linalg.eigvals(transition)).max()
    values = np.random.default_rng(4).normal(size=(20, 3))
    variance = np.diag(noise).copy()
    mean, covariance = compiled_loop(x.copy(), p.copy(), transition, process, design, variance, values)
    for value in values:
        x, p = kalman.predict(x, p, transition, process)
        x, p = kalman.correct(x, p, value - design @ x, design, np.diag(variance))
    assert mean == pytest.approx(x, rel=1e-6)
    assert covariance == pytest.approx(p, rel=1e-6, abs=1e-9)


def test_any_layout_in_memory_is_taken_and_arguments_are_left_alone() -> None:
    x, p, transition, process, residual, design, noise = random_case(5, 4, 2, 4)
    expected = kalman.correct(*kalman.predict(x, p, transition, process), residual, design, noise)
    wide = np.zeros((8, 8))
    wide[::2, ::2] = transition
    strided = [wide[::2, ::2], np.asfortranarray(design), np.repeat(residual, 2)[::2]]
    before = [a.copy() for a in (x, p, *strided)]
    predicted = kalman.predict(x, p, strided[0], process)
    mean, covariance = kalman.correct(*predicted, strided[2], strided[1], noise)
    assert mean == pytest.approx(expected[0], rel=1e-12)
    assert covariance == pytest.approx(expected[1], rel=1e-9)
    assert all(np.array_equal(a, b) for a, b in zip((x, p, *strided), before, strict=True))
