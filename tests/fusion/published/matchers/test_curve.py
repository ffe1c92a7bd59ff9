"""Curves of positions against curves of roads: against all that there are, where these are finitely many."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.published.matchers.curve import CurveToCurve
from fusion.roads.network import RoadNetwork
from matcher_support import connected, matched

Place = tuple[float, float]
COORDINATES = st.floats(-200, 200).map(lambda v: round(v, 2))


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
    x, y, along, _ = network.project_points(*positions[k], np.arange(len(network)))  # type: ignore[call-arg]
    # At the ends of segments other rules decide which of them offers the place.
    for s in np.flatnonzero((along > 1e-6) & (along < network.length_m - 1e-6)).tolist():
        for forward in (True, False):
            assert taken <= curve_sum(network, s, (x[s], y[s]), forward, positions, k) + 1e-6
