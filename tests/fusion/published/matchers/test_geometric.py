"""Each position by itself, by distance and direction: against a search over all segments."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.published.matchers.geometric import PointToPoint, PointToSegment, SegmentDirection
from fusion.roads.network import RoadNetwork
from matcher_support import matched

MakeNetwork = Callable[..., RoadNetwork]
COORDINATES = st.floats(-200, 200).map(lambda v: round(v, 2))
FAR = st.floats(-5000, 5000).map(lambda v: round(v, 2))
ENDS = hnp.arrays(float, st.tuples(st.integers(1, 20), st.just(4)), elements=COORDINATES)
ANGLES = st.floats(-10, 10)


def ends_of(network: RoadNetwork) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of both ends of every segment, shape (2, n) each."""
    return np.stack([network.x0, network.x1]), np.stack([network.y0, network.y1])


@given(ENDS, FAR, FAR, ANGLES, st.sampled_from([np.inf, 60.0]))
def test_point_to_point_takes_the_nearest_node(
    make_network: MakeNetwork, ends: np.ndarray, x: float, y: float, heading: float, radius: float
) -> None:
    network = make_network(ends)
    found = matched(PointToPoint(radius_m=radius), network, [x, y], heading)
    ex, ey = ends_of(network)
    distances = np.hypot(ex - x, ey - y)
    if distances.min() > radius:
        assert found.segment[0] == -1
        return
    s = found.segment[0]
    assert np.hypot(found.x_m[0] - x, found.y_m[0] - y) == pytest.approx(distances.min(), abs=1e-6)
    assert found.distance_m[0] in {0.0, network.length_m[s]}
    at_node = np.flatnonzero(distances.min(axis=0) <= distances.min() + 1e-6)
    offsets = network.project_points(x, y, at_node)[3]
    assert s in at_node
    assert network.project_points(x, y, s)[3] <= offsets.min() + 2e-6


@given(ENDS, FAR, FAR, st.sampled_from([np.inf, 60.0]))
def test_point_to_segment_takes_the_nearest_segment(
    make_network: MakeNetwork, ends: np.ndarray, x: float, y: float, radius: float
) -> None:
    network = make_network(ends)
    found = matched(PointToSegment(radius_m=radius), network, [x, y])
    px, py, along, offset = network.project_points(x, y, np.arange(len(network)))
    if offset.min() > radius:
        assert found.segment[0] == -1
        return
    s = found.segment[0]
    assert offset[s] == pytest.approx(offset.min(), abs=1e-9)
    assert (found.x_m[0], found.y_m[0], found.distance_m[0]) == pytest.approx(
        (px[s], py[s], along[s]), abs=1e-6
    )


@given(ENDS, COORDINATES, COORDINATES, ANGLES, st.data())
def test_segment_direction_takes_the_least_weight(
    make_network: MakeNetwork, ends: np.ndarray, x: float, y: float, heading: float, data: st.DataObject
) -> None:
    ends = ends[np.any(ends[:, :2] != ends[:, 2:], axis=1)]
    oneway = np.array(
        data.draw(st.lists(st.sampled_from([-1, 0, 1]), min_size=len(ends), max_size=len(ends)))
    )
    network = make_network(ends, oneway)
    found = matched(SegmentDirection(turn_m=30.0, radius_m=np.inf), network, [x, y], heading)
    if not len(network):
        assert found.segment[0] == -1
        return
    cosine = np.cos(network.heading_rad - heading)
    angle = np.stack([np.where(oneway >= 0, 1 - cosine, np.inf), np.where(oneway <= 0, 1 + cosine, np.inf)])
    weight = network.project_points(x, y, np.arange(len(network)))[3] + 30.0 * angle
    taken = weight[0 if found.forward[0] else 1, found.segment[0]]
    assert taken == pytest.approx(weight.min(), abs=1e-6)


def test_without_a_heading_the_direction_does_not_count(make_network: MakeNetwork) -> None:
    network = make_network([[-100, 0, 100, 0], [3, -100, 3, 100]])
    assert matched(SegmentDirection(), network, [0, 2.5], np.pi / 2).segment[0] == 1
    assert matched(SegmentDirection(), network, [0, 2.5]).segment[0] == 0


def test_at_a_node_the_segment_that_fits_the_heading_is_taken(make_network: MakeNetwork) -> None:
    network = make_network([[-100, 0, 0, 0], [0, 0, 0, -100]])
    for heading, segment, forward in [(0.1, 0, True), (3.0, 0, False), (-1.5, 1, True), (1.5, 1, False)]:
        found = matched(PointToPoint(), network, [5, 5], heading)
        assert (found.segment[0], found.forward[0]) == (segment, forward)
        assert (found.x_m[0], found.y_m[0]) == (0, 0)
