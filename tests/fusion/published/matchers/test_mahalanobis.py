"""The Mahalanobis nearest segment, against a plain numpy search over all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fusion.published.matchers.base import PointMatches
from fusion.published.matchers.mahalanobis import GATE, Mahalanobis, match_points, nearest_mahalanobis
from fusion.roads.network import RoadNetwork

MakeNetwork = Callable[..., RoadNetwork]
COORDINATES = st.floats(-200, 200).map(lambda v: round(v, 2))
ENDS = hnp.arrays(float, st.tuples(st.integers(1, 20), st.just(4)), elements=COORDINATES)
ANGLES = st.floats(-10, 10)


@st.composite
def covariances(draw: st.DrawFn) -> np.ndarray:
    """Positive definite, from 1 to 60 m and 0.05 to 1.5 rad, correlated."""
    root = np.diag([draw(st.floats(1, 60)), draw(st.floats(1, 60)), draw(st.floats(0.05, 1.5))])
    mix = np.eye(3)
    mix[1, 0], mix[2, 0], mix[2, 1] = (draw(st.floats(-0.8, 0.8)) for _ in range(3))
    mix /= np.linalg.norm(mix, axis=1, keepdims=True)
    return root @ mix @ mix.T @ root


def wrapped(angle: np.ndarray) -> np.ndarray:
    return np.angle(np.exp(1j * angle))


def all_distances(
    network: RoadNetwork, x: float, y: float, heading: float, covariance: np.ndarray
) -> np.ndarray:
    """Mahalanobis distances, shape (n, 2): forward, backward; inf where not allowed."""
    s = np.arange(len(network))
    px, py, _, _ = network.project_points(x, y, s)
    out = np.full((len(s), 2), np.inf)
    for turn in range(2):
        angle = wrapped(network.heading_rad + turn * np.pi - heading)
        z = np.stack([px - x, py - y, angle], axis=1)
        if np.isnan(heading):
            z = z[:, :2]
        c = covariance[: z.shape[1], : z.shape[1]]
        d = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", z, np.linalg.inv(c), z), 0))
        allowed = network.table.oneway >= 0 if turn == 0 else network.table.oneway <= 0
        out[:, turn] = np.where(allowed, d, np.inf)
    return out


@given(ENDS, COORDINATES, COORDINATES, ANGLES, covariances(), st.booleans(), st.data())
def test_equals_a_search_over_all_segments(
    make_network: MakeNetwork,
    ends: np.ndarray,
    x: float,
    y: float,
    heading: float,
    covariance: np.ndarray,
    known: bool,
    data: st.DataObject,
) -> None:
    oneway = np.array(
        data.draw(st.lists(st.sampled_from([-1, 0, 1]), min_size=len(ends), max_size=len(ends)))
    )
    network = make_network(ends, oneway)
    heading = heading if known else np.nan
    expected = all_distances(network, x, y, heading, covariance)
    least = float(expected.min())
    assume(abs(least - GATE) > 1e-6)
    match = nearest_mahalanobis(network, x, y, heading, covariance)
    if least > GATE:
        assert match is None
        return
    assert match is not None
    assert match.mahalanobis == pytest.approx(least, abs=1e-6)
    assert expected[match.segment, 0 if match.forward else 1] == pytest.approx(least, abs=1e-6)
    px, py, along, _ = network.project_points(x, y, match.segment)
    assert (match.x_m, match.y_m, match.distance_m) == pytest.approx((px, py, along), abs=1e-9)
    turned = network.heading_rad[match.segment] + (0 if match.forward else np.pi)
    assert abs(wrapped(np.array(match.heading_rad - turned))) < 1e-9
    assert -np.pi < match.heading_rad <= np.pi


C = np.diag([25.0, 25.0, 0.1])


def test_the_gate_is_on_d_and_not_on_its_square(make_network: MakeNetwork) -> None:
    network = make_network([[0, 0, 100, 0]])
    inside = nearest_mahalanobis(network, 50.0, 5 * 2.54, 0.0, C)
    assert inside is not None
    assert inside.mahalanobis == pytest.approx(2.54)
    assert nearest_mahalanobis(network, 50.0, 5 * 2.56, 0.0, C) is None
    assert nearest_mahalanobis(network, 50.0, 5 * 2.56, 0.0, C, gate=2.6) is not None


def test_the_search_reaches_as_far_as_the_gate_in_the_least_certain_direction(
    make_network: MakeNetwork,
) -> None:
    network = make_network([[0, 0, 1000, 0]])
    c = np.diag([1.0, 3600.0, 0.1])
    found = nearest_mahalanobis(network, 500.0, 150.0, 0.0, c)
    assert found is not None
    assert found.mahalanobis == pytest.approx(2.5)
    turned = nearest_mahalanobis(
        make_network([[0, 0, 0, 1000]]), 150.0, 500.0, np.pi / 2, c[[1, 0, 2]][:, [1, 0, 2]]
    )
    assert turned is not None
    assert turned.mahalanobis == pytest.approx(2.5)


def test_a_one_way_is_matched_in_its_direction_only(make_network: MakeNetwork) -> None:
    ends = [[0, 0, 100, 0]]
    for oneway, heading, forward in [(1, 0.0, True), (-1, np.pi, False), (0, 0.0, True), (0, np.pi, False)]:
        match = nearest_mahalanobis(make_network(ends, oneway), 50.0, 1.0, heading, C)
        assert match is not None
        assert match.forward is forward
    for oneway, heading in [(1, np.pi), (-1, 0.0)]:
        assert nearest_mahalanobis(make_network(ends, oneway), 50.0, 1.0, heading, C) is None


def test_headings_wrap_at_the_turn(make_network: MakeNetwork) -> None:
    network = make_network([[100, 0, 0, -1]], 1)  # heads just short of -pi
    match = nearest_mahalanobis(network, 50.0, -0.5, np.pi - 0.01, C)
    assert match is not None
    assert match.mahalanobis < 0.1


def test_direction_chooses_between_crossing_roads(make_network: MakeNetwork) -> None:
    network = make_network([[-100, 0, 100, 0], [0, -100, 0, 100]])
    for heading, segment in [(0.1, 0), (np.pi / 2 - 0.1, 1), (-np.pi / 2, 1), (np.pi, 0)]:
        match = nearest_mahalanobis(network, 1.0, 1.0, heading, C)
        assert match is not None
        assert match.segment == segment


def test_a_heading_may_be_unknown(make_network: MakeNetwork) -> None:
    network = make_network([[-100, 0, 100, 0], [3, -100, 3, 100]])
    along = nearest_mahalanobis(network, 0.0, 2.5, np.pi / 2, C)
    assert along is not None
    assert along.segment == 1
    still = nearest_mahalanobis(network, 0.0, 2.5, np.nan, C)
    assert still is not None
    assert still.segment == 0
    assert still.forward
    assert still.mahalanobis == pytest.approx(0.5)


def test_an_unknown_position_matches_nothing(make_network: MakeNetwork) -> None:
    network = make_network([[0, 0, 100, 0]])
    assert nearest_mahalanobis(network, np.nan, 0.0, 0.0, C) is None
    assert nearest_mahalanobis(network, np.inf, 0.0, 0.0, C) is None


@pytest.mark.parametrize("diagonal", [[0, 1, 1], [1, -1, 1], [1, 1, 0], [np.nan, 1, 1], [np.inf, 1, 1]])
def test_a_covariance_must_be_positive_definite(make_network: MakeNetwork, diagonal: list[float]) -> None:
    network = make_network([[0, 0, 100, 0]])
    with pytest.raises(ValueError, match="positive definite"):
        nearest_mahalanobis(network, 0.0, 0.0, 0.0, np.diag(diagonal))
    with pytest.raises(ValueError, match="positive definite"):
        match_points(network, [0.0], [0.0], [0.0], np.diag(diagonal))


@given(ENDS, hnp.arrays(float, (6, 3), elements=COORDINATES), st.booleans())
def test_match_points_is_the_match_of_each_point(
    make_network: MakeNetwork, ends: np.ndarray, points: np.ndarray, each: bool
) -> None:
    network = make_network(ends)
    x, y, heading = points[:, 0], points[:, 1], np.where(np.arange(6) == 2, np.nan, points[:, 2])
    covariance = np.array([C * (1 + k) for k in range(6)]) if each else C
    found = match_points(network, x, y, heading, covariance)
    for k in range(6):
        one = nearest_mahalanobis(network, x[k], y[k], heading[k], covariance[k] if each else C)
        if one is None:
            assert found.segment[k] == -1
            assert np.isnan(found.mahalanobis[k])
            assert np.isnan(found.x_m[k])
        else:
            assert found.segment[k] == one.segment
            assert found.forward[k] == one.forward
            assert (found.x_m[k], found.y_m[k], found.distance_m[k]) == (one.x_m, one.y_m, one.distance_m)
            assert (found.heading_rad[k], found.mahalanobis[k]) == (one.heading_rad, one.mahalanobis)


def test_match_points_broadcasts(make_network: MakeNetwork) -> None:
    network = make_network([[0, 0, 100, 0]])
    found = match_points(network, np.linspace(0, 90, 4), 1.0, np.nan, C)
    assert found.segment.tolist() == [0, 0, 0, 0]
    assert found.distance_m == pytest.approx([0, 30, 60, 90])
    assert len(match_points(network, [], [], [], C).segment) == 0


@given(ENDS, hnp.arrays(float, (6, 3), elements=COORDINATES))
def test_mahalanobis_is_the_thesis_s_rule(
    make_network: MakeNetwork, ends: np.ndarray, points: np.ndarray
) -> None:
    network, (x, y, heading) = make_network(ends), points.T
    found = Mahalanobis(sigma_m=10.0, sigma_rad=0.3).match(network, np.arange(6), x, y, heading)
    expected = match_points(network, x, y, heading, np.diag([100.0, 100.0, 0.09]))
    for name in PointMatches.__dataclass_fields__:
        assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=True)
