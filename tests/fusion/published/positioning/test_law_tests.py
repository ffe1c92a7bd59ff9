"""Tests of laws against scipy's, against the tables of annex A, and by the worked example of section 3.3."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.published.positioning.laws import (
    LEVELS,
    chi_square,
    fit_law,
    ks_critical,
    ks_statistic,
    law_tests,
    quantile_pairs,
    window_distances,
)


@pytest.mark.parametrize("name", ["normal", "laplace", "rayleigh", "3 normals"])
def test_kolmogorov_smirnov_is_scipys(name: str) -> None:
    x = np.random.default_rng(1).normal(2.0, 3.0, 300)
    law = fit_law(name, x)
    assert ks_statistic(x, law) == pytest.approx(stats.kstest(x, law.cdf).statistic, abs=1e-12)


def test_chi_square_is_scipys() -> None:
    x = np.random.default_rng(2).normal(size=1000)
    law = fit_law("normal", x)
    statistic, dof = chi_square(x, law, bins=4)
    edges = np.linspace(x.min(), x.max(), 5)[1:-1]
    observed = np.histogram(x, np.concatenate([[-np.inf], edges, [np.inf]]))[0]
    expected = 1000 * np.diff(np.concatenate([[0], law.cdf(edges), [1]]))
    assert statistic == pytest.approx(stats.chisquare(observed, expected, ddof=2).statistic)
    assert dof == 4 - (2 + 1)
    assert chi_square(x, law, bins=3)[1] == 0
    assert np.isnan(chi_square(x, law, bins=3)[0])


def test_critical_values_are_those_of_the_annex() -> None:
    for level, factor in ((0.10, 1.223), (0.05, 1.358), (0.01, 1.629)):
        assert ks_critical(400, level) == pytest.approx(factor / 20)
    for level in LEVELS:  # where one rule ends and the other begins, they agree
        assert ks_critical(100, level) == pytest.approx(ks_critical(101, level), rel=0.02)
    assert ks_critical(20, 0.05) == pytest.approx(0.294, abs=5e-4)  # the tables that are printed everywhere


def test_the_worked_example_of_the_thesis() -> None:
    """200 draws of N(0, 1): the normal law is taken; Laplace's, with the rate 1.4, lies at its limit (0.0775)."""
    normal, laplace, rate, refused = [], [], [], 0
    for seed in range(60):
        x = np.random.default_rng(seed).normal(size=200)
        normal.append(ks_statistic(x, fit_law("normal", x)))
        laplace.append(ks_statistic(x, fit_law("laplace", x)))
        rate.append(np.sqrt(2) / x.std())
        refused += normal[-1] > ks_critical(200, 0.05)
        statistic, dof = chi_square(x, fit_law("normal", x), bins=10)
        assert 3 <= dof <= 7
        assert statistic < 40
    assert np.mean(rate) == pytest.approx(np.sqrt(2), abs=0.03)
    assert refused == 0
    assert np.mean(np.array(normal) < np.array(laplace)) > 0.9
    assert np.quantile(normal, 0.1) < 0.04 < np.quantile(normal, 0.9)
    assert np.quantile(laplace, 0.1) < 0.0775 < np.quantile(laplace, 0.95)
    assert ks_critical(200, 0.20) < 0.07753 < ks_critical(200, 0.10)


def test_chi_square_takes_a_true_law_as_often_as_it_should() -> None:
    taken = []
    for seed in range(200):
        x = np.random.default_rng(seed).normal(size=400)
        statistic, dof = chi_square(x, fit_law("normal", x))
        taken.append(stats.chi2.sf(statistic, dof) >= 0.05)
    assert 0.88 < np.mean(taken) < 0.99


def test_mixtures_win_where_there_is_a_mixture() -> None:
    rng = np.random.default_rng(5)
    x = np.where(rng.random(800) < 0.6, rng.normal(0, 1, 800), rng.normal(15, 5, 800))
    found = {t.law: t for t in law_tests(np.append(x, np.nan))}
    assert not found["normal"].ks_taken
    assert not found["normal"].chi2_taken
    assert found["2 normals"].ks_taken
    assert found["2 normals"].chi2_taken
    assert found["rayleigh"].ks > found["normal"].ks
    distances = window_distances(x, 120, ("2 normals", "normal"), step=40)
    assert distances.shape == (18, 2)
    assert np.all(distances[:, 0] < distances[:, 1])
    assert window_distances(x[:50], 120, ("normal",)).shape == (0, 1)


def test_quantile_pairs_of_a_true_law_lie_on_the_diagonal() -> None:
    x = np.random.default_rng(6).normal(3.0, 2.0, 2000)
    expected, seen = quantile_pairs(x, fit_law("normal", x))
    inner = slice(100, -100)
    np.testing.assert_allclose(seen[inner], expected[inner], atol=0.25)
    assert np.all(np.diff(seen) >= 0)
    assert np.all(np.diff(expected) > 0)
