"""Estimators of the literature: their weights, and that each follows a drive without reflections."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.gnss.measurements import Aids
from fusion.gnss.solvers.one_sided import OneSided, OneSidedOptions
from fusion.types import no_progress
from published.positioning.robust import ESTIMATORS, single_points, track
from published.positioning.scoring import Scene, figures
from town_drives import TownDrive, town_drive


@pytest.fixture(scope="module")
def drive() -> TownDrive:
    return town_drive(4, epochs=60, reflected=0.0)


@pytest.mark.parametrize("name", [name for name, weigh in ESTIMATORS.items() if weigh is not None])
def test_weights_are_one_in_the_middle_and_fall(name: str) -> None:
    weigh = ESTIMATORS[name]
    assert weigh is not None
    u = np.linspace(0, 50, 200)
    found = weigh(u)
    assert found[0] == pytest.approx(1.0) and np.all(found > 0)
    assert np.all(np.diff(found) <= 1e-12)
    np.testing.assert_allclose(weigh(-u), found)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("smoothed", [False, True])
def test_a_clean_drive_is_followed(drive: TownDrive, name: str, smoothed: bool) -> None:
    places, spread = track(drive.measured, Aids.none(60), name, smoothed, odometer=False)
    off = np.linalg.norm(places - drive.truth_m, axis=1)
    assert np.median(off) < 10
    assert np.all(np.isfinite(spread))


def test_single_points_are_least_squares(drive: TownDrive) -> None:
    off = np.linalg.norm(single_points(drive.measured) - drive.truth_m, axis=1)
    assert np.median(off) < 10


def test_figures_are_those_of_a_known_error(drive: TownDrive) -> None:

    solution = OneSided().solve(drive.measured, Aids.none(60), OneSidedOptions(), 0, no_progress)
    truth = solution.position_m.copy()
    truth[10:20] = np.nan
    found = figures(Scene(drive.measured, Aids.none(60), truth), solution)
    assert found["epochs"] == 50 and found["missing"] == 0
    assert found["mean_m"] == pytest.approx(0, abs=1e-9)
    assert found["within_95"] == 1.0
