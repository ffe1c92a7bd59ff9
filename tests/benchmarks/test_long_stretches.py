"""Rides by number and sets of them, and what a share within sigma counts."""

from __future__ import annotations

import numpy as np
import pytest

import long_stretches
from accuracy.stretches import Stretch


def test_rides_are_named_by_ranges() -> None:
    assert long_stretches.parse_ranges("1-3,7,5-6") == [1, 2, 3, 5, 6, 7]
    assert long_stretches.ranges([1, 2, 3, 5, 6, 9]) == "1-3,5-6,9"
    assert long_stretches.parse_ranges(long_stretches.ranges([4])) == [4]


def test_sets_of_rides_are_the_same_in_every_run() -> None:
    rides = list(range(1, 17))
    once = long_stretches.subsets(rides, 5, 6)
    assert once == long_stretches.subsets(rides, 5, 6)
    assert long_stretches.subsets(rides, 7, 6)[:5] == once
    assert all(len(set(chosen)) == 6 and chosen == sorted(chosen) for chosen in once)
    assert len({tuple(chosen) for chosen in once}) > 1


def test_errors_over_sigmas_of_known_grades() -> None:
    key, other = (1, 1, 2), (1, 2, 3)
    known = Stretch(500.0, 10.0, (key,), np.array([1.0]), np.array([500.0]))
    unknown = Stretch(500.0, 10.0, (other,), np.array([1.0]), np.array([500.0]))
    z = long_stretches.grade_errors([known, unknown], {key: (3.5, 0.5)})
    assert z.tolist() == [3.0]
    row = long_stretches.coverage(np.array([3.0, 0.0, -1.0, 1.9]))
    assert row == {"graded": 4, "within_95": 0.75, "z_rms": pytest.approx(np.sqrt((9 + 1 + 3.61) / 4))}
    assert long_stretches.coverage(np.empty(0))["within_95"] is None
