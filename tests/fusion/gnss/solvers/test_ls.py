"""Least squares against scipy's, its covariance, and systems with too few satellites."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from fusion.gnss.measurements import Aids, Measurements, Solution
from fusion.gnss.solvers.ls import EVEN_SIGMA_M, LeastSquares, LeastSquaresOptions
from fusion.gnss.solvers.state import cn0_variance
from fusion.types import no_progress
from gnss_scene import errors_m, keep_rows, scene


def solved(measured: Measurements, weighted: bool) -> Solution:
    return LeastSquares(weighted).solve(
        measured, Aids.none(len(measured)), LeastSquaresOptions(), 0, no_progress
    )


@settings(max_examples=15)
@given(st.integers(0, 1000), st.integers(6, 14), st.integers(1, 3), st.booleans())
def test_it_is_scipy_s(seed: int, satellites: int, groups: int, weighted: bool) -> None:
    measured = scene(epochs=1, satellites=satellites + groups, groups=groups, noise_m=8.0, seed=seed).measured
    variance = (
        cn0_variance(measured.cn0_dbhz, measured.elevation_rad)
        if weighted
        else np.full(len(measured.group), EVEN_SIGMA_M**2)
    )

    def misfits(x: np.ndarray) -> np.ndarray:
        distance = np.linalg.norm(measured.satellite_m - measured.rough_m - x[:3], axis=1)
        return (measured.pseudorange_m - distance - x[3 + measured.group]) / np.sqrt(variance)

    def slopes(x: np.ndarray) -> np.ndarray:
        sight = measured.satellite_m - measured.rough_m - x[:3]
        clocks = -np.eye(groups)[measured.group]
        rows = np.column_stack([sight / np.linalg.norm(sight, axis=1, keepdims=True), clocks])
        return np.asarray(rows / np.sqrt(variance)[:, None])

    best = least_squares(
        misfits, np.zeros(3 + groups), slopes, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    solution = solved(measured, weighted)
    assert solution.position_m[0] - measured.rough_m == pytest.approx(best.x[:3], abs=1e-3)
    assert solution.clock_m[0] == pytest.approx(best.x[3], abs=1e-3)
    assert solution.residual_m / np.sqrt(variance) == pytest.approx(best.fun, abs=1e-3)


def test_a_single_satellite_of_another_system_is_left_out() -> None:
    drawn = scene(epochs=1, satellites=12, groups=2)
    single = keep_rows(drawn.measured, (drawn.measured.group == 0) | (drawn.measured.satellite == 1))
    alone = keep_rows(drawn.measured, drawn.measured.group == 0)
    assert solved(single, True).position_m == pytest.approx(solved(alone, True).position_m, abs=1e-6)
    assert np.isnan(solved(single, True).residual_m[single.group == 1]).all()


def test_without_the_reference_system_there_is_a_position_and_no_clock() -> None:
    drawn = scene(epochs=1, satellites=16, groups=2)
    other = keep_rows(drawn.measured, drawn.measured.group == 1)
    solution = solved(other, True)
    assert np.abs(errors_m(solution, drawn.truth_m)).max() < 10.0


def test_a_misfit_makes_the_covariance_larger() -> None:
    calm, rough = (solved(scene(epochs=1, noise_m=noise).measured, True) for noise in (1.0, 60.0))
    assert np.trace(rough.covariance[0, :3, :3]) > 4 * np.trace(calm.covariance[0, :3, :3])
