"""Fitted laws: what they were drawn from comes back, and cdf and quantile are inverse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from fusion.errors import UnknownNameError
from fusion.published.positioning.laws import LAWS, TooFewSamplesError, fit_law


def draws(count: int = 4000, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.where(rng.random(count) < 0.7, rng.normal(0, 1, count), rng.normal(12, 4, count))


@pytest.mark.parametrize("name", LAWS)
def test_quantile_and_cdf_are_inverse(name: str) -> None:
    law = fit_law(name, np.abs(draws(400)))
    probability = np.linspace(0.01, 0.99, 25)
    np.testing.assert_allclose(law.cdf(law.quantile(probability)), probability, atol=1e-6)


def test_laws_against_scipy() -> None:
    x = np.random.default_rng(3).laplace(2.0, 1.5, 5000)
    at = np.linspace(-5, 9, 15)
    np.testing.assert_allclose(fit_law("laplace", x).cdf(at), stats.laplace(2.0, 1.5).cdf(at), atol=0.02)
    np.testing.assert_allclose(
        fit_law("normal", x).cdf(at), stats.norm(x.mean(), x.std()).cdf(at), atol=1e-12
    )
    r = stats.rayleigh(scale=3.0).rvs(5000, random_state=4)
    np.testing.assert_allclose(fit_law("rayleigh", r).cdf(at), stats.rayleigh(scale=3.0).cdf(at), atol=0.02)


def test_a_mixture_comes_back() -> None:
    law = fit_law("2 normals", draws())
    at = np.linspace(-3, 25, 40)
    true = 0.7 * stats.norm.cdf(at) + 0.3 * stats.norm.cdf(at, 12, 4)
    np.testing.assert_allclose(law.cdf(at), true, atol=0.02)
    assert law.parameters == 5
    assert fit_law("10 normals", draws()).parameters == 29


def test_scale_does_not_matter() -> None:
    metres, millimetres = fit_law("3 normals", draws(500)), fit_law("3 normals", draws(500) * 0.05)
    at = np.linspace(-2, 20, 12)
    np.testing.assert_allclose(metres.cdf(at), millimetres.cdf(0.05 * at), atol=0.02)


def test_bad_wishes_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="There is no law called 'cauchy'"):
        fit_law("cauchy", draws(50))
    with pytest.raises(TooFewSamplesError, match="20 residuals or more, and there are 19"):
        fit_law("normal", draws(19))
