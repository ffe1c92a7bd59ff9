"""The contract of every error model in the registry, and the laws that they end in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from fusion.catalogue import ERROR_MODELS
from fusion.gnss.error_models.base import ErrorLaw, Series, share_within
from fusion.gnss.reception import LOS, NLOS
from fusion.types import Floats

EPOCHS = 240


def series(seed: int = 0) -> Series:
    """A satellite that is direct, then reflected, then direct again."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(EPOCHS, dtype=float)
    reflected = (time_s > 80) & (time_s < 160)
    error_m = rng.normal(0, 1, EPOCHS) + np.where(reflected, rng.gamma(4, 5, EPOCHS), 0)
    return Series(time_s, error_m, np.where(reflected, NLOS, LOS), np.where(reflected, 34.0, 46.0))


def grid(law: ErrorLaw) -> Floats:
    """Errors from far left to far right of a law."""
    reach = 12 * np.sqrt(law.variance)
    return np.linspace(law.mean - reach, law.mean + 2 * reach, 9_001)


@pytest.mark.parametrize("name", ERROR_MODELS)
def test_a_model_keeps_its_contract(name: str) -> None:
    model = ERROR_MODELS[name]
    assert model.name == name and model.source and model.description
    law = model.law(series(), 1)
    at = grid(law)
    density = np.exp(law.log_density(at))
    assert integrate.simpson(density, x=at) == pytest.approx(1.0, abs=1e-5)
    assert integrate.simpson(density * at, x=at) == pytest.approx(law.mean, abs=1e-3)
    second = integrate.simpson(density * (at - law.mean) ** 2, x=at)
    assert second == pytest.approx(law.variance, rel=1e-3)
    running = integrate.cumulative_simpson(density, x=at, initial=0)
    assert np.abs(running - law.cdf(at)).max() < 1e-5
    drawn = law.draw(4000, np.random.default_rng(7))
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3


@pytest.mark.parametrize("name", ERROR_MODELS)
def test_a_track_has_moments_for_every_epoch_and_repeats_itself(name: str) -> None:
    model = ERROR_MODELS[name]
    mean, variance = model.track(series(), 5)
    again = model.track(series(), 5)
    assert mean.shape == variance.shape == (EPOCHS,)
    assert np.all(variance > 0) and np.isfinite(mean).all()
    assert np.array_equal(mean, again[0]) and np.array_equal(variance, again[1])


@pytest.mark.parametrize("name", ERROR_MODELS)
def test_a_track_does_not_look_ahead(name: str) -> None:
    whole = series()
    part = Series(*(getattr(whole, c)[:100] for c in ("time_s", "error_m", "state", "cn0_dbhz")))
    model = ERROR_MODELS[name]
    for long, short in zip(model.track(whole, 2), model.track(part, 2), strict=True):
        assert long[:80] == pytest.approx(short[:80], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", ERROR_MODELS)
def test_most_errors_lie_within_three_sigmas(name: str) -> None:
    mean, variance = ERROR_MODELS[name].track(series(), 3)
    shares = [share_within(series(), mean, variance, k) for k in (1.0, 2.0, 3.0)]
    assert shares == sorted(shares)
    assert shares[2] > 0.85


LAWS = st.builds(
    lambda share, sigma, tail: ErrorLaw(
        np.array([1 - share, share]), np.zeros(2), np.array([sigma, sigma]), np.array([0.0, tail])
    ),
    st.floats(0, 1),
    st.floats(0.1, 30),
    st.floats(0.5, 100),
)


@given(LAWS, st.floats(-1e4, 1e4))
def test_the_tails_stay_finite(law: ErrorLaw, error_m: float) -> None:
    log_density = law.log_density(np.array([error_m]))
    assert np.isfinite(log_density).all() and log_density[0] < 10
    assert 0.0 <= law.cdf(np.array([error_m]))[0] <= 1.0


@given(st.floats(0.2, 20), st.floats(0.5, 60), st.floats(-40, 200))
def test_the_tailed_normal_is_scipy_s(sigma: float, tail: float, error_m: float) -> None:
    law = ErrorLaw(np.ones(1), np.zeros(1), np.array([sigma]), np.array([tail]))
    expected = stats.exponnorm(tail / sigma, scale=sigma).logpdf(error_m)
    assert law.log_density(np.array([error_m]))[0] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_law_refuses_what_is_none() -> None:
    one = np.ones(1)
    for bad in (
        (2 * one, one, one, one),
        (one, one, 0 * one, one),
        (one, one, one, -one),
        (one, one * np.nan, one, one),
    ):
        with pytest.raises(ValueError, match="ErrorLaw"):
            ErrorLaw(*bad)


def test_a_series_refuses_what_is_none() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Series(np.zeros(0), np.zeros(0), np.zeros(0, int), np.zeros(0))
    with pytest.raises(ValueError, match="finite"):
        Series(np.zeros(1), np.full(1, np.nan), np.ones(1, int), np.zeros(1))
