"""The matcher of whole drives on small networks made for one question each."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drive_matching_support import PLANE, Place, along, check, nodes_of, roads, town
from fusion.matching.drive import DriveMatcher, MatchOptions, match_drive
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable


@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=5),
    st.floats(0.0, 3.0),
    st.floats(3.0, 25.0),
    st.integers(0, 2**31),
)
@settings(max_examples=40)
def test_a_walk_through_the_grid_is_found(
    crossings: list[tuple[int, int]], noise: float, speed: float, seed: int
) -> None:
    network = town()
    corners: list[Place] = []
    for i, j in crossings:  # east first, then north; never straight back
        for corner in (
            ((120.0 * i, corners[-1][1]), (120.0 * i, 120.0 * j)) if corners else ((120.0 * i, 120.0 * j),)
        ):
            if not corners or corner != corners[-1]:
                corners.append(corner)
    if len(corners) < 2:
        return
    time, x, y = along(corners, speed, noise, seed)
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert len(match.breaks) == 0
    assert np.median(match.offset_m) < 2 * noise + 1e-6
    way = np.hypot(*np.diff(np.array(corners), axis=0).T).sum()
    assert match.length_m <= way + 10 * noise + 1e-6
    assert match.length_m >= way - 20 * (1 + noise) * len(corners)


def test_the_path_comes_in_order_with_times() -> None:
    network = town()
    time, x, y = along([(0, 0), (240, 0), (240, 240), (600, 240)])
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert nodes_of(network, match) == [0, 1, 2, 3, 4, 15, 26, 37, 48, 49, 50, 51, 52, 53, 54]
    np.testing.assert_allclose(match.enter_time_s, 6.0 * np.arange(14), atol=0.1)
    np.testing.assert_allclose(match.distance_m, np.minimum(10.0 * time, match.length_m), atol=1e-6)
    assert match.confidence.min() > 0.9


@given(st.integers(0, 2**31))
@settings(max_examples=10)
def test_reversed_in_time_the_path_is_reversed(seed: int) -> None:
    network = town()
    time, x, y = along([(10, 0), (240, 0), (240, 360), (470, 360)], noise=2.0, seed=seed)
    ahead = match_drive(network, time, x, y)
    back = match_drive(network, time, x[::-1].copy(), y[::-1].copy())
    assert back.segment[::-1].tolist() == ahead.segment.tolist()
    assert np.array_equal(back.forward[::-1], ~ahead.forward)


def test_one_way_streets_are_respected() -> None:
    """The right carriageway of a road is nearer to the noise; only the left one may be driven this way."""
    nodes = {0: (0.0, 0.0), 1: (500.0, 0.0), 2: (0.0, 12.0), 3: (500.0, 12.0)}
    network = roads(nodes, [([0, 1], 1), ([2, 3], -1)])
    time, x, y = along([(0, 8), (500, 8)])
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert network.table.osm_way_id[match.segment].tolist() == [0]


def test_u_turns_are_found_and_not_invented() -> None:
    network = roads({0: (0.0, 0.0), 1: (1000.0, 0.0)}, [([0, 1], 0)])
    time, x, y = along([(100, 0), (600, 0), (200, 0)])
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert match.forward.tolist() == [True, False]
    assert match.leave_m[0] == pytest.approx(600, abs=15)
    assert match.enter_m[1] == match.leave_m[0]
    assert match_drive(network, *along([(100, 0), (600, 0), (592, 0), (900, 0)], 4)).forward.tolist() == [
        True
    ]


def test_a_missing_road_is_a_break_and_no_detour() -> None:
    """Between two roads 400 m are missing; another way of 1,000 m joins them."""
    nodes = {
        0: (0.0, 0.0),
        1: (400.0, 0.0),
        2: (800.0, 0.0),
        3: (1200.0, 0.0),
        4: (400.0, 300.0),
        5: (800.0, 300.0),
    }
    network = roads(nodes, [([0, 1], 0), ([2, 3], 0), ([1, 4, 5, 2], 0)])
    time, x, y = along([(0, 0), (1200, 0)], noise=1.0)
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert set(network.table.osm_way_id[match.segment].tolist()) <= {0, 1, 2}
    assert match.run.max() == 1
    assert match.length_m < 950
    assert match.breaks[0].reason == "no road near"
    assert (match.traversal[(x > 460) & (x < 740)] == -1).all()


def test_a_gap_breaks_the_path_and_an_outage_in_a_tunnel_does_not() -> None:
    nodes = {0: (0.0, 0.0), 1: (500.0, 0.0), 2: (1600.0, 100.0), 3: (2100.0, 0.0)}
    network = roads(nodes, [([0, 1], 0), ([1, 2], 0), ([2, 3], 0)])
    time, x, y = along([nodes[i] for i in range(4)], speed=16.0)
    dark = (time > 35) & (time < 95)
    hidden = np.where(dark, np.nan, x), np.where(dark, np.nan, y)
    match = match_drive(network, time, *hidden)
    check(network, match, time, *hidden)
    assert match.segment.tolist() == [0, 1, 2]
    assert match.breaks == ()
    match = match_drive(network, time, *hidden, speed_mps=np.full(len(x), 16.0))
    assert match.segment.tolist() == [0, 1, 2]
    later = time + np.where(time > 60, 3600.0, 0.0)
    match = match_drive(network, later, *hidden)
    check(network, match, later, *hidden)
    assert match.run.max() == 1
    assert [b.reason for b in match.breaks] == ["outage of the recording"]


def test_parallel_carriageways_are_told_apart_by_where_they_lead() -> None:
    """The ramp runs 9 m beside the road; only the ramp leads away in the end, and the drive began before it."""
    nodes = {
        0: (0.0, 0.0),
        1: (200.0, 0.0),
        2: (1200.0, 0.0),
        3: (260.0, -9.0),
        4: (900.0, -9.0),
        5: (1100.0, -200.0),
    }
    network = roads(nodes, [([0, 1], 1), ([1, 2], 1), ([1, 3, 4, 5], 1)])
    time, x, y = along([nodes[0], nodes[1], (260.0, -3.0), (900.0, -3.0), nodes[4], nodes[5]], speed=15)
    ramp = match_drive(network, time, x, y)
    assert network.table.osm_way_id[ramp.segment].tolist() == [0, 2, 2, 2]
    time, x, y = along([nodes[0], nodes[1], (260.0, -6.0), (900.0, -6.0), (1200.0, 0.0)], speed=15)
    road = match_drive(network, time, x, y)
    assert network.table.osm_way_id[road.segment].tolist() == [0, 1]


def test_a_bridge_is_no_junction() -> None:
    """Two roads cross without a common node; samples lie nearer to the other one about the crossing."""
    nodes = {0: (-300.0, 0.0), 1: (300.0, 0.0), 2: (-300.0, -40.0), 3: (300.0, 40.0)}
    network = roads(nodes, [([0, 1], 0), ([2, 3], 0)])
    time, x, y = along([(-300, 0), (-40, 0), (0, 5), (40, 5), (80, 0), (300, 0)])
    match = match_drive(network, time, x, y)
    assert match.segment.tolist() == [0]


def test_standing_invents_nothing() -> None:
    network = town()
    rng = np.random.default_rng(3)
    _, x, y = along([(0, 0), (240, 0), (240, 130)])
    wander = np.cumsum(rng.normal(0, 1.0, (600, 2)), axis=0)
    wander *= 12.0 / np.abs(wander).max()
    x2, y2 = np.concatenate([x, x[-1] + wander[:, 0]]), np.concatenate([y, y[-1] + wander[:, 1]])
    _, x3, y3 = along([(240, 140), (240, 360)])
    x2, y2 = np.concatenate([x2, x3]), np.concatenate([y2, y3])
    time = np.arange(len(x2), dtype=float)
    match = match_drive(network, time, x2, y2)
    check(network, match, time, x2, y2)
    assert nodes_of(network, match) == [0, 1, 2, 3, 4, 15, 26, 37, 48, 59, 70]
    assert match.length_m == pytest.approx(600, abs=15)
    still = match_drive(network, np.arange(600.0), 240 + wander[:, 0], 100 + wander[:, 1])
    assert still.length_m < 30


def test_the_course_tells_the_direction_of_few_samples() -> None:
    network = roads({0: (0.0, 0.0), 1: (1000.0, 0.0)}, [([0, 1], 0)])
    for course, forward in ((0.1, True), (3.0, False)):
        match = match_drive(network, [0.0], [500.0], [2.0], heading_rad=[course], speed_mps=[10.0])
        assert match.forward.tolist() == [forward]
        assert match.confidence[0] > 0.6


def test_a_choice_between_equals_is_not_certain() -> None:
    """Two roads, the samples half way between them: nobody can tell, and the confidence says so."""
    nodes = {0: (0.0, 0.0), 1: (600.0, 0.0), 2: (0.0, 16.0), 3: (600.0, 16.0)}
    network = roads(nodes, [([0, 1], 1), ([2, 3], 1)])
    time, x, y = along([(50, 8), (550, 8)])
    assert match_drive(network, time, x, y).confidence.max() < 0.6
    assert match_drive(network, time, x, y - 8).confidence.min() > 0.9


def test_an_outlier_does_not_interrupt() -> None:
    network = town()
    time, x, y = along([(0, 0), (600, 0)])
    y[30] += 45.0
    x[31] += 900.0
    match = match_drive(network, time, x, y)
    check(network, match, time, x, y)
    assert nodes_of(network, match) == list(range(11))
    assert match.traversal[31] == -1


@pytest.mark.parametrize("step", [1, 3, 10, 30])
def test_low_rates(step: int) -> None:
    network = town()
    time, x, y = along([(0, 0), (240, 0), (240, 360), (600, 360), (600, 600)], speed=10, noise=2.0)
    match = match_drive(network, time[::step], x[::step], y[::step])
    check(network, match, time[::step], x[::step], y[::step])
    assert match.run.max() == 0
    assert match.length_m == pytest.approx(np.ptp(time[::step]) * 10, abs=30)


def test_high_rate_samples_are_all_placed() -> None:
    network = town()
    time, x, y = along([(0, 0), (240, 0), (240, 240)], speed=0.1, noise=0.5)
    match = match_drive(network, time / 100, x, y)
    check(network, match, time / 100, x, y)
    assert nodes_of(network, match) == [0, 1, 2, 3, 4, 15, 26, 37, 48]
    assert (match.traversal >= 0).all()
    assert np.abs(match.distance_m - 0.1 * time).max() < 10


def test_nothing_to_match() -> None:
    network = town()
    for x in (np.array([]), np.array([np.nan]), np.array([np.nan, np.nan])):
        match = match_drive(network, np.arange(float(len(x))), x, x)
        check(network, match, np.arange(float(len(x))), x, x)
        assert len(match) == 0
        assert match.breaks == ()
        assert match.position_on([0.0])[0].tolist() == [-1]
    empty = RoadNetwork.project(RoadTable.empty(), PLANE)
    time, x, y = along([(0, 0), (100, 0)])
    for where, away in ((empty, 0.0), (network, 5000.0)):
        match = match_drive(where, time, x + away, y)
        assert (match.traversal == -1).all()
        assert [b.reason for b in match.breaks] == ["no road near"]


def test_one_sample() -> None:
    network = town()
    match = match_drive(network, [5.0], [30.0], [3.0])
    check(network, match, np.array([5.0]), np.array([30.0]), np.array([3.0]))
    assert match.traversal.tolist() == [0]
    assert match.offset_m[0] == pytest.approx(3.0)
    assert match.enter_time_s[0] == match.leave_time_s[0] == 5.0


def test_bad_columns_are_refused() -> None:
    matcher = DriveMatcher(town(), MatchOptions(sigma_m=5.0))
    for time, x, why in (([0, 1], [0], "length"), ([1, 0], [0, 1], "fall"), ([np.nan, 0], [0, 1], "known")):
        with pytest.raises(ValueError, match=why):
            matcher.match(time, x, x)
