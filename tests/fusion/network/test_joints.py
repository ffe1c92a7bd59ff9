"""How the grade goes on at nodes of small hand-made networks."""

from __future__ import annotations

import numpy as np
import pytest

from factor_support import roads, street
from fusion.network.joints import (
    JUNCTION_SIGMA,
    JUNCTION_TURN_SIGMA,
    MAX_ARMS,
    PLAIN_SIGMA,
    STRUCTURE_SIGMA,
    TURN_SIGMA,
    couplings,
    grade_change_sigma,
)
from fusion.roads.table import RoadTable

Pairs = dict[frozenset[tuple[int, bool]], float]


def pairs(table: RoadTable) -> Pairs:
    """Sigma by pair of ends (row, whether it is the to_node)."""
    c = couplings(table)
    ends = zip(c.row_a.tolist(), c.end_a.tolist(), c.row_b.tolist(), c.end_b.tolist(), strict=True)
    found = [frozenset([(a, at_a), (b, at_b)]) for a, at_a, b, at_b in ends]
    assert len(set(found)) == len(found), "a pair is coupled twice"
    assert all(len(pair) == 2 for pair in found), "an end is coupled with itself"
    return dict(zip(found, c.sigma.tolist(), strict=True))


def pair(a: tuple[int, bool], b: tuple[int, bool]) -> frozenset[tuple[int, bool]]:
    return frozenset([a, b])


def test_a_street_goes_on_from_end_to_start() -> None:
    found = pairs(street(30.0, 40.0, 50.0))
    assert found.keys() == {pair((0, True), (1, False)), pair((1, True), (2, False))}
    assert list(found.values()) == pytest.approx([PLAIN_SIGMA] * 2, rel=1e-3)


def test_whichever_way_the_segments_are_drawn() -> None:
    points = {0: (0.0, 0.0), 1: (50.0, 0.0), 2: (100.0, 0.0), 3: (150.0, 0.0)}
    found = pairs(roads(points, [(1, 0), (1, 2), (3, 2)]))
    assert found.keys() == {pair((0, False), (1, False)), pair((1, True), (2, True))}
    assert list(found.values()) == pytest.approx([PLAIN_SIGMA] * 2, rel=1e-3)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 90.0, 135.0, 180.0])
def test_the_sharper_the_turn_the_less_is_known(turn_deg: float) -> None:
    angle = np.radians(turn_deg)
    points = {0: (-50.0, 0.0), 1: (0.0, 0.0), 2: (50 * np.cos(angle), 50 * np.sin(angle))}
    (sigma,) = pairs(roads(points, [(0, 1), (1, 2)])).values()
    assert sigma == pytest.approx(np.hypot(PLAIN_SIGMA, TURN_SIGMA * (1 - np.cos(angle))), rel=0.01)


def test_at_a_junction_every_pair_of_arms_is_coupled_by_its_own_angle() -> None:
    points = {0: (0.0, 0.0), 1: (-60.0, 0.0), 2: (60.0, 0.0), 3: (0.0, 60.0)}
    found = pairs(roads(points, [(1, 0), (0, 2), (0, 3)]))
    straight, turn = JUNCTION_SIGMA, np.hypot(JUNCTION_SIGMA, JUNCTION_TURN_SIGMA)
    assert found == pytest.approx(
        {
            pair((0, True), (1, False)): straight,
            pair((0, True), (2, False)): turn,
            pair((1, False), (2, False)): turn,
        },
        rel=1e-3,
    )


def test_roads_that_cross_without_a_common_node_know_nothing_of_each_other() -> None:
    points = {0: (-50.0, 0.0), 1: (50.0, 0.0), 2: (0.0, -50.0), 3: (0.0, 50.0)}
    assert pairs(roads(points, [(0, 1), (2, 3)], layer=[0, 1], bridge=[False, True])) == {}


@pytest.mark.parametrize("arms", [2, 5, MAX_ARMS, MAX_ARMS + 4])
def test_a_node_of_many_arms(arms: int) -> None:
    """Every pair up to the limit; beyond it still every arm, and every arm with many."""
    angle = 2 * np.pi * np.arange(arms) / arms
    points = {0: (0.0, 0.0)} | {k + 1: (40 * np.cos(a), 40 * np.sin(a)) for k, a in enumerate(angle.tolist())}
    found = pairs(roads(points, [(0, k + 1) for k in range(arms)]))
    degree = np.bincount([row for one in found for row, _ in one], minlength=arms)
    if arms <= MAX_ARMS:
        assert len(found) == arms * (arms - 1) // 2
    else:
        assert len(found) < arms * (arms - 1) // 2
        assert degree.min() >= MAX_ARMS - 1


def test_a_loop_way_couples_at_both_of_its_nodes() -> None:
    """Two roads between the same two nodes: coupled at either end, not mixed up."""
    points = {0: (0.0, 0.0), 1: (60.0, 0.0)}
    assert pairs(roads(points, [(0, 1), (1, 0)])).keys() == {
        pair((0, False), (1, True)),
        pair((0, True), (1, False)),
    }


def test_directions_are_true_to_angle_far_north() -> None:
    """In degrees, a street to the north-east is not at 45: longitudes are short there."""
    table = street(40.0, 40.0)
    step = 40.0 / 111_000
    for bend in (0.0, 90.0):
        lat = np.array([69.0, 69.0 + step, 69.0 + step * (1 + np.cos(np.radians(bend)))])
        lon = np.array([18.0, 18.0, 18.0 + step * np.sin(np.radians(bend)) / np.cos(np.radians(69.0))])
        bent = RoadTable.from_columns(
            **{c: getattr(table, c) for c in RoadTable.columns()}
            | {"lat0_deg": lat[:2], "lat1_deg": lat[1:], "lon0_deg": lon[:2], "lon1_deg": lon[1:]}
        )
        expected = np.hypot(PLAIN_SIGMA, TURN_SIGMA * (1 - np.cos(np.radians(bend))))
        assert list(pairs(bent).values()) == pytest.approx([expected], rel=1e-2)


def test_nothing_and_one_segment_have_no_couplings() -> None:
    assert pairs(RoadTable.empty()) == pairs(street(30.0)) == {}


def test_sigma_grows_with_the_turn_and_with_the_arms() -> None:
    cosine = np.linspace(1.0, -1.0, 21)
    plain, junction = (grade_change_sigma(cosine, np.full(21, arms), np.zeros(21, bool)) for arms in (2, 3))
    assert np.all(np.diff(plain) > 0)
    assert np.all(np.diff(junction) > 0)
    assert np.all(junction > plain)


@pytest.mark.parametrize("kind", ["bridge", "tunnel"])
def test_where_a_structure_begins_or_ends_the_grade_may_change_more(kind: str) -> None:
    found = pairs(street(30.0, 40.0, 50.0, 20.0, **{kind: [False, True, True, False]}))
    ramp = np.hypot(PLAIN_SIGMA, STRUCTURE_SIGMA)
    assert [found[pair((k, True), (k + 1, False))] for k in range(3)] == pytest.approx(
        [ramp, PLAIN_SIGMA, ramp], rel=1e-3
    )


def test_from_a_bridge_into_a_tunnel_is_a_change_as_well() -> None:
    (sigma,) = pairs(street(30.0, 40.0, bridge=[True, False], tunnel=[False, True])).values()
    assert sigma == pytest.approx(np.hypot(PLAIN_SIGMA, STRUCTURE_SIGMA), rel=1e-3)
