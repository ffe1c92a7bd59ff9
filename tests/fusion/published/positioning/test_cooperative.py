"""Ranges to neighbours: they mend a bad place, tolerate a bad range, and never speak alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from fusion.published.positioning.cooperative import (
    FEWEST_NEIGHBOURS,
    TOLERATED_SIGMAS,
    Neighbours,
    contaminated,
    refined,
)

AROUND_M = np.array([[80.0, 10.0], [-60.0, 45.0], [5.0, -90.0], [-40.0, -70.0]])


def around(truth_m: np.ndarray, rng: np.random.Generator, sigma_m: float = 1.0) -> Neighbours:
    places = truth_m + AROUND_M
    told = places + sigma_m * rng.normal(size=places.shape)
    ranges = np.linalg.norm(AROUND_M, axis=1) + 0.5 * rng.normal(size=len(AROUND_M))
    return Neighbours(told, np.full(len(AROUND_M), sigma_m), ranges, 0.5)


def test_a_place_that_reflections_spoil_is_mended() -> None:
    rng, errors = np.random.default_rng(3), []
    for _ in range(200):
        truth = rng.uniform(-500, 500, 2)
        bad = truth + 20.0 * rng.normal(size=2)
        errors.append(np.linalg.norm(refined(bad, 400.0 * np.eye(2), around(truth, rng)) - truth))
    assert np.mean(errors) < 1.5


def test_one_bad_range_does_not_lead_astray() -> None:
    rng, errors = np.random.default_rng(5), []
    for _ in range(100):
        truth = rng.uniform(-500, 500, 2)
        told = around(truth, rng)
        told.range_m[0] += 60.0
        errors.append(np.linalg.norm(refined(truth + rng.normal(size=2), 25.0 * np.eye(2), told) - truth))
    assert np.mean(errors) < 3.0


def test_too_few_neighbours_are_not_asked() -> None:
    many, k = around(np.zeros(2), np.random.default_rng(1)), FEWEST_NEIGHBOURS - 1
    told = Neighbours(many.place_m[:k], many.sigma_m[:k], many.range_m[:k], 0.5)
    assert refined(np.array([3.0, 4.0]), np.eye(2), told).tolist() == [3.0, 4.0]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_it_is_the_most_likely_place(seed: int) -> None:
    """Against a general minimiser of the same sum."""
    rng = np.random.default_rng(seed)
    own, told = rng.normal(0, 3, 2), around(np.zeros(2), rng)
    spread = np.array([[9.0, 2.0], [2.0, 16.0]])
    sigma = np.hypot(told.sigma_m, told.range_sigma_m)

    def cost(at: np.ndarray) -> float:
        off = np.abs(np.linalg.norm(at - told.place_m, axis=1) - told.range_m) / sigma
        huber = np.where(off < TOLERATED_SIGMAS, off**2, TOLERATED_SIGMAS * (2 * off - TOLERATED_SIGMAS))
        return float(huber.sum() + (at - own) @ np.linalg.inv(spread) @ (at - own))

    best = minimize(cost, own, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-8, "maxiter": 2000})
    assert cost(refined(own, spread, told)) == pytest.approx(best.fun, abs=1e-3)


def test_epochs_are_contaminated_by_their_share_of_reflections() -> None:
    reflected = np.array([1, 0, 0, 0, 0, 0, 1, 1], bool)
    assert contaminated(reflected, np.array([0, 4, 4, 6, 8])).tolist() == [True, False, False, True]
