"""Networks in the plane: projection, spatial index, points on segments; against shapely."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.roads.grid import cells_around, project_point
from fusion.roads.network import RoadNetwork
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable

MakeNetwork = Callable[..., RoadNetwork]
COORDINATES = st.floats(-3000, 3000).map(lambda v: round(v, 2))
ENDS = hnp.arrays(float, st.tuples(st.integers(1, 25), st.just(4)), elements=COORDINATES)


def lines(network: RoadNetwork) -> np.ndarray:
    ends = np.stack([network.x0, network.y0, network.x1, network.y1], axis=1).reshape(-1, 2, 2)
    return np.asarray(shapely.linestrings(ends))


def near(network: RoadNetwork, x: float, y: float, radius: float) -> list[int]:
    """The segments no farther than ``radius`` from a place, ascending: those of the cells around it that are."""
    grid = network.grid
    first, last, low, high = cells_around(grid, x, y, radius + 1e-6)
    found = set()
    for row in range(low, high + 1):
        begin, end = grid.start[row * grid.columns + np.array([first, last + 1])]
        for s in grid.items[begin:end].tolist():
            _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
            if np.hypot(px - x, py - y) <= radius:
                found.add(s)
    return sorted(found)


@given(ENDS, COORDINATES, COORDINATES, st.floats(0.01, 2000))
def test_segments_near_a_place_are_those_of_shapely(
    make_network: MakeNetwork, ends: np.ndarray, x: float, y: float, radius: float
) -> None:
    network = make_network(ends)
    distance = shapely.distance(lines(network), shapely.Point(x, y))
    clear = np.abs(distance - radius) > 1e-6  # at the very edge rounding decides
    tree = shapely.STRtree(lines(network))
    expected = np.sort(tree.query(shapely.Point(x, y), predicate="dwithin", distance=radius))
    assert {s for s in near(network, x, y, radius) if clear[s]} == set(expected[clear[expected]].tolist())


@given(ENDS, hnp.arrays(float, 25, elements=st.floats(0, 1)))
def test_every_segment_is_found_from_its_own_points(
    make_network: MakeNetwork, ends: np.ndarray, share: np.ndarray
) -> None:
    network = make_network(ends)
    for s in range(len(network)):
        x = network.x0[s] + share * (network.x1[s] - network.x0[s])
        y = network.y0[s] + share * (network.y1[s] - network.y0[s])
        assert all(s in near(network, a, b, 0.01) for a, b in zip(x, y, strict=True))


@given(ENDS, hnp.arrays(float, (8, 2), elements=COORDINATES), st.data())
def test_project_points_is_the_nearest_point_of_the_segment(
    make_network: MakeNetwork, ends: np.ndarray, points: np.ndarray, data: st.DataObject
) -> None:
    network = make_network(ends)
    segment = np.array(data.draw(st.lists(st.integers(0, len(ends) - 1), min_size=8, max_size=8)))
    px, py, along, offset = network.project_points(points[:, 0], points[:, 1], segment)
    line, point = lines(network)[segment], shapely.points(points)
    assert offset == pytest.approx(shapely.distance(line, point), abs=1e-6)
    assert np.all((along >= 0) & (along <= network.length_m[segment] + 1e-9))
    assert np.hypot(px - network.x0[segment], py - network.y0[segment]) == pytest.approx(along, abs=1e-6)
    assert np.hypot(px - points[:, 0], py - points[:, 1]) == pytest.approx(offset, abs=1e-6)


def test_project_points_broadcasts(make_network: MakeNetwork) -> None:
    network = make_network([[0, 0, 100, 0], [0, 0, 0, 50]])
    px, py, along, offset = network.project_points([10.0, 120.0, -5.0], 3.0, 0)
    assert px.tolist() == [10, 100, 0]
    assert py.tolist() == [0, 0, 0]
    assert along.tolist() == [10, 100, 0]
    assert offset == pytest.approx([3, np.hypot(20, 3), np.hypot(5, 3)])


def test_projection_keeps_lengths_and_headings(make_table: Callable[..., RoadTable]) -> None:
    table = make_table([8.0, 8.0, 8.0], [49.0, 49.0, 49.0], [8.001, 8.0, 7.999], [49.0, 49.001, 49.0])
    network = RoadNetwork.project(table)
    assert network.heading_rad == pytest.approx([0, np.pi / 2, np.pi], abs=1e-4)
    assert network.length_m == pytest.approx(table.length_m, rel=1e-5)
    assert len(network) == 3


def test_an_empty_network_needs_a_projection_and_has_nothing_near(make_network: MakeNetwork) -> None:
    with pytest.raises(ValueError, match="give a projection"):
        RoadNetwork.project(RoadTable.empty())
    network = RoadNetwork.project(RoadTable.empty(), make_network([[0, 0, 1, 1]]).projection)
    assert near(network, 0.0, 0.0, 1e6) == []


def test_the_index_stays_small_over_a_wide_extent(make_network: MakeNetwork) -> None:
    network = make_network([[0, 0, 10, 0], [9e5, 9e5, 9e5, 9e5 + 10]])
    assert len(network.grid.start) < 100
    assert near(network, 9e5, 9e5, 5.0) == [1]


def test_segments_near_places_of_a_real_network(shared_data: Path) -> None:
    network = RoadNetwork.project(read_roads(shared_data / "karlsruhe" / "roads_09_10.osm"))
    tree = shapely.STRtree(lines(network))
    rng = np.random.default_rng(1)
    for k in rng.integers(len(network), size=200):
        x, y = network.x0[k] + rng.normal() * 50, network.y0[k] + rng.normal() * 50
        expected = np.sort(tree.query(shapely.Point(x, y), predicate="dwithin", distance=60.0))
        assert near(network, x, y, 60.0) == expected.tolist()
