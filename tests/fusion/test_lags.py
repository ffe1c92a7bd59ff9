"""Drives whose lag does not stand are followed where they drove, and then all is solved once."""

from __future__ import annotations

from collections.abc import Collection, Sequence, Set
from typing import Any

import numpy as np
import pytest

from fusion.lags import LAG_ROUNDS, LAG_SETTLED_S, OFF_AMONG_ALL, with_settled_lags
from fusion.types import Bools

EVERY = np.ones(10, bool)


class Solved:
    """Says in turn which drives were late: drive k passed the rows from k on, as many as ``rows`` says."""

    def __init__(self, late: Sequence[set[int]], rows: int = 2, *, remembered: int = 0) -> None:
        self.late, self.rows, self.remembered = [*late], rows, remembered
        self.solved: list[tuple[int, float | None]] = []
        """How many rows each time, and what counts as settled"""

    def adjusted(self, part: Bools) -> Any:
        self.solved.append((int(part.sum()), None))
        return len(self.solved)

    def made_anew(self, part: Bools, among: Collection[int] | None, settled_s: float) -> tuple[Any, Set[int]]:
        late = self.late.pop(0)
        assert among is None or late <= set(among)
        if self.remembered:
            self.remembered -= 1
            return None, late
        self.solved.append((int(part.sum()), settled_s))
        return len(self.solved), late

    def around(self, late: Set[int]) -> Bools:
        return np.isin(np.arange(len(EVERY)), [k + row for k in late for row in range(self.rows)])

    def result(self, altimeters: Set[int]) -> Any:
        return with_settled_lags(EVERY, altimeters, self.adjusted, self.made_anew, self.around)


def test_without_an_altimeter_all_is_solved_once() -> None:
    one = Solved([set()])
    assert one.result(set()) == 1
    assert one.solved == [(10, LAG_SETTLED_S)]


def test_late_ones_are_followed_where_they_drove() -> None:
    one = Solved([{0}, set(), set()])
    assert one.result({0, 5}) == 3, "the solution of all"
    assert one.solved == [(4, LAG_SETTLED_S), (2, LAG_SETTLED_S), (10, OFF_AMONG_ALL * LAG_SETTLED_S)]


def test_they_are_followed_again_where_all_contradict_it() -> None:
    one = Solved([set(), {5}, set(), set()])
    assert one.result({0, 5}) == 4
    assert [rows for rows, _ in one.solved] == [4, 10, 2, 10]


def test_drives_over_most_of_the_network_are_solved_with_all() -> None:
    one = Solved([{0}, {0}, set()], rows=6)
    assert one.result({0}) == 3
    assert one.solved == [(10, LAG_SETTLED_S)] * 3


@pytest.mark.parametrize("remembered", [1, 3])
def test_what_is_known_from_before_is_not_solved_again(remembered: int) -> None:
    """But for what is returned."""
    one = Solved([{0}, set(), set()], remembered=remembered)
    assert one.result({0, 5}) == len(one.solved)
    assert one.solved[-1][0] == 10
    assert len(one.solved) == {1: 2, 3: 1}[remembered]


def test_a_lag_that_never_stands_ends_all_the_same() -> None:
    one = Solved([{0}] * 2 * LAG_ROUNDS**2)
    assert one.result({0}) == len(one.solved)
    assert one.solved[-1] == (10, None), "with the factors that were made last"
    assert [rows for rows, _ in one.solved].count(10) == LAG_ROUNDS + 1
