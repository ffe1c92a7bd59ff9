"""The benchmark of pseudoranges: truth between epochs, and a table from a log with a truth of its own."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("fusion.gnss.measure", reason="measurements cannot be made of raw signals yet")

from fusion.gnss.measurements import Aids
from pseudorange import interpolated, show, with_height
from published.positioning.scoring import Scene
from town_drives import town_drive


def test_truth_is_interpolated_but_not_over_gaps() -> None:
    time = np.array([0.0, 1.0, 2.0, 6.0, 7.0])
    places = np.column_stack([time, 2 * time, np.zeros(5)])
    found = interpolated(np.array([-1.0, 0.0, 0.5, 2.0, 4.0, 6.0, 6.5, 8.0]), time, places)
    np.testing.assert_array_equal(np.isfinite(found[:, 0]), [0, 1, 1, 1, 0, 1, 1, 0])
    np.testing.assert_allclose(found[[1, 2, 3, 5, 6], 1], [0, 1, 4, 12, 13])


def test_heights_are_the_true_ones_with_noise() -> None:
    drive = town_drive(1, epochs=50)
    truth = drive.truth_m.copy()
    truth[:5] = np.nan
    scene = with_height(Scene(drive.measured, Aids.none(50), truth))
    assert np.isnan(scene.aids.height_m[:5]).all() and np.isnan(scene.aids.height_sigma_m[:5]).all()
    assert 1 < np.std(scene.aids.height_m[5:] - 20) < 6


def test_a_line_says_when_there_is_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    show("x", {"epochs": 0.0})
    assert "no position" in capsys.readouterr().out
