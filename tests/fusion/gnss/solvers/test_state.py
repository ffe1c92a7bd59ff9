"""The local state: its frame, its motion, what it predicts, and how it begins."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from fusion.gnss.earth import ecef
from fusion.gnss.measurements import Measurements
from fusion.gnss.solvers import state
from fusion.types import Floats

PLACE_M = ecef(np.array([13.37]), np.array([52.51]), np.array([80.0]))[0]


def seen(rng: np.random.Generator, satellites: int = 9, errors_m: Floats | None = None) -> Measurements:
    """One epoch from ``PLACE_M``, moving with (9, -4, 0.5) m/s; the second half of another system."""
    frame = state.Frame(PLACE_M, state.local_axes(PLACE_M[None])[0])
    azimuth = np.linspace(0, 2 * np.pi, satellites, endpoint=False) + rng.uniform(0, 0.3, satellites)
    elevation = 0.25 + 1.1 * (np.arange(satellites) * 4 % 9) / 8 + rng.uniform(0, 0.1, satellites)
    sight = np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    place = PLACE_M + 2.3e7 * sight @ frame.axes
    speed = rng.normal(0, 2000, (satellites, 3))
    group = (np.arange(satellites) >= satellites // 2).astype(np.int64)
    true_sight = (place - PLACE_M) / np.linalg.norm(place - PLACE_M, axis=1, keepdims=True)
    velocity = np.array([9.0, -4.0, 0.5]) @ frame.axes
    return Measurements(
        time_s=np.array([1.4e9]),
        first=np.array([0, satellites]),
        satellite=np.arange(satellites),
        group=group,
        pseudorange_m=np.linalg.norm(place - PLACE_M, axis=1)
        + 120.0
        + 30.0 * group
        + (0.0 if errors_m is None else errors_m),
        range_rate_mps=np.sum((speed - velocity) * true_sight, axis=1) + 7.0,
        cn0_dbhz=np.full(satellites, 45.0),
        sigma_m=np.full(satellites, np.nan),
        elevation_rad=elevation,
        azimuth_rad=azimuth,
        satellite_m=place,
        satellite_mps=speed,
        names=tuple(str(i) for i in range(satellites)),
        groups=("G", "R"),
        rough_m=PLACE_M + np.array([300.0, -200.0, 150.0]),
    )


def begun(measured: Measurements) -> tuple[bool, Floats, Floats, state.Frame]:
    frame = state.Frame.around(measured)
    rows = frame.rows(measured, state.cn0_variance(measured.cn0_dbhz, measured.elevation_rad))
    mean, covariance = np.zeros(state.states(measured)), np.zeros((state.states(measured),) * 2)
    return bool(state.start(rows, 0, mean, covariance)), mean, covariance, frame


def test_a_start_without_errors_is_exact() -> None:
    known, mean, covariance, frame = begun(seen(np.random.default_rng(1)))
    position, velocity, turned = frame.to_ecef(mean[None], covariance[None])
    assert known
    np.testing.assert_allclose(position[0], PLACE_M, atol=1e-2)
    # From the rough place the sights turn by 2e-5.
    np.testing.assert_allclose(velocity[0] @ frame.axes.T, [9.0, -4.0, 0.5], atol=0.5)
    np.testing.assert_allclose(mean[[6, 8]], [120.0, 30.0], atol=1e-2)
    np.testing.assert_allclose(turned[0], turned[0].T, atol=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("late", range(9))
def test_one_reflected_satellite_of_nine_hardly_moves_the_start(late: int) -> None:
    errors = np.where(np.arange(9) == late, 150.0, 0.0)
    known, mean, covariance, frame = begun(seen(np.random.default_rng(late), errors_m=errors))
    off = mean[:3] - (PLACE_M - frame.origin_m) @ frame.axes.T
    assert known
    assert np.all(np.abs(off) < 5 * np.sqrt(np.diag(covariance)[:3]))


@pytest.mark.parametrize("satellites", [0, 1, 3])
def test_too_few_satellites_are_no_start(satellites: int) -> None:
    assert not begun(seen(np.random.default_rng(3), satellites))[0]


def test_satellites_at_one_place_are_no_start() -> None:
    measured = seen(np.random.default_rng(4))
    measured.satellite_m[:] = measured.satellite_m[0]
    assert not begun(measured)[0]


@settings(max_examples=20, deadline=None)
@given(dt_s=st.floats(0.01, 5.0))
def test_motion_and_noise_are_those_of_the_continuous_model(dt_s: float) -> None:
    """Van Loan's block exponential gives both, by another way."""
    n = 9
    drift, noise = np.zeros((n, n)), np.zeros((n, n))
    for i, j in ((0, 3), (1, 4), (2, 5), (6, 7)):
        drift[i, j] = 1.0
    noise[range(n), range(n)] = [0, 0, 0, 1.0, 1.0, 0.02, 0.1, 1.0, 1e-4]
    blocks = expm(np.block([[-drift, noise], [np.zeros((n, n)), drift.T]]) * dt_s)
    moves = blocks[n:, n:].T
    np.testing.assert_allclose(state.transition(dt_s, n), moves, atol=1e-12)
    np.testing.assert_allclose(state.process_noise(dt_s, n), moves @ blocks[:n, n:], atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_rows_are_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mean = rng.normal(0, 20, 9)
    place, speed = 2.3e7 * np.array([0.3, -0.5, 0.8]), rng.normal(0, 2000, 3)
    row, other = np.empty(9), np.empty(9)
    before = state.range_row(mean, place, 1, row)
    for i in range(9):
        step = np.where(np.arange(9) == i, 1.0, 0.0)
        assert state.range_row(mean + step, place, 1, other) - before == pytest.approx(row[i], abs=1e-6)
    before = state.rate_row(mean, place, speed, row)
    for i in range(3, 9):
        step = np.where(np.arange(9) == i, 1.0, 0.0)
        assert state.rate_row(mean + step, place, speed, other) - before == pytest.approx(row[i], abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), k=st.integers(1, 10))
def test_inverses_are_numpys(seed: int, k: int) -> None:
    half = np.random.default_rng(seed).normal(size=(k, k + 2))
    matrix, inverse = half @ half.T, np.empty((k, k))
    assert state.invert(matrix, inverse)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), rtol=1e-6, atol=1e-9)


def test_a_matrix_without_an_inverse_is_told() -> None:
    assert not state.invert(np.ones((3, 3)), np.empty((3, 3)))
    assert not state.invert(np.diag([1.0, np.nan]), np.empty((2, 2)))
