"""What a soak finds wrong, where something is."""

from __future__ import annotations

import pytest

from soak.judging import LACKING_SIGMAS, Far, Slope, far

ONE, TWO, GAP = (1, 2, 3), (1, 3, 4), (1, 4, 5)
SCRATCH = {ONE: Slope(2.0, 0.5, 2), TWO: Slope(-1.0, 0.2, 1), GAP: Slope(0.0, 3.0, 0)}


def test_the_same_is_not_far() -> None:
    assert far(SCRATCH, SCRATCH, SCRATCH) == Far(3, 0.0, 0.0, 0.0, 0)


def test_gaps_may_wait_until_all_is_settled_and_driven_segments_may_not() -> None:
    without_gap = {ONE: SCRATCH[ONE], TWO: SCRATCH[TWO]}
    assert far(without_gap, SCRATCH, SCRATCH) == Far(3, 0.0, 0.0, 0.0, 0)
    without_driven = {ONE: SCRATCH[ONE], GAP: SCRATCH[GAP]}
    assert far(without_driven, SCRATCH, SCRATCH).at_once_all_sigmas == LACKING_SIGMAS


def test_distances_are_in_sigmas_of_the_computation_from_scratch() -> None:
    off = SCRATCH | {ONE: Slope(2.1, 5.0, 2)}
    found = far(off, off, SCRATCH)
    assert found.at_once_all_sigmas == pytest.approx(0.2)
    assert found.at_once_sigmas == pytest.approx(0.198)  # 99 % of the way to the second of two
    assert found.settled_sigmas == pytest.approx(0.2)
    assert found.other_segments == 0


def test_a_segment_of_one_side_alone_and_another_number_of_drives_are_told() -> None:
    other = {ONE: Slope(2.0, 0.5, 3), TWO: SCRATCH[TWO], (9, 9, 8): Slope(0.0, 1.0, 1)}
    assert far(SCRATCH, other, SCRATCH).other_segments == 3
