"""The stored map as handovers read it: chains of ways, files of roads and what is told where they are missing."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.core.db import Sessions
from app.exports.stored_source import StoredSource, chains
from app.map.segment import Segment
from app.roads import imports as roads
from fusion.errors import RoadsError

Mapped = Any  # of conftest, which cannot be imported
ONE = Segment(
    id=1, osm_way_id=7, from_node=1, to_node=2, length_m=50.0, highway="track", name=None, oneway=0, bridge=False,
    tunnel=False, slope_percent=None, slope_sigma_percent=None, drives=0, observations=0, dem_slope_percent=None,
    updated_at=None, coordinates=((8.0, 49.0), (8.1, 49.1)),
)  # fmt: skip


def numbers(way: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    segments = [replace(ONE, id=k + 1, from_node=a, to_node=b) for k, (a, b) in enumerate(way)]
    return [[(s.from_node, s.to_node) for s in chain] for chain in chains(segments)]


def test_chains_go_along_the_way() -> None:
    assert numbers([(5, 2), (9, 5), (2, 7)]) == [[(9, 5), (5, 2), (2, 7)]]
    assert numbers([(1, 2), (4, 5)]) == [[(1, 2)], [(4, 5)]]
    ring = numbers([(3, 1), (1, 2), (2, 3)])
    assert ring == [[(3, 1), (1, 2), (2, 3)]]
    # A loop with a handle: at its own node nothing says how the way goes on.
    assert numbers([(1, 2), (2, 3), (3, 4), (4, 2)]) == [[(1, 2)], [(2, 3), (3, 4), (4, 2)]]
    assert numbers([]) == []


@given(
    st.sets(st.tuples(st.integers(0, 8), st.integers(0, 8)).filter(lambda ab: ab[0] != ab[1]), max_size=20)
)
def test_chains_hold_each_segment_once_and_hang_together(way: set[tuple[int, int]]) -> None:
    found = numbers(sorted(way))
    assert sorted(s for chain in found for s in chain) == sorted(way)
    assert all(a[1] == b[0] for chain in found for a, b in pairwise(chain))


def test_in_way_order_is_all_segments_by_way(mapped: Mapped) -> None:
    with mapped.source() as source:
        for filters in ({}, {"driven": True}):
            whole = sorted(s.id or 0 for s in source.segments(**filters))
            in_order = list(source.in_way_order(**filters))
            assert sorted(s.id or 0 for chain in in_order for s in chain) == whole
            assert all(len({s.osm_way_id for s in chain}) == 1 for chain in in_order)
            ways = [chain[0].osm_way_id for chain in in_order]
            assert ways == sorted(ways)
        assert max(map(len, in_order)) > 3


def test_roads_without_a_file_are_told(sessions: Sessions, chain: Any, tmp_path: Any) -> None:
    with sessions() as session, pytest.raises(RoadsError, match="There are no roads yet"):
        StoredSource(session, tmp_path).road_files()
    with sessions.begin() as session:
        roads.replace_roads(session, chain(), "chain.osm", "0" * 64)
    with sessions() as session, pytest.raises(RoadsError, match="Of region 'roads' no file is kept"):
        StoredSource(session, tmp_path).road_files()
