"""Chains of segments against walks that anyone can check."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.map.derived.chains import Chains, chains_of, places


def chains(segments: list[tuple[int, int, int]], ids: list[int] | None = None) -> list[list[int]]:
    """Ids chain by chain of segments (way, from, to)."""
    key, start, end = (np.array(column, np.int64) for column in zip(*segments, strict=True))
    number = np.array(ids if ids is not None else range(1, len(segments) + 1))
    found = chains_of(key, number, *_places(key, start, end))
    return [number[found.rows[a:b]].tolist() for a, b in itertools.pairwise(found.first.tolist())]


def _places(key: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    node = np.concatenate([start, end])
    place = places(np.tile(key, 2), node, np.column_stack([node, node]).astype(float))
    return place[: len(start)], place[len(start) :]


@pytest.mark.parametrize(
    ("segments", "expected"),
    [
        ([(7, 1, 2), (7, 2, 3), (7, 3, 4)], [[1, 2, 3]]),
        ([(7, 3, 4), (7, 1, 2), (7, 2, 3)], [[2, 3, 1]]),
        ([(7, 1, 2), (7, 2, 3), (7, 5, 6)], [[1, 2], [3]]),  # an extract's edge
        ([(7, 1, 2), (8, 2, 3)], [[1], [2]]),  # two ways
        ([(7, 2, 3), (7, 3, 1), (7, 1, 2)], [[1, 2, 3]]),  # closed
        ([(7, 1, 2), (7, 2, 3), (7, 3, 4), (7, 4, 2)], [[1, 2, 3, 4]]),  # a loop at its end
        ([(7, 2, 3), (7, 3, 2), (7, 1, 2), (7, 2, 4)], [[3, 1, 2, 4]]),  # there and back on the way
        ([(7, 1, 2), (7, 2, 1)], [[1, 2]]),
        (
            [(7, 1, 2), (7, 2, 3), (7, 3, 1), (7, 1, 4), (7, 4, 5), (7, 5, 1)],
            [[1, 2, 3, 4, 5, 6]],
        ),  # an eight
        ([(7, 1, 2), (7, 3, 2)], [[1], [2]]),  # no course at all
    ],
)
def test_segments_follow_each_other(segments: list[tuple[int, int, int]], expected: list[list[int]]) -> None:
    assert chains(segments) == expected


def test_a_way_goes_on_where_two_of_its_nodes_lie_in_one_place() -> None:
    key, node = np.full(4, 7), np.array([1, 3, 2, 4])
    xy = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [2.0, 0.0]])
    place = places(key, node, xy)
    found = chains_of(key[:2], np.array([5, 6]), place[:2], place[2:])
    assert found.first.tolist() == [0, 2]
    # Of another way it does not.
    other = places(np.array([7, 8, 7, 8]), node, xy)
    assert len(chains_of(np.array([7, 8]), np.array([5, 6]), other[:2], other[2:])) == 2
    # A node that was moved by a little is one place.
    moved = places(key, np.array([1, 2, 2, 4]), np.array([[0, 0], [1.1, 1.0], [1.0, 1.0], [2, 0]], float))
    assert moved[1] == moved[2]


def test_no_segments_make_no_chains() -> None:
    none = np.empty(0, np.int64)
    assert len(chains_of(none, none, none, none)) == 0
    assert len(places(none, none, np.empty((0, 2)))) == 0


WALKS = st.lists(st.lists(st.integers(1, 9), min_size=2, max_size=12), min_size=1, max_size=4)


@given(walks=WALKS, kept=st.lists(st.booleans(), min_size=48, max_size=48), seed=st.integers(0, 2**32 - 1))
def test_any_ways_become_as_few_trails_as_there_can_be(
    walks: list[list[int]], kept: list[bool], seed: int
) -> None:
    pairs = {
        (way, a, b): None for way, nodes in enumerate(walks) for a, b in itertools.pairwise(nodes) if a != b
    }
    segments = list(itertools.compress(pairs, kept))
    if not segments:
        return
    rng = np.random.default_rng(seed)
    ids = (rng.permutation(len(segments)) + 100).tolist()
    found = chains(segments, ids)
    order = rng.permutation(len(segments)).tolist()
    assert found == chains([segments[k] for k in order], [ids[k] for k in order])
    assert sorted(itertools.chain(*found)) == sorted(ids)
    of = dict(zip(ids, segments, strict=True))
    for chain in found:
        for one, following in itertools.pairwise(of[k] for k in chain):
            assert one[0] == following[0] and one[2] == following[1]
        if of[chain[0]][1] == of[chain[-1]][2]:
            nodes = [of[k][1] for k in chain]
            if len(set(nodes)) == len(nodes):
                assert chain[0] == min(chain)
    for way in {segment[0] for segment in segments}:
        mine = [segment[1:] for segment in segments if segment[0] == way]
        assert sum(of[chain[0]][0] == way for chain in found) == fewest(mine)


def fewest(edges: list[tuple[int, int]]) -> int:
    """Of each connected part: one for each segment more that leaves a node than comes to it; one of a closed part."""
    part = {node: node for edge in edges for node in edge}

    def root(node: int) -> int:
        while part[node] != node:
            node = part[node]
        return node

    for a, b in edges:
        part[root(a)] = root(b)
    surplus: dict[int, int] = {}
    for a, b in edges:
        surplus[a] = surplus.get(a, 0) + 1
        surplus[b] = surplus.get(b, 0) - 1
    more: dict[int, int] = {}
    for node, count in surplus.items():
        more[root(node)] = more.get(root(node), 0) + max(count, 0)
    return sum(max(count, 1) for count in more.values())


def test_chains_know_which_they_are() -> None:
    assert Chains(np.array([4, 2, 3]), np.array([0, 1, 3])).number().tolist() == [0, 1, 1]
