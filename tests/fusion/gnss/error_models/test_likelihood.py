"""The one-sided law, by its properties and against numerical integration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from fusion.gnss.error_models import likelihood
from fusion.gnss.error_models.likelihood import Errors, Law

SHARES = st.floats(0.0, 0.99)
VARIANCES = st.floats(1.0, 900.0)
DELAYS = st.floats(5.0, 60.0)
ERRORS = st.floats(-60.0, 200.0)


def density(error: float, share: float, variance: float, delay: float) -> float:
    return float(np.exp(likelihood.log_density(error, share, variance, delay)))


def test_the_density_is_the_convolution() -> None:
    for error in (-30.0, -5.0, 0.0, 8.0, 60.0):
        for variance in (4.0, 100.0):
            sigma = variance**0.5
            late = quad(
                lambda t, e=error, s=sigma: norm.pdf(e - t, 0, s) * np.exp(-t / 30) / 30,
                max(0.0, error - 9 * sigma),
                max(0.0, error) + 9 * sigma,
            )[0]
            expected = 0.7 * norm.pdf(error, 0, sigma) + 0.3 * late
            assert density(error, 0.3, variance, 30.0) == pytest.approx(expected, rel=1e-5)


@given(share=SHARES, variance=VARIANCES, delay=DELAYS)
def test_densities_sum_to_one(share: float, variance: float, delay: float) -> None:
    low = -12 * variance**0.5
    total = quad(
        density, low, 40 * delay - low, args=(share, variance, delay), limit=300, points=[0.0, delay]
    )
    assert total[0] == pytest.approx(1.0, abs=1e-5)


@given(error=ERRORS, share=SHARES, variance=VARIANCES, delay=DELAYS)
@example(
    error=39.0, share=5e-324, variance=1.0, delay=5.0
)  # the smallest share, of signals that are surely late
@example(error=-30.0, share=0.5, variance=16.0, delay=8.0)  # eight sigmas before the delayed ones
@example(error=-59.96875, share=0.5, variance=6.25, delay=200 / 81)  # where the tail's form changes
def test_the_pull_is_the_slope(error: float, share: float, variance: float, delay: float) -> None:
    step = 1e-4
    slope = (
        likelihood.log_density(error + step, share, variance, delay)
        - likelihood.log_density(error - step, share, variance, delay)
    ) / (2 * step)
    assert likelihood.pull(error, share, variance, delay) == pytest.approx(-slope, abs=2e-3, rel=2e-3)


@given(share=SHARES, variance=VARIANCES, delay=DELAYS)
def test_the_mode_is_late_and_densest(share: float, variance: float, delay: float) -> None:
    mode = float(likelihood.modes(np.array([share]), np.array([variance]), np.array([delay]))[0])
    assert 0 <= mode < 3 * variance**0.5 + delay
    around = mode + np.array([-1.0, 1.0]) * 0.05 * variance**0.5
    at = likelihood.log_density(mode, share, variance, delay)
    assert all(likelihood.log_density(float(e), share, variance, delay) <= at + 1e-9 for e in around)


@given(share=st.floats(0.05, 0.95), variance=VARIANCES, delay=DELAYS)
def test_later_is_more_likely_reflected(share: float, variance: float, delay: float) -> None:
    errors = np.linspace(-20, 150, 30)
    late = [likelihood.reflected(float(error), share, variance, delay) for error in errors]
    assert np.all(np.diff(late) >= -1e-9)
    assert 0 <= late[0] <= late[-1] <= 1


@given(error=ERRORS, cn0=st.floats(15.0, 55.0))
def test_weights_pull_as_the_law_does(error: float, cn0: float) -> None:
    errors = Law().errors(np.array([cn0]))
    variance, mode = likelihood.variance_at(error, errors, 0), errors.mode_m[0]
    assert variance > 0
    if abs(error - mode) > 0.05 * errors.variance_m2[0] ** 0.5 and variance > 0.26 * errors.variance_m2[0]:
        law = errors.share[0], errors.variance_m2[0], errors.delay_m[0]
        assert (error - mode) / variance == pytest.approx(likelihood.pull(error, *law), rel=1e-9)


@given(error=ERRORS, variance=VARIANCES)
def test_without_reflections_the_law_is_normal(error: float, variance: float) -> None:
    errors = Errors(np.zeros(1), np.array([variance]), np.array([30.0]), np.zeros(1))
    assert likelihood.variance_at(error, errors, 0) == pytest.approx(variance)
    assert likelihood.pull(error, 0.0, variance, 30.0) == pytest.approx(error / variance)


def test_a_weaker_receiver_is_believed_alike() -> None:
    cn0 = np.array([50.0, 40.0, 30.0, np.nan])
    strong, weak = Law().errors(cn0), Law(midpoint_dbhz=35.0).errors(cn0 - 5)
    for one, other in zip(strong, weak, strict=True):
        np.testing.assert_allclose(one[:3], other[:3])
    assert strong.share[1] == pytest.approx(0.5)
    assert strong.variance_m2[1] == pytest.approx(2**2 + 1.5**2 * 10**0.5)
    assert np.isfinite(strong.mode_m).all()
