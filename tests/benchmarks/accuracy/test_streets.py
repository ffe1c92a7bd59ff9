"""Made streets: their heights and slopes are those that were asked for, and a drive runs from end to end."""

from __future__ import annotations

import numpy as np
import pytest

from accuracy.streets import drive_along, make_hills, make_street, truth_of


def test_a_street_has_the_heights_and_slopes_asked_for() -> None:
    street = make_street(np.array([0.0, 50.0, 80.0]), np.array([10.0, 12.0, 12.0]), np.full(3, 0.04))
    assert street.roads.length_m == pytest.approx([50.0, 30.0], rel=1e-4)
    assert street.true_slope_percent[0] == pytest.approx(4.0)
    true = truth_of(street)
    assert [(t.driven_m, t.length_m) for t in true.values()] == [(50.0, 50.0), (30.0, 30.0)]
    assert [key[0] for key in true] == [1, 1]


def test_a_street_of_hills_has_equal_segments() -> None:
    street = make_hills(750.0, 10.0)
    assert len(street.roads) == 75
    assert street.roads.length_m == pytest.approx(np.full(75, 10.0), rel=1e-3)
    assert 8 < np.abs(street.true_slope_percent).max() < 10
    assert np.array_equal(street.roads.from_node, np.sort(street.roads.from_node))


def test_a_drive_runs_from_end_to_end() -> None:
    street = make_hills(300.0, 50.0)
    drive = drive_along(street, 1)
    assert drive.truth.x_m[0] < 5
    assert drive.truth.x_m[-1] > 290
    assert np.array_equal(np.unique(drive.truth.segment), np.arange(6))
    other = drive_along(street, 2)
    assert len(other.time_s) != len(drive.time_s) or not np.allclose(other.truth.x_m, drive.truth.x_m)
