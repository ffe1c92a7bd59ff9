"""Roads put together across ways."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.map.derived.chains import courses, together_m
from app.map.derived.drawing import ABOVE, BELOW, DRAWN_LEVELS, LEVELS, children, parent, rank, tile_of

Road = tuple[int, int, int, bool]
"""From place to place, of a kind, one-way."""


def lines(roads: list[Road], ids: list[int] | None = None) -> list[list[int]]:
    """Numbers of roads from 1 on by line, negative where one is gone through backwards."""
    start, end, kind = (np.array([road[k] for road in roads], np.int64) for k in range(3))
    number = np.array(ids or range(1, len(roads) + 1))
    found = courses(number, start, end, kind, np.array([road[3] for road in roads]))
    return [
        [int(number[row]) * (-1 if turned else 1) for row, turned in zip(*course, strict=True)]
        for course in found
    ]


@pytest.mark.parametrize(
    ("roads", "expected"),
    [
        ([(1, 2, 0, False), (2, 3, 0, False)], [[1, 2]]),
        ([(1, 2, 0, False), (3, 2, 0, False)], [[1, -2]]),  # drawn towards each other
        ([(2, 1, 0, False), (2, 3, 0, False)], [[-2, 1]]),
        ([(1, 2, 0, False), (2, 3, 1, False)], [[1], [2]]),  # another class
        ([(1, 2, 0, True), (2, 3, 0, False)], [[1], [2]]),
        ([(1, 2, 0, True), (2, 3, 0, True)], [[1, 2]]),
        ([(1, 2, 0, True), (3, 2, 0, True)], [[1], [2]]),  # two lanes that meet
        ([(1, 2, 0, False), (2, 3, 0, False), (2, 4, 1, False)], [[1], [2], [3]]),  # a junction
        ([(1, 2, 0, False), (3, 2, 0, False), (3, 1, 0, False)], [[1, -2, 3]]),  # a ring
        ([(1, 1, 0, False), (1, 2, 0, False)], [[1], [2]]),
        ([(1, 2, 0, False), (2, 1, 0, False)], [[1, 2]]),
    ],
)
def test_two_of_a_kind_go_on_where_no_third_is(roads: list[Road], expected: list[list[int]]) -> None:
    assert lines(roads) == expected


ROADS = st.lists(
    st.tuples(st.integers(1, 8), st.integers(1, 8), st.integers(0, 1), st.booleans()), min_size=1, max_size=14
)


@given(roads=ROADS, seed=st.integers(0, 2**32 - 1))
def test_any_roads_become_the_longest_lines_that_there_are(roads: list[Road], seed: int) -> None:
    order = np.random.default_rng(seed).permutation(len(roads)).tolist()
    found = lines(roads)
    assert found == lines([roads[k] for k in order], [k + 1 for k in order])
    assert sorted(abs(k) for line in found for k in line) == list(range(1, len(roads) + 1))
    at = [end for road in roads for end in road[:2]]

    def ends(k: int) -> tuple[int, int]:
        a, b = roads[abs(k) - 1][:2]
        return (a, b) if k > 0 else (b, a)

    joined = 0
    for line in found:
        assert min(line, key=abs) > 0
        for one, following in itertools.pairwise(line):
            assert ends(one)[1] == ends(following)[0]
            assert at.count(ends(one)[1]) == 2
            assert roads[abs(one) - 1][2:] == roads[abs(following) - 1][2:]
            assert one > 0 < following or not roads[abs(one) - 1][3]
            joined += 1
        joined += len(line) > 1 and goes_on(roads, line[-1], line[0], at)
    # And wherever two may go on, they do.
    pairs = [(a, b) for a in range(1, len(roads) + 1) for b in range(a + 1, len(roads) + 1)]
    possible = sum(
        goes_on(roads, one, other, at) for a, b in pairs for one, other in ((a, b), (b, a), (a, -b), (-a, b))
    )
    assert joined == possible


def goes_on(roads: list[Road], one: int, other: int, at: list[int]) -> bool:
    """Whether ``other`` may come after ``one``; a way round that is the same with both turned is asked for once."""
    (a, b, *mine), (c, d, *its) = roads[abs(one) - 1], roads[abs(other) - 1]
    end, begin = (b if one > 0 else a), (c if other > 0 else d)
    straight = one > 0 < other or not mine[1]
    return abs(one) != abs(other) and end == begin and at.count(end) == 2 and mine == its and straight


def test_what_hangs_together_is_measured_together() -> None:
    start, end = np.array([1, 2, 8]), np.array([2, 3, 9])
    assert together_m(start, end, np.array([5.0, 6.0, 7.0])).tolist() == [11.0, 11.0, 7.0]
    assert len(together_m(start[:0], end[:0], np.empty(0))) == 0


@given(st.integers(0, 2**28 - 1))
def test_tiles_lie_in_each_other(cell: int) -> None:
    assert tile_of(cell, 12) == cell
    for level in DRAWN_LEVELS[:-1]:
        tile = tile_of(cell, level)
        above = parent(level, tile)
        assert above == tile_of(cell, level - 2)
        assert tile in children(level - 2, above)
    assert all(BELOW[above] == level for level, above in ABOVE.items())


def test_classes_are_ranked() -> None:
    ranks = [
        rank(name)
        for name in ("motorway", "trunk_link", "primary", "tertiary", "residential", "track", "new")
    ]
    assert ranks == sorted(ranks) == [0, 1, 2, 4, 6, 9, 10]
    assert LEVELS[10].chosen("tertiary_link")
    assert not LEVELS[10].chosen("unclassified")
    assert not LEVELS[8].chosen("primary_link")
    assert not LEVELS[6].chosen("primary")
