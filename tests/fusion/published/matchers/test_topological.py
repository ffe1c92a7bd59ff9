"""Topology: anchors, ways that can have been driven, against shortest ways."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.csgraph import csgraph_from_dense, shortest_path

from fusion.published.matchers.base import PointMatcher
from fusion.published.matchers.geometric import SegmentDirection
from fusion.published.matchers.topological import Topological
from fusion.roads.network import RoadNetwork
from matcher_support import connected, matched


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
