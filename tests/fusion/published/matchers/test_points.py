"""The survey's matchers: the thesis's own figures, and one contract for all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.published.matchers import MATCHERS
from fusion.published.matchers.base import PointMatches
from fusion.published.matchers.curve import CurveToCurve
from fusion.published.matchers.geometric import PointToPoint, PointToSegment
from fusion.published.matchers.topological import Topological
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from matcher_support import PLANE, connected, matched

MakeNetwork = Callable[..., RoadNetwork]
COORDINATES = st.floats(-200, 200).map(lambda v: round(v, 2))
ENDS = hnp.arrays(float, st.tuples(st.integers(1, 20), st.just(4)), elements=COORDINATES)


# --- the figures of the thesis ---


def test_figure_1_16_the_nearest_node_may_belong_to_another_road() -> None:
    """The position lies beside [A0, A1], but B1 is the nearest node."""
    network = connected([[0, 0], [200, 0], [100, 150], [100, 40]], [[0, 1], [2, 3]])
    by_node = matched(PointToPoint(), network, [100, 10])
    assert (by_node.segment[0], by_node.x_m[0], by_node.y_m[0]) == (1, 100, 40)  # B1
    by_segment = matched(PointToSegment(), network, [100, 10])
    assert (by_segment.segment[0], by_segment.x_m[0], by_segment.y_m[0]) == (0, 100, 0)


def test_figure_1_17_a_curve_is_not_led_astray_by_one_position() -> None:
    """GPS1, GPS3 and GPS4 lie at S2, GPS2 at S1, a road beside it."""
    network = connected([[0, 20], [200, 20], [0, 0], [200, 0]], [[0, 1], [2, 3]])
    positions = [[40, 4], [80, 12], [120, 3], [160, 2]]
    assert matched(PointToSegment(), network, positions).segment.tolist() == [1, 0, 1, 1]
    assert matched(CurveToCurve(), network, positions).segment.tolist() == [1, 1, 1, 1]


def fork() -> tuple[RoadNetwork, np.ndarray]:
    """Figure 1.18: S1 goes on from the start, S3 runs beside it at the end of the long S2; P0, GPS1 to GPS4."""
    nodes = [[-150, 0], [0, 0], [400, 0], [0, 300], [50, 300], [50, 15], [400, 15]]
    network = connected(nodes, [[0, 1], [1, 2], [1, 3], [3, 4], [4, 5], [5, 6]])
    return network, np.array([[-50, 1], [30, 5], [90, 9], [140, 10], [190, 9], [240, 10]], float)


@pytest.mark.parametrize("name", ["point-to-segment", "segment-direction", "mahalanobis"])
def test_figure_1_18_geometry_takes_the_nearer_road(name: str) -> None:
    network, positions = fork()
    assert matched(MATCHERS[name], network, positions, 0.0).segment[2:].tolist() == [5, 5, 5, 5]


def test_figure_1_18_topology_takes_the_road_that_can_have_been_reached() -> None:
    network, positions = fork()
    found = matched(Topological(), network, positions, 0.0)
    assert found.segment.tolist() == [0, 1, 1, 1, 1, 1]
    assert found.forward.all()
    # Had the way over S2 been short enough, S3 it would be.
    assert matched(Topological(slack_m=700.0), network, positions, 0.0).segment[-1] == 5


# --- what every matcher keeps to ---


def check(network: RoadNetwork, found: PointMatches) -> None:
    """Matches lie on their segments, which are driven as they may be; the others are empty."""
    on = found.segment >= 0
    for column in (found.x_m, found.y_m, found.distance_m, found.heading_rad):
        assert np.array_equal(np.isfinite(column), on)
    assert not found.forward[~on].any()
    s, forward = found.segment[on], found.forward[on]
    x, y, along, offset = network.project_points(found.x_m[on], found.y_m[on], s)
    assert offset == pytest.approx(0, abs=1e-6)
    assert found.distance_m[on] == pytest.approx(along, abs=1e-6)
    assert (found.x_m[on], found.y_m[on]) == (pytest.approx(x, abs=1e-6), pytest.approx(y, abs=1e-6))
    turned = network.heading_rad[s] + np.where(forward, 0, np.pi) - found.heading_rad[on]
    assert np.angle(np.exp(1j * turned)) == pytest.approx(0, abs=1e-9)
    assert np.all((found.heading_rad[on] > -np.pi) & (found.heading_rad[on] <= np.pi))
    assert np.all(np.where(forward, network.table.oneway[s] >= 0, network.table.oneway[s] <= 0))


@pytest.mark.parametrize("name", MATCHERS)
def test_a_matcher_says_what_it_is(name: str) -> None:
    matcher = MATCHERS[name]
    assert matcher.name == name
    assert matcher.description
    assert matcher.source


@pytest.mark.parametrize("name", MATCHERS)
@pytest.mark.parametrize("heading_known", [False, True])
def test_a_straight_drive_is_matched(name: str, heading_known: bool) -> None:
    network = connected([[0, 0], [50, 0], [100, 0], [150, 0]], [[0, 1], [2, 1], [2, 3]])
    positions = np.column_stack([np.arange(8, 145, 14.0), np.full(10, 2.0)])
    found = matched(MATCHERS[name], network, positions, 0.0 if heading_known else np.nan)
    check(network, found)
    assert np.all(np.abs(found.x_m - positions[:, 0]) <= (25 if name == "point-to-point" else 1e-9))
    assert np.all(np.diff(found.segment) >= 0)
    assert set(found.segment.tolist()) == {0, 1, 2}


@pytest.mark.parametrize("name", MATCHERS)
@settings(max_examples=40)
@given(
    ends=ENDS,
    rows=hnp.arrays(float, st.tuples(st.integers(0, 12), st.just(3)), elements=COORDINATES),
    holes=st.sets(st.integers(0, 11)),
    data=st.data(),
)
def test_any_positions_on_any_network(
    make_network: MakeNetwork,
    name: str,
    ends: np.ndarray,
    rows: np.ndarray,
    holes: set[int],
    data: st.DataObject,
) -> None:
    ends[-1, 2:] = ends[-1, :2]  # a segment of no length
    oneway = data.draw(hnp.arrays(np.int8, len(ends), elements=st.sampled_from([-1, 0, 1])))
    network = make_network(ends, oneway)
    gone = [k for k in holes if k < len(rows)]
    rows[gone, len(holes) % 2] = np.nan
    found = matched(MATCHERS[name], network, rows[:, :2], rows[:, 2])
    check(network, found)
    assert np.all(found.segment[gone] == -1)


@pytest.mark.parametrize("name", MATCHERS)
def test_positions_that_are_unknown_or_absurd_harm_no_others(name: str) -> None:
    network = connected([[0, 0], [100, 0], [200, 0]], [[0, 1], [1, 2]])
    clean = np.column_stack([np.arange(5, 200, 15.0), np.full(13, 1.0)])
    wild = clean.copy()
    wild[2] = np.nan
    wild[5] = np.inf, 0
    wild[6] = 0, np.nan
    found = matched(MATCHERS[name], network, wild, 0.0)
    check(network, found)
    lost = [2, 5, 6]
    assert np.all(found.segment[lost] == -1)
    kept = np.delete(np.arange(13), lost)
    assert np.array_equal(found.segment[kept], matched(MATCHERS[name], network, clean, 0.0).segment[kept])
    far = matched(MATCHERS[name], network, [[1e7, 1e7], [-1e200, 1e200]], 0.0)
    check(network, far)


@pytest.mark.parametrize("name", MATCHERS)
def test_nothing_to_match_or_nothing_to_match_with(name: str) -> None:
    nothing = matched(MATCHERS[name], connected([[0, 0], [9, 0]], [[0, 1]]), [])
    assert len(nothing.segment) == len(nothing.x_m) == len(nothing.forward) == 0
    empty = RoadNetwork.project(RoadTable.empty(), PLANE)
    found = matched(MATCHERS[name], empty, [[0, 0], [5, 5]], 0.0)
    assert found.segment.tolist() == [-1, -1]
    check(empty, found)


@pytest.mark.parametrize("name", MATCHERS)
def test_columns_that_do_not_fit_are_refused(name: str) -> None:
    network = connected([[0, 0], [9, 0]], [[0, 1]])
    three, two = np.arange(3.0), np.arange(2.0)
    with pytest.raises(ValueError, match="one length"):
        MATCHERS[name].match(network, three, three, two, three)
    for times in ([0, 2, 1], [0, np.nan, 1]):
        with pytest.raises(ValueError, match="times"):
            MATCHERS[name].match(network, times, three, three, three)


@pytest.mark.parametrize("name", MATCHERS)
def test_a_prepared_network_serves_many_drives(name: str) -> None:
    network, positions = fork()
    matching = MATCHERS[name].on(network)
    for drive in (positions, positions[::-1], positions):
        again = matching(2.0 * np.arange(len(drive)), *drive.T, np.zeros(len(drive)))  # type: ignore[call-arg]
        assert np.array_equal(again.segment, matched(MATCHERS[name], network, drive, 0.0).segment)
        assert np.array_equal(
            again.distance_m, matched(MATCHERS[name], network, drive, 0.0).distance_m, equal_nan=True
        )
