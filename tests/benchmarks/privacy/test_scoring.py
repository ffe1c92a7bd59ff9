"""Scores of the privacy attack: what counts as right, and that each truth counts once."""

from __future__ import annotations

import numpy as np
import pytest

from privacy.scoring import HOME_M, difference, f1_scores, right_drives, right_homes, share

LENGTH_M = np.array([100.0, 100.0, 100.0, 300.0])


def rows(*numbers: int) -> np.ndarray:
    return np.array(numbers)


def test_f1_counts_metres() -> None:
    scores = f1_scores([rows(0, 1)], [rows(1, 2), rows(1, 3), rows(2)], LENGTH_M).toarray()[0]
    assert scores == pytest.approx([0.5, 200 / 600, 0.0])


def test_a_name_counts_for_one_drive_and_a_drive_for_one_name() -> None:
    same = rows(0, 1, 2)
    assert right_drives([same], [same, same], LENGTH_M).sum() == 1
    assert right_drives([same, same], [same], LENGTH_M).tolist() == [True]
    assert right_drives([rows(0)], [rows(0, 1, 2)], LENGTH_M).tolist() == [False]


def test_names_are_matched_so_that_as_many_as_can_be_are_right() -> None:
    long, short = rows(0, 1, 2), rows(0, 1)
    assert right_drives([long, short], [short, long], LENGTH_M).all()


def test_nothing_named_is_nothing_right() -> None:
    assert not right_drives([], [rows(0)], LENGTH_M).any()
    assert not right_homes(np.empty((0, 2)), np.zeros((2, 2))).any()


def test_a_home_is_right_within_reach_and_once() -> None:
    homes = np.array([[0.0, 0.0], [10.0, 0.0], [1000.0, 0.0]])
    named = np.array([[5.0, 0.0], [1000.0, HOME_M - 1.0]])
    right = right_homes(named, homes)
    assert right.sum() == 2
    assert right[2]
    assert not right_homes(np.array([[0.0, HOME_M + 1.0]]), homes[:1]).any()


def test_intervals_are_of_owners() -> None:
    rng = np.random.default_rng(1)
    owner = np.repeat(np.arange(50), 4)
    right = owner % 2 == 0
    by_owner, by_drive = share(right, owner, rng), share(right, np.arange(200), rng)
    assert by_owner.value == by_drive.value == 0.5
    assert by_owner.low < 0.5 < by_owner.high
    # Four drives of one owner are right together: so much less is known.
    assert by_owner.high - by_owner.low > 1.5 * (by_drive.high - by_drive.low)


def test_a_difference_is_of_the_same_owners() -> None:
    rng = np.random.default_rng(1)
    right = rng.random(300) < 0.3
    none = difference(right, right, np.arange(300), rng)
    assert (none.value, none.low, none.high) == (0.0, 0.0, 0.0)
    assert difference(np.ones(300, bool), right, np.arange(300), rng).low > 0
