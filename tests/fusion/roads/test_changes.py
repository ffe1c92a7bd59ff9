"""What became of segments between two states of a map."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.roads.changes import Change, RoadChanges, compare
from fusion.roads.table import RoadTable

Way = tuple[int, Sequence[int]]
METRE = 1 / 111_132.0

STAYS = (Change.KEPT, Change.MOVED, Change.RENUMBERED, Change.REVERSED, Change.FAR)
"""What a row of the file takes the place of."""


def table(ways: Sequence[Way], shifted: dict[int, float] | None = None) -> RoadTable:
    """Ways of nodes; node k lies k * 100 m north of 49 degrees, and so far east as ``shifted`` says (m)."""
    rows = [(way, a, b) for way, nodes in ways for a, b in pairwise(nodes)]
    way, a, b = (np.array(column) for column in zip(*rows, strict=True)) if rows else (np.empty(0, int),) * 3
    east = {node: m * METRE / np.cos(np.radians(49)) for node, m in (shifted or {}).items()}

    def lon(nodes: Any) -> Any:
        return [8.0 + east.get(int(node), 0.0) for node in nodes]

    n = len(rows)
    return RoadTable.from_columns(
        osm_way_id=way, from_node=a, to_node=b, lon0_deg=lon(a), lat0_deg=49 + 100 * METRE * a, lon1_deg=lon(b),
        lat1_deg=49 + 100 * METRE * b, oneway=np.zeros(n), bridge=np.zeros(n, bool), tunnel=np.zeros(n, bool),
        layer=np.zeros(n), highway=["residential"] * n, name=[None] * n,
    )  # fmt: skip


def became(
    stored: RoadTable, file: RoadTable, *, member: bool = True, others: bool = False
) -> tuple[dict[tuple[int, int, int], tuple[Change, tuple[int, int, int] | None]], RoadChanges]:
    """What became of each stored segment, and the segment of the file that it is now."""
    n = len(stored)
    found = compare(stored, np.full(n, member), np.full(n, others), file, 2.0)

    def key(of: RoadTable, row: int) -> tuple[int, int, int]:
        return int(of.osm_way_id[row]), int(of.from_node[row]), int(of.to_node[row])

    said = {
        key(stored, k): (Change(kind), key(file, row) if row >= 0 else None)
        for k, kind, row in zip(found.stored.tolist(), found.change.tolist(), found.row.tolist(), strict=True)
    }
    return said, found


def kinds(stored: RoadTable, file: RoadTable, **more: bool) -> list[str]:
    """By way and nodes."""
    return [change.name for _, (change, _) in sorted(became(stored, file, **more)[0].items())]


ROAD = table([(1, (1, 2, 3, 4))])


def test_a_node_that_moves_a_little_moves_two_segments_and_one_that_moves_far_lets_them_be_elsewhere() -> (
    None
):
    assert kinds(ROAD, ROAD) == ["KEPT"] * 3
    assert kinds(ROAD, table([(1, (1, 2, 3, 4))], {2: 1.9})) == ["MOVED", "MOVED", "KEPT"]
    assert kinds(ROAD, table([(1, (1, 2, 3, 4))], {2: 2.1})) == ["FAR", "FAR", "KEPT"]


def test_ways_that_are_renumbered_split_joined_or_turned_round_are_the_same_road() -> None:
    assert kinds(ROAD, table([(9, (1, 2, 3, 4))])) == ["RENUMBERED"] * 3
    said, found = became(ROAD, table([(1, (1, 2, 3)), (9, (3, 4))], {4: 1.0}))
    assert said[1, 3, 4] == (Change.RENUMBERED, (9, 3, 4))
    assert said[1, 2, 3] == (Change.KEPT, (1, 2, 3))
    assert not len(found.added)
    said, _ = became(ROAD, table([(1, (4, 3, 2, 1))]))
    assert {change for change, _ in said.values()} == {Change.REVERSED}
    assert said[1, 2, 3][1] == (1, 3, 2)
    assert kinds(ROAD, table([(9, (4, 3, 2, 1))], {3: 5.0})) == ["REVERSED", "DROPPED", "DROPPED"]


def test_a_node_put_in_or_taken_out_is_told_from_a_road_that_is_gone() -> None:
    inside = table([(1, (1, 2, 7, 3, 4))])
    said, found = became(ROAD, inside)
    assert [change.name for _, (change, _) in sorted(said.items())] == ["KEPT", "SPLIT", "KEPT"]
    assert len(found.added) == 2
    assert kinds(inside, ROAD) == ["KEPT", "MERGED", "KEPT", "MERGED"]
    assert kinds(ROAD, table([(1, (1, 2))])) == ["KEPT", "DROPPED", "DROPPED"]


def test_what_other_regions_have_too_is_left_to_them() -> None:
    assert kinds(ROAD, table([]), others=True) == ["RELEASED"] * 3
    assert kinds(ROAD, table([]), member=False, others=True) == []


def test_of_a_way_that_two_regions_share_the_newest_file_counts_as_far_as_it_goes() -> None:
    """It has lost node 3 and ends at 4, which the other file goes beyond."""
    stored = table([(1, (1, 2, 3, 4, 5, 6))])
    said, found = became(stored, table([(1, (1, 2, 4))]), member=False, others=True)
    assert {key: change.name for key, (change, _) in said.items()} == {
        (1, 1, 2): "KEPT", (1, 2, 3): "MERGED", (1, 3, 4): "MERGED",
    }  # fmt: skip
    assert len(found.added) == 1


def test_two_ways_over_the_same_nodes_stay_two() -> None:
    both = table([(1, (1, 2)), (2, (1, 2)), (3, (2, 1))])
    assert kinds(both, both) == ["KEPT"] * 3
    assert kinds(both, table([(1, (1, 2)), (3, (2, 1))])) == ["KEPT", "DROPPED", "KEPT"]


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_the_date_line_is_no_edge(shift: float) -> None:
    def across(lon: float) -> RoadTable:
        columns: dict[str, Any] = {name: getattr(ROAD, name)[:1] for name in RoadTable.columns()}
        return RoadTable.from_columns(**(columns | {"lon0_deg": [lon], "lon1_deg": [-179.99]}))

    assert kinds(across(180.0), across(-180.0 + shift * METRE)) == ["MOVED"]


ways = st.lists(
    st.tuples(st.integers(1, 4), st.lists(st.integers(1, 9), min_size=2, max_size=6, unique=True)),
    max_size=5, unique_by=lambda way: way[0],
)  # fmt: skip
moves = st.dictionaries(st.integers(1, 9), st.sampled_from([0.5, 1.5, 8.0]), max_size=4)


@given(before=ways, after=ways, moved=moves, member=st.booleans(), others=st.booleans())
def test_every_segment_becomes_one_thing_and_every_row_is_taken_once(
    before: list[Way], after: list[Way], moved: dict[int, float], member: bool, others: bool
) -> None:
    stored, file = table(before), table(after, moved)
    said, found = became(stored, file, member=member, others=others)
    taken = found.row[found.row >= 0]
    assert sorted([*taken.tolist(), *found.added.tolist()]) == list(range(len(file)))
    assert len(set(found.stored.tolist())) == len(found.stored)
    if member:
        assert len(found.stored) == len(stored)
    for change, key in said.values():
        assert (key is not None) == (
            change in (Change.KEPT, Change.MOVED, Change.RENUMBERED, Change.REVERSED, Change.FAR)
        )
        assert (change is Change.RELEASED) <= (member and others)


@given(one=ways, moved=moves)
def test_a_map_that_did_not_change_is_kept(one: list[Way], moved: dict[int, float]) -> None:
    stored = table(one, moved)
    said, found = became(stored, stored)
    assert {change for change, _ in said.values()} <= {Change.KEPT}
    assert not len(found.added)
