"""The filters against each other where theory makes them equal: on a linear Gaussian model."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.filters import kalman
from fusion.filters.smoother import LinearModel
from fusion.filters.unscented import Unscented
from smoothing import smoothed_with_covariances

STEPS = 150
TRANSITION = np.kron(np.eye(2), [[1.0, 0.5], [0.0, 1.0]])
PROCESS = np.kron(np.eye(2), [[0.02, 0.05], [0.05, 0.2]])
DESIGN = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0.6, 0, 0.8]])
NOISE = np.diag([4.0, 9.0, 0.5])
VALUES = np.random.default_rng(1).normal([1.0, -2.0, 0.5], [2.0, 3.0, 0.7], (STEPS, 3))
Moments = tuple[np.ndarray, np.ndarray]


def linear() -> list[Moments]:
    state, states = (np.zeros(4), 10.0 * np.eye(4)), []
    for z in VALUES:
        x, p = kalman.predict(*state, TRANSITION, PROCESS)
        state = kalman.correct(x, p, z - DESIGN @ x, DESIGN, NOISE)
        states.append(state)
    return states


def linearised() -> list[Moments]:
    state, states = (np.zeros(4), 10.0 * np.eye(4)), []
    for z in VALUES:
        predicted = kalman.predict_extended(*state, lambda x: TRANSITION @ x, lambda _: TRANSITION, PROCESS)  # type: ignore[return-value]
        state = kalman.correct_extended(*predicted, z, lambda x: DESIGN @ x, lambda _: DESIGN, NOISE)
        states.append(state)
    return states


def by_points(unscented: Unscented) -> list[Moments]:
    state, states = (np.zeros(4), 10.0 * np.eye(4)), []
    for z in VALUES:
        predicted = unscented.predict(*state, lambda points: points @ TRANSITION.T, PROCESS)
        state = unscented.correct(*predicted, z, lambda points: points @ DESIGN.T, NOISE)
        states.append(state)
    return states


def assert_equal(first: list[Moments], second: list[Moments]) -> None:
    for (x, p), (other_x, other_p) in zip(first, second, strict=True):
        assert x == pytest.approx(other_x, rel=1e-9, abs=1e-9)
        assert p == pytest.approx(other_p, rel=1e-9, abs=1e-9)


def test_the_extended_filter_is_the_kalman_filter() -> None:
    assert_equal(linearised(), linear())


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [1e-3, 1e-2, 0.5, 1.0, 1e3])
@pytest.mark.parametrize("kappa", [0.0, -1.0, 3.0])
def test_the_unscented_filter_is_the_kalman_filter(alpha: float, kappa: float) -> None:
    """For any spread of the points, the 10^3 that Saadaoui prints among them: a linear model can't tell."""
    assert_equal(by_points(Unscented(alpha, kappa=kappa)), linear())


def test_the_smoother_ends_where_the_filter_ends() -> None:
    """And the innovations on the way have the likelihood that the smoother reports."""
    start = kalman.predict(np.zeros(4), 10.0 * np.eye(4), TRANSITION, PROCESS)
    model = LinearModel(
        steps=STEPS,
        transition={pair: np.full(STEPS, TRANSITION[pair]) for pair in np.ndindex(4, 4) if TRANSITION[pair]},
        noise={
            (a, b): np.full(STEPS, PROCESS[a, b]) for a in range(4) for b in range(a + 1) if PROCESS[a, b]
        },
        mean=start[0],
        covariance=start[1],
        step=np.repeat(np.arange(STEPS), 3),
        design=np.tile(DESIGN, (STEPS, 1)),
        value=VALUES.ravel(),
        variance=np.tile(np.diag(NOISE), STEPS),
    )
    smoothed, covariance = smoothed_with_covariances(model)
    assert_equal([(smoothed.mean[-1], covariance[-1])], linear()[-1:])

    likelihood, state = 0.0, (np.zeros(4), 10.0 * np.eye(4))
    for z in VALUES:
        x, p = kalman.predict(*state, TRANSITION, PROCESS)
        residual = z - DESIGN @ x
        determinant = np.linalg.slogdet(DESIGN @ p @ DESIGN.T + NOISE)[1]
        likelihood -= 0.5 * (determinant + kalman.normalised_square(p, residual, DESIGN, NOISE))
        state = kalman.correct(x, p, residual, DESIGN, NOISE)
    assert smoothed.log_likelihood == pytest.approx(likelihood, rel=1e-10)
