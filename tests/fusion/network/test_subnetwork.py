"""What a change can reach, which gaps are bridged, and what is solved again, on small hand-made networks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factor_support import block_of_streets, roads, street
from fusion.network.subnetwork import (
    PUBLISH_RADIUS_M,
    SOLVE_RADIUS_M,
    boxes_around,
    gap_rows,
    neighbourhood,
    subnetwork_around,
)
from fusion.roads.table import RoadTable


def mask(table: RoadTable, *rows: int) -> np.ndarray:
    out = np.zeros(len(table), bool)
    out[list(rows)] = True
    return out


def found(rows: np.ndarray) -> list[int]:
    assert rows.dtype == np.bool_
    return np.flatnonzero(rows).tolist()


def distances(table: RoadTable, use: np.ndarray) -> dict[int, dict[int, float]]:
    """Shortest ways between all nodes along some rows, by Floyd and Warshall."""
    nodes = {*table.from_node.tolist(), *table.to_node.tolist()}
    way = {a: {b: 0.0 if a == b else np.inf for b in nodes} for a in nodes}
    for row in np.flatnonzero(use):
        a, b = int(table.from_node[row]), int(table.to_node[row])
        way[a][b] = way[b][a] = min(way[a][b], float(table.length_m[row]))
    for k in nodes:
        for a in nodes:
            for b in nodes:
                way[a][b] = min(way[a][b], way[a][k] + way[k][b])
    return way


def test_reach_is_measured_along_the_road_to_where_a_segment_begins() -> None:
    table = street(*[100.0] * 8)
    everything = np.ones(8, bool)
    assert found(neighbourhood(table, everything, mask(table, 3), 150.0)) == [1, 2, 3, 4, 5]
    assert found(neighbourhood(table, everything, mask(table, 3), 0.0)) == [2, 3, 4]
    assert found(neighbourhood(table, everything, mask(table, 0, 7), 110.0)) == [0, 1, 2, 5, 6, 7]


def test_undriven_roads_neither_carry_a_change_nor_are_reached_by_it() -> None:
    table = street(*[100.0] * 6)
    driven = mask(table, 0, 1, 3, 4, 5)
    assert found(neighbourhood(table, driven, mask(table, 0), 1000.0)) == [0, 1]
    assert found(neighbourhood(table, driven, mask(table, 3), 1000.0)) == [3, 4, 5]


def test_a_touched_segment_that_lost_its_last_pass_still_counts() -> None:
    table = street(*[100.0] * 4)
    assert found(neighbourhood(table, mask(table, 0, 1, 3), mask(table, 2), 50.0)) == [1, 2, 3]


def test_nothing_touched_reaches_nothing() -> None:
    table = street(100.0, 100.0)
    assert found(neighbourhood(table, np.ones(2, bool), np.zeros(2, bool), 1e3)) == []
    empty = RoadTable.empty()
    assert len(neighbourhood(empty, np.zeros(0, bool), np.zeros(0, bool), 1e3)) == 0
    assert len(gap_rows(empty, np.zeros(0, bool))) == 0


def test_of_two_roads_between_the_same_nodes_the_shorter_counts() -> None:
    points = {0: (0.0, 0.0), 1: (100.0, 0.0), 2: (50.0, 200.0), 3: (200.0, 0.0)}
    table = roads(points, [(0, 2), (2, 1), (0, 1), (1, 3)])
    assert found(neighbourhood(table, np.ones(4, bool), mask(table, 0), 110.0)) == [0, 1, 2, 3]


@given(seed=st.integers(0, 2**31), radius=st.floats(0, 400))
def test_reach_against_all_shortest_ways(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    table = block_of_streets(4, 3, 80.0)
    driven, touched = rng.random(len(table)) < 0.7, rng.random(len(table)) < 0.1
    way = distances(table, driven | touched)
    sources = [n for r in np.flatnonzero(touched) for n in (int(table.from_node[r]), int(table.to_node[r]))]
    expected = [
        row
        for row in range(len(table))
        if touched[row]
        or (
            driven[row]
            and min(
                (way[s][e] for s in sources for e in (int(table.from_node[row]), int(table.to_node[row]))),
                default=np.inf,
            )
            <= radius
        )
    ]
    assert found(neighbourhood(table, driven, touched, radius)) == expected


def test_a_chain_of_several_segments_between_driven_ones_is_a_gap() -> None:
    table = street(100.0, 40.0, 50.0, 60.0, 100.0)
    driven = mask(table, 0, 4)
    assert found(gap_rows(table, driven)) == [1, 2, 3]
    assert found(gap_rows(table, driven, 151.0)) == [1, 2, 3]
    assert found(gap_rows(table, driven, 149.0)) == []


def test_long_chains_are_found_whole_wherever_their_middle_lies() -> None:
    for lengths in (
        (150.0, 10.0, 10.0, 10.0),
        (10.0, 10.0, 10.0, 150.0),
        (10.0, 150.0, 10.0, 10.0),
        (20.0,) * 9,
    ):
        table = street(30.0, *lengths, 30.0)
        gap = list(range(1, len(lengths) + 1))
        assert found(gap_rows(table, mask(table, 0, len(table) - 1))) == gap


def test_blind_alleys_and_loops_from_one_node_are_no_gaps() -> None:
    points = {
        0: (0.0, 0.0), 1: (100.0, 0.0), 2: (200.0, 0.0),
        3: (100.0, 40.0), 4: (100.0, 80.0),  # a blind alley of two segments from node 1
        5: (230.0, 20.0), 6: (230.0, -20.0),  # a turning loop at node 2
    }  # fmt: skip
    table = roads(points, [(0, 1), (1, 2), (1, 3), (3, 4), (2, 5), (5, 6), (6, 2)])
    assert found(gap_rows(table, mask(table, 0, 1))) == []


def test_the_side_branches_of_a_gap_are_not_part_of_it() -> None:
    points = {
        0: (0.0, 0.0),
        1: (50.0, 0.0),
        2: (90.0, 0.0),
        3: (130.0, 0.0),
        4: (180.0, 0.0),
        5: (90.0, 30.0),
    }
    table = roads(points, [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5)])
    assert found(gap_rows(table, mask(table, 0, 3))) == [1, 2]


def test_where_three_driven_ends_meet_all_ways_between_them_are_gaps() -> None:
    points = {
        0: (0.0, 0.0), 1: (-60.0, 0.0), 2: (60.0, 0.0), 3: (0.0, 70.0),
        4: (-160.0, 0.0), 5: (160.0, 0.0), 6: (0.0, 170.0),
    }  # fmt: skip
    table = roads(points, [(0, 1), (0, 2), (0, 3), (1, 4), (2, 5), (3, 6)])
    assert found(gap_rows(table, mask(table, 3, 4, 5))) == [0, 1, 2]


def test_driven_segments_are_never_gaps_and_without_any_there_is_none() -> None:
    table = street(50.0, 50.0, 50.0)
    assert found(gap_rows(table, np.ones(3, bool))) == []
    assert found(gap_rows(table, np.zeros(3, bool))) == []
    assert found(gap_rows(table, mask(table, 1))) == []


def test_a_road_parallel_to_a_driven_one_bridges_its_ends() -> None:
    points = {0: (0.0, 0.0), 1: (80.0, 0.0), 2: (40.0, 30.0)}
    table = roads(points, [(0, 1), (0, 2), (2, 1)])
    assert found(gap_rows(table, mask(table, 0))) == [1, 2]


@given(seed=st.integers(0, 2**31), longest=st.floats(50, 350))
def test_a_gap_is_on_a_way_that_is_short_enough_and_every_shortest_way_is_found(
    seed: int, longest: float
) -> None:
    """Against all shortest ways: none too long is marked; between neighbours that are near enough, all is."""
    rng = np.random.default_rng(seed)
    table = block_of_streets(4, 4, 70.0)
    driven = rng.random(len(table)) < 0.25
    gaps = gap_rows(table, driven, longest)
    assert not np.any(gaps & driven)
    way = distances(table, ~driven)
    anchors = {n for r in np.flatnonzero(driven) for n in (int(table.from_node[r]), int(table.to_node[r]))}
    through = np.full(len(table), np.inf)
    for row in np.flatnonzero(~driven):
        a, b, length = int(table.from_node[row]), int(table.to_node[row]), float(table.length_m[row])
        through[row] = min(
            (way[p][a] + length + way[b][q] for p in anchors for q in anchors if p != q), default=np.inf
        )
    assert np.all(through[gaps] <= longest + 1e-6)
    # A row between two driven nodes that is short enough itself is a gap whatever lies around it.
    alone = [
        r
        for r in np.flatnonzero(~driven)
        if {int(table.from_node[r]), int(table.to_node[r])} <= anchors and table.length_m[r] <= longest
    ]
    assert np.all(gaps[alone])


@pytest.mark.parametrize("shuffle", [1, 2, 3])
def test_the_order_of_rows_and_the_direction_of_drawing_do_not_matter(shuffle: int) -> None:
    points = {k: (45.0 * k, 8.0 * (k % 2)) for k in range(9)}
    edges = [(k, k + 1) for k in range(8)]
    rng = np.random.default_rng(shuffle)
    order = rng.permutation(8)
    turned = [edges[k] if rng.random() < 0.5 else edges[k][::-1] for k in order]
    table = roads(points, turned)
    driven = np.isin(order, [0, 4, 7])
    assert sorted(order[gap_rows(table, driven)].tolist()) == [1, 2, 3, 5, 6]
    near = neighbourhood(table, np.ones(8, bool), order == 4, 50.0)
    assert sorted(order[near].tolist()) == [2, 3, 4, 5, 6]


SEGMENT_M = 97.0


def road_northwards(n: int) -> RoadTable:
    """A straight road to the north, a segment every 97 m."""
    lat = 49.0 + np.arange(n + 1) * SEGMENT_M / 111_210.0
    k = np.arange(n)
    return RoadTable.from_columns(
        osm_way_id=np.ones(n), from_node=k, to_node=k + 1,
        lon0_deg=np.full(n, 8.0), lat0_deg=lat[:-1], lon1_deg=np.full(n, 8.0), lat1_deg=lat[1:],
        oneway=np.zeros(n), bridge=np.zeros(n, bool), tunnel=np.zeros(n, bool), layer=np.zeros(n),
        highway=["residential"] * n, name=[None] * n,
    )  # fmt: skip


def mask_of(n: int, *rows: int) -> np.ndarray:
    out = np.zeros(n, bool)
    out[list(rows)] = True
    return out


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_window_reaches_along_the_road(scale: float) -> None:
    n, every = 60, np.ones(60, bool)
    window = subnetwork_around(road_northwards(n), every, mask_of(n, 30), every, scale)
    far = np.abs(np.arange(n) - 30) * SEGMENT_M - SEGMENT_M  # from the touched row to where a row begins
    assert window.solved.tolist() == (far <= scale * SOLVE_RADIUS_M).tolist()
    assert window.published.tolist() == (far <= scale * PUBLISH_RADIUS_M).tolist()
    assert not np.any(window.ring & window.published)
    assert np.all(window.solved[window.ring])
    assert window.ring.any()


def test_gaps_join_what_they_lie_between_and_vanish_where_they_join_nothing() -> None:
    n = 12
    driven = mask_of(n, 0, 1, 4, 5)
    window = subnetwork_around(road_northwards(n), driven, mask_of(n, 0), mask_of(n, 0, 1, 7))
    assert np.flatnonzero(window.solved).tolist() == [0, 1, 2, 3, 4, 5]  # 2 and 3 are a gap of 194 m
    alone = subnetwork_around(road_northwards(n), mask_of(n, 0, 1), mask_of(n, 0), mask_of(n, 0, 1, 2, 3))
    assert np.flatnonzero(alone.solved).tolist() == [0, 1]
    assert np.flatnonzero(alone.published).tolist() == [0, 1, 2, 3]  # the former gap goes


def test_a_row_that_lost_its_last_pass_is_published_as_unknown() -> None:
    window = subnetwork_around(road_northwards(4), mask_of(4, 0), mask_of(4, 3), mask_of(4, 0, 3))
    assert not window.solved[3]
    assert window.published[3]


@given(
    ends=st.lists(st.tuples(*[st.floats(-0.02, 0.02)] * 4), min_size=1, max_size=8),
    lat=st.sampled_from([0.0, 48.0, -33.0, 70.0]),
    radius_m=st.floats(50.0, 1500.0),
    seed=st.integers(0, 99),
)
def test_boxes_hold_all_that_is_near_and_do_not_overlap(
    ends: list[tuple[float, float, float, float]], lat: float, radius_m: float, seed: int
) -> None:
    lon0, lat0, lon1, lat1 = np.array(ends).T
    lat0, lat1 = lat0 + lat, lat1 + lat
    boxes = boxes_around(lon0, lat0, lon1, lat1, radius_m)
    # Points within the radius of some point of some line.
    rng = np.random.default_rng(seed)
    which, share = rng.integers(len(ends), size=50), rng.uniform(size=50)
    angle, far = rng.uniform(0, 2 * np.pi, 50), radius_m * np.sqrt(rng.uniform(size=50))
    y = lat0[which] + share * (lat1 - lat0)[which] + np.sin(angle) * far / 111_700.0
    x = lon0[which] + share * (lon1 - lon0)[which]
    x += np.cos(angle) * far / (111_700.0 * np.cos(np.radians(y)))
    inside = (
        (boxes[:, 0, None] <= x) & (x <= boxes[:, 2, None])
        & (boxes[:, 1, None] <= y) & (y <= boxes[:, 3, None])
    )  # fmt: skip
    assert inside.any(axis=0).all()
    for a, b in pairwise(boxes):
        assert b[1] > a[1] or b[0] > a[2]


@pytest.mark.parametrize(
    ("sides", "joined", "left"), [(30, False, True), (4, False, False), (30, True, False)]
)
def test_a_gap_between_roads_that_only_the_outside_compares_waits(
    sides: int, joined: bool, left: bool
) -> None:
    """Long roads side by side may meet outside of the window; short ones end in it, others meet in it."""
    middle = sides // 2
    points = {
        side + k: (side * SEGMENT_M / 100, SEGMENT_M * k) for side in (0, 100) for k in range(sides + 1)
    }
    rungs = [(middle, 100 + middle), (middle + 1, 101 + middle)]
    table = roads(points, [(s + k, s + k + 1) for s in (0, 100) for k in range(sides)] + rungs)
    gap = 2 * sides
    driven = np.ones(len(table), bool)
    driven[gap], driven[gap + 1] = False, joined
    gaps = [gap] if joined else [gap, gap + 1]
    window = subnetwork_around(table, driven, mask(table, middle), driven)
    assert np.all(window.solved[gaps])
    assert np.all(window.published[gaps])
    assert found(window.outward) == (gaps if left else [])
    # A slope that rests on a pass that is gone does not stay.
    again = subnetwork_around(table, driven, mask(table, middle, gap), driven)
    assert found(again.outward) == (gaps[1:] if left else [])
