"""Routes: legal, unbroken, covering."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from fusion.simulate.drive import simulate_drive
from fusion.simulate.motion.routes import Arcs, Route, plan_route, structures
from fusion.simulate.scene.town import Town, make_town


def ends(town: Town, route: Route) -> tuple[np.ndarray, np.ndarray]:
    """Node where each segment of the route is entered, and where it is left."""
    a, b = town.start[route.segment], town.end[route.segment]
    return np.where(route.forward, a, b), np.where(route.forward, b, a)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_routes_are_unbroken_and_legal(town: Town, seed: int) -> None:
    route = plan_route(town, 900.0, np.random.default_rng(seed))
    entered, left = ends(town, route)
    np.testing.assert_array_equal(entered[1:], left[:-1])
    oneway = town.roads.oneway[route.segment]
    assert np.all(route.forward[oneway == 1])
    assert not np.any(route.forward[oneway == -1])
    turned = route.segment[1:] == route.segment[:-1]
    assert np.all(town.junction_degree[left[:-1][turned]] == 1)


@pytest.mark.parametrize("seed", range(1, 9))
def test_every_arc_can_be_reached_from_every_other(seed: int) -> None:
    arcs = Arcs.of(make_town(seed))
    count, _ = connected_components(arcs.graph(arcs.seconds), directed=True, connection="strong")
    assert count == 1


def test_one_way_segments_have_one_arc_and_others_two(town: Town) -> None:
    arcs = Arcs.of(town)
    expected = np.where(town.roads.oneway == 0, 2, 1)
    np.testing.assert_array_equal(np.bincount(arcs.segment, minlength=len(town.roads)), expected)


def test_dead_ends_are_left_again(town: Town) -> None:
    arcs = Arcs.of(town)
    here, _ = arcs.followers
    assert set(here) == set(range(len(arcs)))


@pytest.mark.parametrize("seed", (1, 2, 3))
def test_routes_that_share_their_visits_cover_the_town(seed: int) -> None:
    town = make_town(seed)
    visits = np.zeros(len(town.roads), np.int64)
    wanted = structures(town)
    for k in range(10):
        route = plan_route(town, 600.0, np.random.default_rng([seed, k]), visits=visits, first=wanted)
        assert np.all(visits[route.segment] > 0)
        if k == 2:
            assert np.all(visits[wanted] > 0)
    assert np.mean(visits > 0) > 0.9


def test_structures_are_bridges_tunnel_and_motorway(town: Town) -> None:
    wanted = structures(town)
    assert np.all(wanted[town.roads.bridge | town.roads.tunnel])
    assert set(town.roads.highway[wanted]) == {"motorway", "motorway_link", "primary", "secondary"}


@pytest.mark.parametrize("seed", (1, 2, 3))
def test_closed_segments_are_not_driven(seed: int) -> None:
    town = make_town(seed)
    closed = np.isin(town.roads.highway.astype(str), ["motorway", "motorway_link"]) | town.roads.tunnel
    route = plan_route(town, 3600.0, np.random.default_rng(seed), closed=closed)
    assert not np.any(closed[route.segment])
    entered, left = ends(town, route)
    np.testing.assert_array_equal(entered[1:], left[:-1])
    assert len(set(route.segment)) > 0.8 * np.sum(~closed)


def test_a_given_route_is_driven(town: Town) -> None:
    route = plan_route(town, 400.0, np.random.default_rng(8))
    drive = simulate_drive(town, 1, 200.0, route=route)
    passed = [p.segment for p in drive.passes()]
    assert passed == list(route.segment[: len(passed)])
    assert len(passed) > 5
