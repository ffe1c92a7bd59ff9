"""Levels are not known exactly: how uncertain they are, and the variances that are to be expected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.profile.levels import LEAST_HEIGHT_M, MOST_UNCERTAIN, expected, log_sigmas, most_likely
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH
from fusion.profile.model import Noise
from fusion.profile.prior import LOG_ROUGHNESS, LOG_WANDER, WHITE, prior_of
from model_drives import TRUTHS, simulate

EVERYTHING = (ALTITUDE, DOPPLER, PITCH, FORCE, BARO)
VARIANCES = ("roughness", "drift", "baro_drift")
TRUTH = TRUTHS[1].with_(baro_m=0.2, baro_drift=0.01)


def uncertain(sensors: tuple[int, ...], seed: int, seconds: int) -> tuple[Noise, dict[str, float]]:
    """The most likely levels of a drive, and the sigmas of their logs."""
    one = simulate(seed, TRUTH, sensors=sensors, seconds=seconds)
    prior = prior_of(one.measured)
    noise = prior.noise
    weight = np.ones(len(one.measured))
    for _ in range(2):
        noise = most_likely(one.measured, one.epochs, noise, prior, weight, ())
    return noise, log_sigmas(one.measured, one.epochs, noise, prior, weight, ())


@given(
    st.dictionaries(st.sampled_from([*WHITE.values(), *VARIANCES, "wander"]), st.floats(0, 1), min_size=1),
    st.integers(0, 100),
)
@settings(max_examples=25)
def test_the_expected_variance_is_the_mean_of_what_levels_may_be(sigma: dict[str, float], seed: int) -> None:
    """By 4000 draws of normal logs, mirrored; levels of which nothing is said stay."""
    half = np.random.default_rng(seed).normal(size=4000)
    draw, noise = np.concatenate([half, -half]), Noise()
    found = expected(noise, sigma)
    for name in noise.__dataclass_fields__:
        if name not in sigma:
            assert getattr(found, name) == getattr(noise, name)
            continue
        power = 1 if name in VARIANCES else 2
        mean = np.mean(np.exp(sigma[name] * draw) ** power)
        ratio = (getattr(found, name) / getattr(noise, name)) ** power
        assert np.log(ratio) == pytest.approx(np.log(mean), abs=0.05 + 0.2 * (power * sigma[name]) ** 2)


def test_with_much_data_the_expected_levels_are_the_most_likely_ones() -> None:
    """Of two hours: by Cramer and Rao gusts hide the drift of a barometer from half of the data and more."""
    noise, sigma = uncertain(EVERYTHING, 3, 7200)
    likely = expected(noise, sigma)
    for name, value in sigma.items():
        assert value < 0.15, name
        assert 1 <= getattr(likely, name) / getattr(noise, name) < 1.02, name


def test_without_data_they_are_as_uncertain_as_beforehand() -> None:
    """Two instants tell nothing of rates, and of white levels next to nothing."""
    _, sigma = uncertain(EVERYTHING, 1, 2)
    assert sigma["roughness"] == pytest.approx(min(LOG_ROUGHNESS[1], MOST_UNCERTAIN), abs=0.01)
    assert sigma["drift"] == pytest.approx(MOST_UNCERTAIN, abs=0.01)
    assert sigma["wander"] == pytest.approx(LOG_WANDER[1], abs=0.02)
    for name in WHITE.values():
        assert 0.4 < sigma[name] <= MOST_UNCERTAIN, name


@pytest.mark.slow
@given(st.sampled_from([EVERYTHING, (ALTITUDE,), (DOPPLER, BARO), (PITCH, FORCE)]), st.integers(2, 200))
@settings(max_examples=20)
def test_nothing_is_less_sure_than_beforehand(sensors: tuple[int, ...], seconds: int) -> None:
    _, sigma = uncertain(sensors, 5, seconds)
    for name, value in sigma.items():
        assert 0 <= value <= min(LOG_WANDER[1] if name == "wander" else 2.0, MOST_UNCERTAIN), name


def test_a_level_that_is_the_least_is_taken_for_known() -> None:
    one = simulate(2, TRUTH.with_(altitude_m=1e-3, drift=1e-3), sensors=(ALTITUDE, DOPPLER), seconds=300)
    prior, weight = prior_of(one.measured), np.ones(len(one.measured))
    noise = prior.noise
    for _ in range(4):
        noise = most_likely(one.measured, one.epochs, noise, prior, weight, ())
    assert noise.altitude_m == pytest.approx(LEAST_HEIGHT_M)
    sigma = log_sigmas(one.measured, one.epochs, noise, prior, weight, ())
    assert sigma["altitude_m"] == 0
    assert sigma["drift"] > 0


@pytest.mark.slow
def test_levels_scatter_as_much_as_they_are_said_to() -> None:
    """Rates of 120 drives of five minutes, about the truth: within a fifth of what is said."""
    off: dict[str, list[float]] = {}
    for seed in range(120):
        noise, sigma = uncertain(EVERYTHING, seed, 300)
        for name in VARIANCES:
            off.setdefault(name, []).append(np.log(getattr(noise, name) / getattr(TRUTH, name)) / sigma[name])
    for name, z in off.items():
        assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.3, name


def test_a_drive_s_variances_are_the_expected_ones() -> None:
    """What factors are made of holds the doubt about levels; the report says the most likely ones."""
    learned = simulate(4, TRUTH, sensors=EVERYTHING, seconds=60).learned()
    for name in (*WHITE.values(), *VARIANCES, "wander"):
        assert getattr(learned.expected, name) > getattr(learned.noise, name), name
