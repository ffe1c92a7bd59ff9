"""A study of residuals that are the true errors: states, satellites, laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.gnss.measurements import Measurements, Solution
from fusion.gnss.reception import LOS, NLOS
from fusion.published.canyon.drive import CanyonDrive
from fusion.published.positioning.study import PAIRS, WINDOWS, reception_states, study
from published.positioning.rouen import rouen


@pytest.fixture(scope="module")
def drive() -> CanyonDrive:
    return rouen(1)


@pytest.fixture(scope="module")
def run(drive: CanyonDrive) -> tuple[Measurements, Solution]:
    m, rows = len(drive.ride), len(drive.state)
    nan = np.full((m, 3), np.nan)
    covariance = np.full((m, 6, 6), np.nan)
    solution = Solution(
        drive.ride.position_m,
        nan,
        covariance,
        nan[:, 0],
        np.full(rows, np.nan),
        drive.error_m,
        np.zeros(m, bool),
    )
    return drive.measurements(), solution


def test_the_solver_says_the_state_or_else_cn0(
    run: tuple[Measurements, Solution], drive: CanyonDrive
) -> None:
    measured, solution = run
    np.testing.assert_array_equal(reception_states(measured, solution), drive.state)
    nlos = np.where(np.arange(len(drive.state)) % 2 == 0, 0.9, np.nan)
    said = reception_states(measured, replace(solution, nlos=nlos))
    assert np.all(said[::2] == NLOS)
    np.testing.assert_array_equal(said[1::2], drive.state[1::2])
    assert {LOS, NLOS} == set(drive.state.tolist())


def test_a_study_tells_reflections_from_noise(run: tuple[Measurements, Solution], drive: CanyonDrive) -> None:
    measured, solution = run
    found = study(measured, solution)
    assert [row.name for row in found.satellites] == list(measured.names)
    assert sum(row.count for row in found.satellites) == len(drive.state)
    direct, reflected = found.states
    assert abs(direct.mean_m) < 0.1
    assert abs(direct.spread_m - 1.0) < 0.1
    assert reflected.mean_m == pytest.approx(drive.error_m[drive.reflected].mean())
    assert np.isnan(direct.nlos)
    ks = {test.law: test.ks for test in found.laws}
    assert ks["3 normals"] < ks["normal"] < ks["rayleigh"]
    assert len(found.wins) == len(PAIRS) * len(WINDOWS)
    assert all(win.share > 0.5 for win in found.wins if win.law == "2 normals")


def test_a_solution_without_residuals_has_no_study(run: tuple[Measurements, Solution]) -> None:
    measured, solution = run
    none = replace(solution, residual_m=np.full(len(solution.residual_m), np.nan))
    found = study(measured, none)
    assert found.satellites == found.states == found.laws == []
    assert all(np.isnan(win.share) for win in found.wins)
