"""The Kalman filter against the textbook's, step by step, and what widens it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.filters import kalman
from fusion.gnss.measurements import Aids, Measurements, Solution
from fusion.gnss.solvers.ekf import Ekf, EkfOptions, correct_ranges, correct_rates, motion, surprises
from fusion.gnss.solvers.state import (
    Frame,
    Rows,
    cn0_variance,
    process_noise,
    range_row,
    rate_row,
    start,
    states,
)
from fusion.types import Floats, no_progress
from gnss_scene import errors_m, horizontal_m2, scene


def solved(measured: Measurements, aids: Aids | None = None, **chosen: float | bool) -> Solution:
    options = EkfOptions(**chosen)  # type: ignore[arg-type]
    return Ekf().solve(measured, aids or Aids.none(len(measured)), options, 0, no_progress)


def begun(seed: int, groups: int = 2) -> tuple[Rows, Floats, Floats]:
    """Rows of a drive, and the state after its first epoch, moved to the second."""
    measured = scene(epochs=2, groups=groups, satellites=12, seed=seed).measured
    rows = Frame.around(measured).rows(measured, cn0_variance(measured.cn0_dbhz, measured.elevation_rad))
    n = states(measured)
    mean, covariance = np.zeros(n), np.zeros((n, n))
    assert start(rows, 0, mean, covariance)
    moves = motion(n, 1.0, np.nan)
    return rows, moves @ mean, moves @ covariance @ moves.T + process_noise(1.0, n)


@settings(max_examples=15)
@given(st.integers(0, 1000), st.floats(1.0, 30.0))
def test_an_epoch_is_the_textbook_s(seed: int, repeats: float) -> None:
    rows, mean, covariance = begun(seed)
    part = slice(rows.first[1], rows.first[2])

    def both(x: Floats) -> tuple[Floats, Floats]:
        row = np.zeros(len(x))
        pairs = [
            (range_row(x, place, group, row), row.copy())
            for place, group in zip(rows.place_m[part], rows.group[part], strict=True)
        ]
        return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])

    noise = np.diag(rows.variance_m2[part] * repeats)
    expected = kalman.correct_extended(
        mean, covariance, rows.range_m[part], lambda x: both(x)[0], lambda x: both(x)[1], noise
    )
    variance, usual = surprises(rows, 1, mean, covariance, repeats)
    assert usual < 9 and variance == pytest.approx(np.diag(noise))
    moved_by = np.zeros((len(mean), 12))
    correct_ranges(rows, 1, mean, covariance, moved_by, repeats)
    assert mean == pytest.approx(expected[0], abs=1e-3)
    assert covariance == pytest.approx(expected[1], abs=1e-3, rel=1e-4)


@settings(max_examples=10)
@given(st.integers(0, 1000), st.integers(0, 11), st.floats(-3.0, 3.0))
def test_what_an_error_moves_is_what_is_remembered(seed: int, satellite: int, error_m: float) -> None:
    """A filter whose one satellite is wrong differs from the right one by its column times the error."""
    rows, mean, covariance = begun(seed)
    wrong_m = rows.range_m.copy()
    wrong_m[rows.satellite == satellite] += error_m
    ends = []
    moved_by = np.zeros((len(mean), 12))
    for ranges in (rows.range_m, wrong_m):
        here, spread = mean.copy(), covariance.copy()
        moved_by[:] = 0.0
        correct_ranges(rows._replace(range_m=ranges), 1, here, spread, moved_by, 10.0)
        ends.append(here)
    assert ends[1] - ends[0] == pytest.approx(moved_by[:, satellite] * error_m, abs=2e-3)


def test_range_rates_find_the_velocity() -> None:
    rows, mean, covariance = begun(3)
    correct_rates(rows, 1, mean, covariance, np.zeros((len(mean), 12)))
    assert mean[3:6] == pytest.approx([10.0, 0.0, 0.0], abs=0.6)
    row = np.zeros(len(mean))
    assert rate_row(mean, rows.place_m[0], rows.speed_mps[0], row) == pytest.approx(rows.rate_mps[0], abs=0.6)


def test_an_odometer_helps_where_ranges_are_noisy() -> None:
    drawn = scene(epochs=80, noise_m=15.0)
    silent = replace(drawn.measured, range_rate_mps=np.full(len(drawn.measured.satellite), np.nan))
    known = np.full(80, np.nan)
    aids = Aids(np.full(80, 10.0), np.full(80, 0.1), np.zeros(80), known, known)
    speeds = [
        np.linalg.norm(solved(silent, aids, odometer=chosen).velocity_mps[30:], axis=1)
        for chosen in (False, True)
    ]
    assert np.std(speeds[1]) < np.std(speeds[0])
    assert np.mean(speeds[1]) == pytest.approx(10.0, abs=0.3)


def test_what_weak_signals_may_do_is_stated() -> None:
    strong, weak = (scene(epochs=30, cn0_dbhz=cn0) for cn0 in (50.0, 34.0))
    spreads = [np.trace(horizontal_m2(solved(s.measured), s.truth_m)[-1]) for s in (strong, weak)]
    assert spreads[1] > 4 * spreads[0]


def test_range_rates_can_be_left_out() -> None:
    drawn = scene(epochs=60, noise_m=5.0)
    errors = [
        np.hypot(*errors_m(solved(drawn.measured, doppler=d), drawn.truth_m)[20:, :2].T).mean()
        for d in (True, False)
    ]
    assert errors[0] < errors[1]
