"""The most likely noise levels: the gradient that finds them, and what they are where the truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

from fusion.profile.levels import ROBUST_INFORMATION_LOSS, gaussian_variance, most_likely
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH
from fusion.profile.model import Noise, linear_model
from fusion.profile.prior import LOG_GRADE_LENGTH, LOG_ROUGHNESS, LOG_SPREAD, LOG_WANDER, WHITE, prior_of
from model_drives import TRUTHS, Simulated, simulate

EVERYTHING = (ALTITUDE, DOPPLER, PITCH, FORCE, BARO)
RATES = {"roughness": None, "drift": ALTITUDE, "baro_drift": BARO, "wander": PITCH}


def learnable(sensors: tuple[int, ...]) -> list[str]:
    """Names of the levels that a drive with these sensors can tell, white ones first, the grade's length last."""
    white = [name for sensor, name in WHITE.items() if sensor in sensors]
    rates = [name for name, sensor in RATES.items() if sensor is None or sensor in sensors]
    return [*white, *rates, *(["grade_length_m"] if {PITCH, FORCE} & set(sensors) else [])]


def likely(sensors: tuple[int, ...], truth: Noise, seed: int, seconds: int = 600) -> tuple[Simulated, Noise]:
    """A drive, and its levels by two rounds from where learning starts."""
    one = simulate(seed, truth, sensors=sensors, seconds=seconds)
    prior = prior_of(one.measured)
    noise = prior.noise
    for _ in range(2):
        noise = most_likely(one.measured, one.epochs, noise, prior, np.ones(len(one.measured)), ())
    return one, noise


def posterior(one: Simulated, noise: Noise, weight: np.ndarray) -> float:
    """Log-likelihood of everything measured, and the weak priors of the logs of the levels."""
    sensors = tuple(np.unique(one.measured.sensor).tolist())
    start = prior_of(one.measured).noise
    variance = gaussian_variance(one.measured, noise) / weight
    total = linear_model(one.measured, one.epochs, noise, variance).scores().log_likelihood
    for name in learnable(sensors):
        usual = (np.log(getattr(start, name)), LOG_SPREAD)
        mean, sigma = {
            "roughness": LOG_ROUGHNESS,
            "wander": LOG_WANDER,
            "grade_length_m": LOG_GRADE_LENGTH,
        }.get(name, usual)
        total -= 0.5 * ((np.log(getattr(noise, name)) - mean) / sigma) ** 2
    return total


@pytest.mark.parametrize("sensors", [EVERYTHING, (ALTITUDE,), (DOPPLER, BARO)])
def test_the_gradient_is_that_of_the_likelihood(
    sensors: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loss that is minimised and its gradient, against differences of the likelihood by each log of a level."""
    one = simulate(4, TRUTHS[1], sensors=sensors, seconds=80)
    turn = np.random.default_rng(2).uniform(
        0, 0.2, len(one.measured)
    )  # a part of the variance that no level has
    one = replace(one, measured=replace(one.measured, turn=turn))
    weight = np.random.default_rng(1).uniform(0.3, 1.0, len(one.measured))
    caught: list[Callable[[np.ndarray], tuple[float, np.ndarray]]] = []

    def catch(
        loss: Callable[[np.ndarray], tuple[float, np.ndarray]], begin: np.ndarray, **_: object
    ) -> object:
        caught.append(loss)
        return optimize.OptimizeResult(x=begin)

    monkeypatch.setattr(optimize, "minimize", catch)
    monkeypatch.setattr("fusion.profile.levels._LENGTH_STEP", 1e-4)  # that derivative is a difference itself
    prior = prior_of(one.measured)
    here = prior.noise.with_(roughness=1e-5, doppler=1.4)
    here = here.with_(grade_length_m=50.0) if PITCH in sensors else here
    most_likely(one.measured, one.epochs, here, prior, weight, ())
    (loss,), names = caught, learnable(sensors)
    value, gradient = loss(np.zeros(len(names)))
    assert value == pytest.approx(-posterior(one, here, weight), rel=1e-9)
    for k, name in enumerate(names):
        step = 1e-2 * np.eye(len(names))[k]
        (up, _), (down, _) = loss(step), loss(-step)
        assert gradient[k] == pytest.approx((up - down) / 2e-2, rel=1e-3, abs=1e-4), name


@pytest.mark.slow
@pytest.mark.parametrize("truth", TRUTHS, ids=["smooth road", "ordinary", "poor receiver"])
def test_levels_of_drawn_drives_are_recovered(truth: Noise) -> None:
    """To ten per cent on the mean of many drives; a white level counts what Student's t would tell (``levels``).

    Of one drive of 20 minutes the drift of a barometer beside a poor receiver is known to a quarter.
    """
    truth = truth.with_(baro_m=0.2, baro_drift=0.01)
    found = [likely(EVERYTHING, truth, seed, 1200)[1] for seed in range(24)]
    for name in learnable(EVERYTHING):
        power = 0.5 if name in RATES and name != "wander" else 1.0
        usual = 1.0 if name not in WHITE.values() else ROBUST_INFORMATION_LOSS**-0.5
        ratio = [(getattr(noise, name) / getattr(truth, name)) ** power / usual for noise in found]
        assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.0, abs=0.1), (name, np.round(ratio, 2))


@pytest.mark.slow
def test_three_per_cent_of_gross_outliers_do_not_spoil_them() -> None:
    """Not of ``most_likely`` alone, which takes weights as given, but of all the learning around it."""
    change = []
    for seed in range(4):
        one = simulate(seed, TRUTHS[1], sensors=EVERYTHING)
        rng, value = np.random.default_rng(seed), one.measured.value.copy()
        wild = rng.random(len(value)) < 0.03
        size = np.array([20.0, 0.4, 0.4, 0.4, 10.0])[one.measured.sensor]  # twenty sigmas and more
        value[wild] += (rng.choice([-1, 1], len(value)) * size)[wild]
        before = one.learned().noise
        after = replace(one, measured=replace(one.measured, value=value)).learned().noise
        names = learnable(EVERYTHING)
        change.append([np.log(getattr(after, n) / getattr(before, n)) for n in names])
    for name, mean in zip(names, np.mean(change, axis=0).tolist(), strict=True):
        limit = 0.5 if name in RATES else 0.25
        assert abs(mean) < limit, (name, mean)


def test_what_nothing_tells_of_stays_where_it_started() -> None:
    one, noise = likely((DOPPLER,), TRUTHS[1], 1, 100)
    start = prior_of(one.measured).noise
    for name in ("altitude_m", "drift", "pitch", "force", "baro_m", "baro_drift", "dem_m", "shared"):
        assert getattr(noise, name) == getattr(start, name)


def test_a_log_of_two_measurements_stays_near_its_start() -> None:
    """The priors are weak, but they are there."""
    one, noise = likely((ALTITUDE, DOPPLER), TRUTHS[1], 2, 2)
    start = prior_of(one.measured).noise
    for name in ("altitude_m", "doppler", "drift"):
        assert 1 / 4 < getattr(noise, name) / getattr(start, name) < 4, name
