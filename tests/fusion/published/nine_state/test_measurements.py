"""Jacobians of the nine-state model against differences, and what a Gaussian state says in their terms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.published.nine_state.measurements import (
    SLOWEST_MPS,
    gaussian_estimate,
    ground_measurement,
    heading_measurement,
    pitch_measurement,
    predicted_map,
)
from fusion.published.nine_state.motion import STATES, STEEPEST_RAD, VX, VY, VZ, X, Y, Z
from fusion.types import Floats
from reference_filters import derivative

speeds = st.floats(0.6, 60.0)
directions = st.floats(-math.pi, math.pi)
grades = st.floats(-0.3, 0.3)


def state_of(speed: float, direction: float, grade: float) -> Floats:
    state = np.linspace(-3.0, 5.0, STATES)
    state[[VX, VY, VZ]] = speed * math.cos(direction), speed * math.sin(direction), speed * grade
    return state


def some_covariance(seed: int) -> Floats:
    root = np.random.default_rng(seed).normal(size=(STATES, STATES))
    return root @ root.T / 50


@given(speeds, directions, grades)
def test_rows_are_derivatives(speed: float, direction: float, grade: float) -> None:
    state = state_of(speed, direction, grade)
    heading, row = heading_measurement(state)
    assert heading == pytest.approx(math.remainder(direction, 2 * math.pi), abs=1e-12)

    def turn(s: Floats) -> Floats:
        return np.array([math.remainder(heading_measurement(s)[0] - heading, 2 * math.pi)])

    assert row == pytest.approx(derivative(turn, state)[0], abs=1e-7)
    pitch, row = pitch_measurement(state)
    assert math.tan(pitch) == pytest.approx(grade, abs=1e-12)
    assert row == pytest.approx(derivative(lambda s: np.array([pitch_measurement(s)[0]]), state)[0], abs=1e-7)


@given(speeds, directions, st.floats(-0.3, 0.3) | st.floats(0.5, 0.9), st.floats(0.0, 10.0))
def test_the_ground_lies_under_the_antenna(
    speed: float, direction: float, grade: float, antenna_m: float
) -> None:
    state = state_of(speed, direction, grade)
    height, row = ground_measurement(state, antenna_m)
    # No road is steeper than this, whatever the velocity says.
    steep = min(abs(math.atan(grade)), STEEPEST_RAD)
    assert state[Z] - height == pytest.approx(antenna_m / math.cos(steep))
    numeric = derivative(lambda s: np.array([ground_measurement(s, antenna_m)[0]]), state)[0]
    assert row == pytest.approx(numeric, abs=1e-6)


@pytest.mark.parametrize("speed", [0.0, 1e-9, 0.2])
def test_near_standstill_rows_stay_finite(speed: float) -> None:
    state = state_of(speed, 0.7, 0.05)
    state[VZ] = 0.02
    for row in (
        heading_measurement(state)[1],
        pitch_measurement(state)[1],
        ground_measurement(state, 1.5)[1],
    ):
        assert np.all(np.isfinite(row))
        assert np.abs(row).max() <= 1 / SLOWEST_MPS + 1e-9
    assert pitch_measurement(state)[0] == pytest.approx(math.atan(0.02 / SLOWEST_MPS))


@given(speeds, directions, grades, st.integers(0, 20))
def test_what_a_gaussian_says_is_what_its_samples_say_to_first_order(
    speed: float, direction: float, grade: float, seed: int
) -> None:
    """Covariances through the rows are those of the functions' values, for a Gaussian narrow enough."""
    state, covariance = state_of(speed, direction, grade), some_covariance(seed) * 1e-10
    predicted, estimate = predicted_map(state, covariance), gaussian_estimate(state, covariance)
    root = np.linalg.cholesky(covariance)
    points = state + np.concatenate([3 * root.T, -3 * root.T])  # sigma points: exact for linear functions
    turn = [math.remainder(heading_measurement(p)[0] - predicted.heading_rad, 2 * math.pi) for p in points]
    on_map = np.column_stack([points[:, [X, Y]] - state[[X, Y]], turn])
    assert predicted.covariance == pytest.approx(on_map.T @ on_map / 18, rel=1e-3, abs=1e-14)
    assert predicted.covariance == pytest.approx(predicted.covariance.T, abs=0)
    assert (predicted.x_m, predicted.y_m) == (state[X], state[Y])
    pitches = np.array([pitch_measurement(p)[0] for p in points]) - estimate.pitch_rad
    assert estimate.pitch_sigma_rad == pytest.approx(math.sqrt(pitches @ pitches / 18), rel=1e-3)
    assert estimate.h_sigma_m == pytest.approx(math.sqrt(covariance[X, X] + covariance[Y, Y]))
    assert estimate.z_sigma_m == pytest.approx(math.sqrt(covariance[Z, Z]))
    assert estimate.heading_rad == predicted.heading_rad
