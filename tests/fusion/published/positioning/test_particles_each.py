"""Particles' weights against exact integrals, draws against their law, and what follows the particles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.filters import kalman
from fusion.gnss.solvers.state import Frame, cn0_variance, range_row, states
from fusion.published.positioning.particles import regularise
from fusion.published.positioning.particles_bank import Bank
from fusion.published.positioning.particles_each import (
    correct_each,
    draw_each,
    log_normal_each,
    residuals_each,
    weigh_each,
)
from gnss_scene import scene

MEASURED = scene(epochs=1, satellites=5).measured
ROWS = Frame.around(MEASURED).rows(MEASURED, cn0_variance(MEASURED.cn0_dbhz, MEASURED.elevation_rad))
N = states(MEASURED)


def particles(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Means about the truth, and a covariance for each."""
    rng = np.random.default_rng(seed)
    means = np.zeros((count, N))
    means[:, 6] = 2000.0
    means += rng.normal(0, 2, means.shape)
    root = rng.normal(0, 1, (count, N, N))
    return means, root @ root.transpose(0, 2, 1) + np.eye(N)


def test_a_weight_is_the_density_of_the_measurements_under_the_particle() -> None:
    means, covariances = particles(6)
    offset, variance = np.full((1, 5), 1.5), ROWS.variance_m2[None].copy()
    log_weights = np.zeros(6)
    before, spread = means.copy(), covariances.copy()
    correct_each(ROWS, 0, means, covariances, offset, variance, log_weights)
    for i in range(6):
        row, H = np.zeros(N), np.empty((5, N))
        foretold = np.empty(5)
        for j in range(5):
            foretold[j] = range_row(before[i], ROWS.place_m[j], 0, row)
            H[j] = row
        total = H @ spread[i] @ H.T + np.diag(variance[0])
        exact = stats.multivariate_normal(foretold + 1.5, total).logpdf(ROWS.range_m)
        assert log_weights[i] == pytest.approx(exact + 2.5 * np.log(2 * np.pi), rel=1e-4, abs=1e-3)
        innovation = ROWS.range_m - foretold - 1.5
        expected = kalman.correct(before[i], spread[i], innovation, H, np.diag(variance[0]))
        assert means[i] == pytest.approx(expected[0], abs=1e-3)
        assert covariances[i] == pytest.approx(expected[1], abs=1e-4)


def test_weights_of_points_integrate_to_that_of_their_normal() -> None:
    """The mean of p(z | x) over x ~ N(m, P) is N(z; h(m), H P H' + R)."""
    means, covariances = particles(1, seed=4)
    count = 200_000
    cloud = np.repeat(means, count, axis=0)
    draw_each(cloud, np.repeat(0.5 * covariances, count, axis=0), np.random.default_rng(1))
    variance = np.full((1, 5), 30.0)
    of_points, of_normal = np.zeros(count), np.zeros(1)
    weigh_each(ROWS, 0, cloud, np.zeros((1, 5)), variance, of_points)
    correct_each(ROWS, 0, means, 0.5 * covariances, np.zeros((1, 5)), variance, of_normal)
    assert np.log(np.mean(np.exp(of_points))) == pytest.approx(of_normal[0], abs=0.05)


def test_draws_have_mean_and_covariance() -> None:
    means, covariances = particles(1)
    cloud = np.repeat(means, 40_000, axis=0)
    draw_each(cloud, np.repeat(covariances, 40_000, axis=0), np.random.default_rng(2))
    scale = np.sqrt(np.diag(covariances[0]))
    assert (cloud.mean(axis=0) - means[0]) / scale == pytest.approx(np.zeros(N), abs=0.03)
    assert np.cov(cloud.T) / np.outer(scale, scale) == pytest.approx(
        covariances[0] / np.outer(scale, scale), abs=0.03
    )


def test_log_normals_are_scipy_s_but_for_a_constant() -> None:
    means, covariances = particles(4)
    places = means + 0.3
    expected = [
        stats.multivariate_normal(m, c).logpdf(p) + N / 2 * np.log(2 * np.pi)
        for m, c, p in zip(means, covariances, places, strict=True)
    ]
    assert log_normal_each(places, means, covariances) == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_residuals_are_measured_minus_predicted() -> None:
    means = np.zeros((2, N))
    means[:, 6] = 2000.0
    means[1, 6] += 7.0
    residual = residuals_each(ROWS, 0, means)
    assert residual[0] - residual[1] == pytest.approx(np.full(5, 7.0), abs=1e-6)
    assert np.abs(residual[0]).max() < 5.0


def test_a_regularised_cloud_is_as_wide_as_before_and_has_no_copies() -> None:
    means = np.repeat(particles(100)[0], 20, axis=0)
    bank = Bank(means, np.zeros((2000, N, N)), np.zeros(2000), np.random.default_rng(0))
    before = np.cov(means.T)
    regularise(bank)
    assert len(np.unique(bank.means[:, 0])) == 2000
    assert np.diag(np.cov(bank.means.T)) == pytest.approx(np.diag(before), rel=0.15)
