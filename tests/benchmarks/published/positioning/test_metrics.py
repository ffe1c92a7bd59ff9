"""Metrics on series made by hand, and coverage of errors drawn from their own covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.frames import local_axes
from fusion.gnss.earth import ecef
from fusion.gnss.measurements import Solution
from published.positioning.metrics import (
    coverage,
    errors_enu_m,
    position_metrics,
    up_and_down_s,
)

HERE = ecef(np.array([13.4]), np.array([52.5]), np.array([80.0]))


def a_solution(enu_m: np.ndarray, covariance: np.ndarray | None = None) -> tuple[Solution, np.ndarray]:
    m = len(enu_m)
    truth = np.repeat(HERE, m, axis=0)
    places = truth + np.einsum("nji,nj->ni", local_axes(truth), enu_m)
    nan = np.full(m, np.nan)
    if covariance is None:
        covariance = np.full((m, 6, 6), np.nan)
    return Solution(places, np.full((m, 3), np.nan), covariance, nan, nan, nan, np.zeros(m, bool)), truth


def test_a_series_by_hand() -> None:
    enu = np.array([[0, 1, 0], [0, 4.5, 0], [0, 0, 6], [np.nan] * 3, [6, 8, 0], [0, 2, 0], [2, 0, 1]], float)
    solution, truth = a_solution(enu)
    found = position_metrics(np.arange(7.0), solution, truth)
    assert (found.epochs, found.solved) == (7, 6)
    assert found.mean_2d_m == pytest.approx((1 + 4.5 + 0 + 10 + 2 + 2) / 6)
    assert found.median_3d_m == pytest.approx((5**0.5 + 4.5) / 2)
    assert found.mean_3d_m == pytest.approx((1 + 4.5 + 6 + 10 + 2 + 5**0.5) / 6)
    assert found.within_2d == pytest.approx((4 / 7, 5 / 7, 6 / 7))
    assert found.within_3d == pytest.approx((3 / 7, 4 / 7, 6 / 7))
    assert (found.mut_s, found.mdt_s, found.mtbf_s) == (2.0, 3.0, 5.0)
    assert np.isnan(found.coverage_2d)


def test_epochs_without_truth_are_left_out() -> None:
    solution, truth = a_solution(np.array([[1.0, 0, 0], [50.0, 0, 0]]))
    truth[1] = np.nan
    found = position_metrics(np.arange(2.0), solution, truth)
    assert found.epochs == 1
    assert found.mean_2d_m == pytest.approx(1.0)
    with pytest.raises(ValueError, match="no epoch has a true position"):
        position_metrics(np.arange(2.0), solution, np.full((2, 3), np.nan))


def test_times_up_and_down_by_hand() -> None:
    up = np.array([1, 1, 0, 1, 0, 0, 0, 1, 1, 1], bool)
    assert up_and_down_s(np.arange(10.0), up) == pytest.approx(((2 + 1 + 3) / 3, (1 + 3) / 2))
    assert up_and_down_s(0.2 * np.arange(10), up) == pytest.approx((0.4, 0.4))
    always, never = up_and_down_s(np.arange(3.0), np.ones(3, bool))
    assert always == 3.0
    assert np.isnan(never)


@given(st.lists(st.booleans(), min_size=2, max_size=60))
def test_times_up_and_down_fill_the_drive(up: list[bool]) -> None:
    series = np.array(up)
    mut, mdt = np.nan_to_num(up_and_down_s(np.arange(len(up), dtype=float), series))
    changes = np.count_nonzero(np.diff(series.astype(int)))
    runs_up = (changes + 1 + int(series[0])) // 2
    assert mut * runs_up + mdt * (changes + 1 - runs_up) == pytest.approx(len(up))


def test_ellipses_of_the_true_covariance_cover_95_percent() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3)) * np.array([[3.0], [1.0], [6.0]])
    local = root @ root.T
    enu = rng.multivariate_normal(np.zeros(3), local, 4000)
    truth = np.repeat(HERE, 4000, axis=0)
    axes = local_axes(HERE)[0]
    covariance = np.repeat((axes.T @ local @ axes)[None], 4000, axis=0)
    flat, space = coverage(enu, truth, covariance)
    assert abs(flat - 0.95) < 0.012
    assert abs(space - 0.95) < 0.012
    flat, _ = coverage(enu, truth, covariance / 9)
    assert flat < 0.4


def test_a_covariance_that_is_none_covers_nothing() -> None:
    truth = np.repeat(HERE, 3, axis=0)
    covariance = np.stack([-np.eye(3), np.full((3, 3), np.nan), 100 * np.eye(3)])
    flat, space = coverage(np.zeros((3, 3)), truth, covariance)
    assert flat == space == 0.5


def test_errors_are_east_north_up() -> None:
    enu = np.array([[3.0, -4.0, 12.0], [0.1, 0.2, -0.3]])
    solution, truth = a_solution(enu)
    np.testing.assert_allclose(errors_enu_m(solution.position_m, truth), enu, atol=1e-6)
