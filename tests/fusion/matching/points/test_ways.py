"""The matchers that follow roads: curves against all that there are, topology against shortest ways."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matcher_support import connected, matched
from scipy.sparse.csgraph import csgraph_from_dense, shortest_path

from fusion.matching.points.base import PointMatcher
from fusion.matching.points.curve import CurveToCurve
from fusion.matching.points.geometric import SegmentDirection
from fusion.matching.points.topological import Topological
from fusion.roads.network import RoadNetwork

Place = tuple[float, float]
COORDINATES = st.floats(-200, 200).map(lambda v: round(v, 2))

# --- curves ---


@given(
    hnp.arrays(float, st.tuples(st.integers(1, 12), st.just(4)), elements=COORDINATES),
    st.tuples(COORDINATES, COORDINATES),
)
def test_a_curve_of_one_position_is_the_nearest_place(ends: np.ndarray, place: Place) -> None:
    network = connected(ends.reshape(-1, 2), np.arange(2 * len(ends)).reshape(-1, 2))
    found = matched(CurveToCurve(points=0, radius_m=600.0), network, place)
    offset = network.project_points(*place, np.arange(len(network)))[3]
    assert np.hypot(found.x_m[0] - place[0], found.y_m[0] - place[1]) == pytest.approx(offset.min(), abs=1e-6)


@pytest.mark.parametrize("onward", [True, False])
def test_the_order_of_the_positions_tells_the_direction(onward: bool) -> None:
    network = connected([[0, 0], [100, 0], [200, 50]], [[0, 1], [2, 1]])
    positions = [[20, 3], [50, -3], [80, 2], [115, 8], [150, 20]]
    found = matched(CurveToCurve(), network, positions if onward else positions[::-1])
    assert found.segment.tolist() == ([0, 0, 0, 1, 1] if onward else [1, 1, 0, 0, 0])
    assert np.array_equal(found.forward, (found.segment == 0) == onward)


def test_a_curve_does_not_enter_a_one_way_street_from_its_end() -> None:
    """Both branches are as near; one may not be driven."""
    nodes = [[0, 0], [100, 0], [200, 10], [200, -10]]
    positions = np.column_stack([np.arange(20, 200, 15.0), np.zeros(12)])
    for oneway, branch in (([0, -1, 0], 2), ([0, 0, -1], 1)):
        network = connected(nodes, [[0, 1], [1, 2], [1, 3]], oneway)
        assert matched(CurveToCurve(), network, positions).segment[-3:].tolist() == [branch] * 3


def test_a_curve_does_not_come_from_a_one_way_street_by_its_beginning() -> None:
    """The nearer road cannot have been come along, the farther one can."""
    nodes = [[0, 4], [100, 4], [200, 4], [0, -9], [100, -9], [200, -9]]
    positions = np.column_stack([np.arange(20, 200, 15.0), np.zeros(12)])
    for oneway, road in ((0, 1), ([-1, 0, 0, 0], 3)):
        network = connected(nodes, [[0, 1], [1, 2], [3, 4], [4, 5]], oneway)
        assert matched(CurveToCurve(), network, positions).segment[6] == road


def test_a_curve_is_no_longer_than_that_of_the_positions_allows() -> None:
    """A hairpin passes both positions closely, but the way round it is three times as long as theirs."""
    network = connected([[0, 0], [30, 10], [-30, 20], [4, -20], [4, 60]], [[0, 1], [1, 2], [3, 4]])
    positions = [[0, 0], [0, 20]]
    assert matched(CurveToCurve(), network, positions).segment[0] == 2
    assert matched(CurveToCurve(stretch=3.0), network, positions).segment[0] == 0


def test_positions_far_apart_are_each_by_itself() -> None:
    network = connected([[-50, 0], [400, 0], [-50, 10], [400, 10]], [[0, 1], [2, 3]])
    positions = [[0, 4], [300, 9]]
    assert matched(CurveToCurve(longest_m=250.0), network, positions).segment.tolist() == [0, 1]
    assert matched(CurveToCurve(longest_m=400.0), network, positions).segment.tolist() == [1, 1]


@st.composite
def trees(draw: st.DrawFn) -> RoadNetwork:
    """Roads without a ring, so that there are finitely many curves; nodes at least 1 m apart along x."""
    count = draw(st.integers(2, 7))
    nodes = [[17.0 * k + draw(st.floats(0, 16)), draw(st.floats(-60, 60))] for k in range(count)]
    pairs = [[draw(st.integers(0, k - 1)), k] for k in range(1, count)]
    return connected(nodes, [p[::-1] if draw(st.booleans()) else p for p in pairs])


def runs(network: RoadNetwork, segment: int, node: int, begin: Place) -> Iterator[list[np.ndarray]]:
    """In a tree: all curves from a place on a segment towards a node and on, as straight parts x0 y0 x1 y1."""
    a, b = network.table.from_node, network.table.to_node
    corner = {int(n): p for n, p in zip(a, zip(network.x0, network.y0, strict=True), strict=True)}
    corner |= {int(n): p for n, p in zip(b, zip(network.x1, network.y1, strict=True), strict=True)}
    part = np.array([*begin, *corner[node]])
    yield [part]
    for s in np.flatnonzero((a == node) | (b == node)).tolist():
        if s != segment:
            yield from ([part, *rest] for rest in runs(network, s, int(a[s] + b[s]) - node, corner[node]))


def least_sum(parts: list[np.ndarray], positions: np.ndarray) -> float:
    """Least sum of the distances of positions, in order, to straight parts, by trying every way to share them out."""
    if not len(positions):
        return 0.0
    if not parts:
        return np.inf
    (ax, ay, bx, by), sums, taken = parts[0], [least_sum(parts[1:], positions)], 0.0
    square = (bx - ax) ** 2 + (by - ay) ** 2
    for count, (x, y) in enumerate(positions, 1):
        along = (x - ax) * (bx - ax) + (y - ay) * (by - ay)
        share = np.clip(along / square, 0, 1) if square > 0 else 0.0
        taken += float(np.hypot(ax + share * (bx - ax) - x, ay + share * (by - ay) - y))
        sums.append(taken + least_sum(parts[1:], positions[count:]))
    return min(sums)


def curve_sum(
    network: RoadNetwork, segment: int, place: Place, forward: bool, positions: np.ndarray, k: int
) -> float:
    """Sum of the distances of all positions to the best curve through a place, which the k-th is matched with."""
    a, b = int(network.table.from_node[segment]), int(network.table.to_node[segment])
    total = float(np.hypot(*(positions[k] - place)))
    for node, side in ((b if forward else a, positions[k + 1 :]), (a if forward else b, positions[:k][::-1])):
        total += min(least_sum(parts, side) for parts in runs(network, segment, node, place))
    return total


@given(
    trees(),
    st.lists(st.tuples(st.floats(0, 120), st.floats(-60, 60)), min_size=4, max_size=4),
    st.integers(0, 3),
)
def test_no_other_place_has_a_nearer_curve(network: RoadNetwork, places: list[Place], k: int) -> None:
    positions = np.array(places)
    matcher = CurveToCurve(points=3, slack_m=1e4, radius_m=1e3, longest_m=1e9)
    found = matched(matcher, network, positions)
    place = float(found.x_m[k]), float(found.y_m[k])
    taken = curve_sum(network, int(found.segment[k]), place, bool(found.forward[k]), positions, k)
    x, y, along, _ = network.project_points(*positions[k], np.arange(len(network)))
    # At the ends of segments other rules decide which of them offers the place.
    for s in np.flatnonzero((along > 1e-6) & (along < network.length_m - 1e-6)).tolist():
        for forward in (True, False):
            assert taken <= curve_sum(network, s, (x[s], y[s]), forward, positions, k) + 1e-6


# --- topology ---


def town(rng: np.random.Generator) -> RoadNetwork:
    """A crooked grid of 5 x 5 junctions about 60 m apart, some streets missing and some one-way."""
    nodes = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2) * 60.0
    nodes += rng.uniform(-10, 10, nodes.shape)
    pairs = [[k, k + 1] for k in range(25) if k % 5 < 4] + [[k, k + 5] for k in range(20)]
    kept = np.array(pairs)[rng.random(len(pairs)) < 0.8]
    return connected(nodes, kept, rng.choice([-1, 0, 0, 1], len(kept)))


def ends(network: RoadNetwork, segment: int, along_m: float, leaving: bool) -> dict[int, float]:
    """Nodes to which one may drive from a place on a segment (or from which to the place), with the distance."""
    t, length = network.table, float(network.length_m[segment])
    allowed = t.oneway[segment] if leaving else -t.oneway[segment]
    out = {}
    if allowed >= 0 or along_m >= length - 1e-9:  # a place at the very end is at the junction
        out[int(t.to_node[segment])] = length - along_m
    if allowed <= 0 or along_m <= 1e-9:
        out[int(t.from_node[segment])] = along_m
    return out


def between_nodes(network: RoadNetwork) -> np.ndarray:
    """Lengths of the shortest ways from node to node, shape (k, k), infinite where there is none."""
    t = network.table
    k = int(max(t.from_node.max(), t.to_node.max())) + 1
    direct = np.full((k, k), np.inf)
    onward, back = t.oneway >= 0, t.oneway <= 0
    np.minimum.at(direct, (t.from_node[onward], t.to_node[onward]), network.length_m[onward])
    np.minimum.at(direct, (t.to_node[back], t.from_node[back]), network.length_m[back])
    return np.asarray(shortest_path(csgraph_from_dense(direct, null_value=np.inf)))


def way(network: RoadNetwork, nodes: np.ndarray, sa: int, da: float, sb: int, db: float) -> float:
    """Length of the shortest way from one place to another."""
    ways = [
        away + nodes[u, v] + onto
        for u, away in ends(network, sa, da, leaving=True).items()
        for v, onto in ends(network, sb, db, leaving=False).items()
    ]
    if sa == sb and (db - da) * network.table.oneway[sa] >= 0:
        ways.append(abs(db - da))
    return min(ways)


def leaps(matcher: PointMatcher, detour: float, slack_m: float) -> tuple[int, int]:
    """On erratic walks through many towns: steps between matches, and those longer than can have been driven."""
    steps, too_long = 0, 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        network = town(rng)
        nodes = between_nodes(network)
        turn = np.cumsum(rng.normal(0, 0.5, 40))
        walk = 120 + np.cumsum(20 * np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
        walk = 240 - np.abs(walk % 480 - 240)  # at the edge of the town it turns back
        found = matched(matcher, network, walk, turn)
        on = found.segment >= 0
        for k in np.flatnonzero(on[:-1] & on[1:]).tolist():
            (sa, sb), (da, db) = found.segment[k : k + 2].tolist(), found.distance_m[k : k + 2].tolist()
            bound = slack_m + detour * float(np.hypot(*(walk[k + 1] - walk[k])))
            steps += 1
            too_long += way(network, nodes, sa, da, sb, db) > bound + 1e-6
    return steps, too_long


def test_topology_never_leaps_to_a_place_that_cannot_be_reached() -> None:
    eager = Topological(detour=1.5, slack_m=10.0, back_m=0.0, start_margin=0.0)
    steps, too_long = leaps(eager, 1.5, 10.0)
    assert steps > 300
    assert too_long == 0
    # A rule that looks at each position by itself leaps on the same walks.
    assert leaps(SegmentDirection(), 1.5, 10.0)[1] > 300


@pytest.mark.parametrize("seed", range(10))
def test_a_drive_along_the_roads_is_followed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    network = town(rng)
    places, headings = [], []
    segment = int(rng.integers(len(network)))
    forward = bool(network.table.oneway[segment] >= 0)
    for _ in range(12):
        a, b = (0, 1) if forward else (1, 0)
        corners = np.array(
            [[network.x0[segment], network.y0[segment]], [network.x1[segment], network.y1[segment]]]
        )
        places += [corners[a] + share * (corners[b] - corners[a]) for share in (0.2, 0.4, 0.6, 0.8)]
        headings += [float(np.arctan2(*(corners[b] - corners[a])[::-1]))] * 4
        node = (network.table.to_node if forward else network.table.from_node)[segment]
        out = [(s, True) for s in np.flatnonzero(network.table.from_node == node).tolist()]
        out += [(s, False) for s in np.flatnonzero(network.table.to_node == node).tolist()]
        out = [(s, f) for s, f in out if s != segment and network.table.oneway[s] * (1 if f else -1) >= 0]
        if not out:
            break
        segment, forward = out[int(rng.integers(len(out)))]
    found = matched(Topological(), network, places, headings)
    begin = int(np.argmax(found.segment >= 0))
    assert begin <= 3
    assert found.segment[begin] >= 0
    assert found.x_m[begin:] == pytest.approx(np.array(places)[begin:, 0], abs=1e-6)
    assert found.y_m[begin:] == pytest.approx(np.array(places)[begin:, 1], abs=1e-6)
    assert np.cos(found.heading_rad - headings)[begin:] == pytest.approx(1)


def parallels(gap_m: float) -> RoadNetwork:
    """Road 0 and, beside it, road 1; nothing joins them."""
    return connected([[0, 0], [1000, 0], [0, gap_m], [1000, gap_m]], [[0, 1], [2, 3]])


def test_between_two_roads_there_is_no_anchor() -> None:
    y = np.array([10, 10, 10, 2, 10, 12, 13])
    found = matched(Topological(), parallels(20), np.column_stack([100 + 20.0 * np.arange(7), y]), 0.0)
    assert found.segment.tolist() == [-1, -1, -1, 0, 0, 0, 0]


def test_an_outlier_has_no_match_and_is_passed_over() -> None:
    y = np.array([2, 10, 300, 10, 12])
    found = matched(Topological(), parallels(20), np.column_stack([100 + 20.0 * np.arange(5), y]), 0.0)
    assert found.segment.tolist() == [0, 0, -1, 0, 0]


def test_who_is_lost_finds_another_anchor() -> None:
    y = np.array([0, 0, 0, 40, 40, 40, 40, 40])
    found = matched(Topological(), parallels(40), np.column_stack([100 + 20.0 * np.arange(8), y]), 0.0)
    assert found.segment.tolist() == [0, 0, 0, 0, 0, -1, 1, 1]


def test_who_was_off_the_roads_for_long_is_lost() -> None:
    y = np.array([2, 10, 300, 300, 300, 10, 10])
    found = matched(Topological(), parallels(20), np.column_stack([100 + 20.0 * np.arange(7), y]), 0.0)
    assert found.segment.tolist() == [0, 0, -1, -1, -1, -1, -1]


def test_after_a_gap_the_start_is_sought_again() -> None:
    x, y = 100 + 20.0 * np.arange(5), np.array([0, 0, 10, 10, 38])
    time = np.array([0, 2, 300, 302, 304])
    found = Topological().match(parallels(20), time, x, y, np.zeros(5))
    assert found.segment.tolist() == [0, 0, -1, -1, 1]


def test_turning_round_is_seen_by_the_heading() -> None:
    x = np.concatenate([np.arange(0, 101, 20.0), np.arange(80, -1, -20.0)])
    heading = np.where(np.arange(11) < 6, 0.0, np.pi)
    found = matched(
        Topological(), connected([[-50, 0], [200, 0]], [[0, 1]]), np.column_stack([x, 0 * x]), heading
    )
    assert found.forward.tolist() == [True] * 6 + [False] * 5


def test_a_one_way_street_is_not_driven_against_its_direction() -> None:
    """Two carriageways 8 m apart, joined at the ends; positions lean to the wrong one."""
    nodes = [[0, 0], [500, 0], [0, 8], [500, 8]]
    network = connected(nodes, [[0, 1], [1, 3], [2, 3], [0, 2]], [1, 0, -1, 0])
    x = np.arange(20, 480, 20.0)
    found = matched(Topological(), network, np.column_stack([x, np.full(len(x), 5.0)]), 0.0)
    assert np.all(found.segment == 0)
