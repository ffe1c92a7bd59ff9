"""The town: heights, slopes, structures and the map that describes them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, STRtree

from fusion.simulate.scene.segments import hermite, regression_slope
from fusion.simulate.scene.town import Town, make_town

SEEDS = (1, 2, 3, 4)


@pytest.fixture(scope="module", params=SEEDS)
def any_town(request: pytest.FixtureRequest) -> Town:
    return make_town(request.param)


def ground(town: Town) -> np.ndarray:
    return town.height(town.node_x_m, town.node_y_m)


def inner_nodes(town: Town, structure: np.ndarray) -> np.ndarray:
    """Nodes all of whose segments belong to the structure."""
    inside = np.union1d(town.start[structure], town.end[structure])
    return np.setdiff1d(inside, np.union1d(town.start[~structure], town.end[~structure]))


@given(
    z=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    grades=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    length=st.floats(10, 200),
)
def test_regression_slope_is_that_of_a_line_through_the_profile(
    z: tuple[float, float], grades: tuple[float, float], length: float
) -> None:
    share = (np.arange(1000) + 0.5) / 1000
    z0, z1, grade0, grade1, metres = (np.array(v) for v in (*z, *grades, length))
    measured = np.polyfit(share * length, hermite(z0, z1, grade0, grade1, metres, share), 1)[0]
    assert regression_slope(z0, z1, grade0, grade1, metres) == pytest.approx(measured, abs=1e-5)


def test_true_slopes_are_those_of_the_road_heights(any_town: Town) -> None:
    share = (np.arange(200) + 0.5) / 200
    for k in range(0, len(any_town.roads), 5):
        z = any_town.road_height(np.array(k), share)
        slope = np.polyfit(share * any_town.length_m[k], z, 1)[0]
        assert any_town.true_slope_percent[k] == pytest.approx(100 * slope, abs=1e-3)


def test_slope_is_near_the_difference_of_the_ends(any_town: Town) -> None:
    rise = any_town.node_height_m[any_town.end] - any_town.node_height_m[any_town.start]
    difference = any_town.true_slope_percent - 100 * rise / any_town.length_m
    assert 0 < np.sqrt(np.mean(difference**2)) < 0.3


def test_lengths_are_geodesic(any_town: Town) -> None:
    np.testing.assert_allclose(any_town.length_m, any_town.roads.length_m, rtol=1e-5)


def test_segments_that_meet_agree_in_height(any_town: Town) -> None:
    n = np.arange(len(any_town.roads))
    node = np.r_[any_town.roads.from_node, any_town.roads.to_node]
    ends = np.r_[any_town.road_height(n, np.array(0.0)), any_town.road_height(n, np.array(1.0))]
    order = np.argsort(node)
    same = np.diff(node[order]) == 0
    assert same.sum() > 400
    assert np.abs(np.diff(ends[order])[same]).max() < 1e-9


def test_profiles_have_no_kink_inside_a_way(any_town: Town) -> None:
    at = {
        (int(w), int(a), int(b)): k
        for k, (w, a, b) in enumerate(
            zip(any_town.roads.osm_way_id, any_town.start, any_town.end, strict=True)
        )
    }
    for way in any_town.ways:
        rows = [at[way.way_id, a, b] for a, b in pairwise(way.nodes)]
        for first, second in pairwise(rows):
            assert any_town.grade_end[first] == any_town.grade_start[second]


def test_grades_are_those_of_hills(any_town: Town) -> None:
    slope = np.abs(any_town.true_slope_percent)
    assert 8 < slope.max() < 16
    assert slope[any_town.roads.highway == "motorway"].max() < 6
    assert 1.5 < any_town.true_slope_percent.std() < 5


def test_size(any_town: Town) -> None:
    assert 380 <= len(any_town.roads) <= 600
    assert any_town.length_m.min() >= 20
    assert any_town.length_m.max() <= 120
    assert max(np.abs(any_town.node_x_m).max(), np.abs(any_town.node_y_m).max()) < 1050


def test_roads_follow_the_ground_except_on_structures(any_town: Town) -> None:
    roads = any_town.roads
    ordinary = ~(roads.bridge | roads.tunnel | np.isin(roads.highway.astype(str), ["motorway", "primary"]))
    street = np.setdiff1d(
        np.union1d(any_town.start[ordinary], any_town.end[ordinary]),
        np.union1d(any_town.start[~ordinary], any_town.end[~ordinary]),
    )
    off = (any_town.node_height_m - ground(any_town))[street]
    assert np.abs(off).max() < 4
    assert np.sqrt(np.mean(off**2)) < 1.2


def test_bridges_rise_above_the_ground_and_run_nearly_straight(any_town: Town) -> None:
    bridge = any_town.roads.bridge
    nodes = inner_nodes(any_town, bridge)
    off = (any_town.node_height_m - ground(any_town))[nodes]
    assert len(nodes) >= 8
    assert off.min() > 0
    assert off.max() > 6
    bend = np.abs(any_town.grade_end - any_town.grade_start)[bridge]
    assert np.median(bend) < 0.01


def test_the_tunnel_runs_under_its_hill(any_town: Town) -> None:
    tunnel = any_town.roads.tunnel
    nodes = inner_nodes(any_town, tunnel)
    depth = (ground(any_town) - any_town.node_height_m)[nodes]
    assert len(nodes) >= 3
    assert depth.min() > 3
    assert np.all(any_town.roads.layer[tunnel] == -1)
    assert np.all(any_town.roads.layer[any_town.roads.bridge] == 1)


def test_roads_that_cross_without_a_junction_lie_apart(any_town: Town) -> None:
    x, y = any_town.node_x_m, any_town.node_y_m
    lines = [
        LineString([(x[a], y[a]), (x[b], y[b])]) for a, b in zip(any_town.start, any_town.end, strict=True)
    ]
    first, second = STRtree(lines).query(lines, predicate="crosses")
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if a < b]
    assert len(pairs) >= 4  # over each carriageway, over Valley Road, under Hill Street
    for a, b in pairs:
        point = lines[a].intersection(lines[b])
        heights = [
            float(any_town.road_height(np.array(k), np.array(lines[k].project(point, normalized=True))))
            for k in (a, b)
        ]
        above = any_town.roads.layer[a] > any_town.roads.layer[b]
        assert any_town.roads.layer[a] != any_town.roads.layer[b]
        assert (heights[0] - heights[1]) * (1 if above else -1) > 4.5


def test_the_map_has_every_kind_of_road(any_town: Town) -> None:
    roads = any_town.roads
    assert {"motorway", "motorway_link", "primary", "secondary", "residential"} <= set(roads.highway)
    assert np.sum(roads.oneway == -1) >= 5
    assert np.sum((roads.oneway == 1) & (roads.highway == "residential")) >= 5
    assert np.all(roads.oneway[np.isin(roads.highway.astype(str), ["motorway", "motorway_link"])] == 1)
    assert {"Mühlgasse", "Fir & Larch Walk", None} <= set(roads.name)
    assert sum(w.kind.junction == "roundabout" and w.nodes[0] == w.nodes[-1] for w in any_town.ways) == 3
    assert np.sum(any_town.junction_degree == 1) >= 3


def test_drawing_directions_are_mixed(any_town: Town) -> None:
    two_way = any_town.roads.oneway == 0
    north = any_town.node_y_m[any_town.end] > any_town.node_y_m[any_town.start]
    assert 0.2 < np.mean(north[two_way]) < 0.8


def test_a_seed_makes_one_town() -> None:
    a, b, other = make_town(5), make_town(5), make_town(6)
    for column in a.roads.columns():
        np.testing.assert_array_equal(getattr(a.roads, column), getattr(b.roads, column))
    np.testing.assert_array_equal(a.true_slope_percent, b.true_slope_percent)
    assert not np.array_equal(a.node_height_m[:100], other.node_height_m[:100])
