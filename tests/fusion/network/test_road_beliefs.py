"""What is believed of roads: how rough they are, that their ends meet, and that neither holds everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from factor_support import Sensors, driven, graded, roads, steady, street
from fusion.network.adjust import adjust
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.equations import EquationSystem
from fusion.network.pass_columns import PassColumns
from fusion.network.pass_factor import PassFactor
from fusion.network.road_beliefs import (
    DEFAULT_ROUGHNESS,
    LEVEL_SIGMA_M,
    NODE_SIGMA_M,
    ROUGHNESS_BOUNDS,
    ROUGHNESS_FREEDOM,
    UNSEEN_VARIANCE,
    RoadBeliefs,
)
from fusion.roads.table import RoadTable

PRECISE = Sensors(0.002, pressure_m=0.02, walk_m2_per_s=(0.1, 1e-4))


def learned(road: RoadBeliefs, passes: list[PassFactor], rounds: int = 4) -> np.ndarray:
    """Let roads learn from the passes of one drive; the last solution."""
    said = DriveBeliefs(PassColumns.of({0: passes}), road.unknowns, passes)
    system = EquationSystem(said.size, [*road.blocks(), *said.blocks()], np.array([], np.int64))
    for _ in range(rounds):
        solution = system.solve()
        road.learn(solution)
    return np.asarray(solution.x)


def flat(at: np.ndarray) -> np.ndarray:
    return 0.0 * at


def walk_street(seed: int, roughness: float, count: int = 60) -> tuple[RoadTable, np.ndarray, np.ndarray]:
    """A street whose grade is a random walk, and its heights at places 0.25 m apart."""
    rng = np.random.default_rng(seed)
    table = street(*rng.uniform(20.0, 60.0, count).tolist())
    at = np.arange(-5.0, float(table.length_m.sum()) + 5.0, 0.25)
    grade = np.cumsum(np.sqrt(0.25 * roughness) * rng.normal(size=len(at)))
    return table, at, 100 + 0.25 * np.cumsum(grade)


def test_the_usual_roughness_begins_with_what_drives_learned() -> None:
    table = street(40.0, 50.0)

    def usual(*values: float) -> float:
        passes = [steady(table, 0, 1.0, roughness=v, sequence=k) for k, v in enumerate(values)]
        return float(RoadBeliefs(table, PassColumns.of({0: passes})).usual[0])

    assert usual() == pytest.approx(DEFAULT_ROUGHNESS)
    assert usual(1e-5, 1e-4, 1e-3) == pytest.approx(1e-4)
    assert usual(1e-9) == ROUGHNESS_BOUNDS[0]
    assert usual(1.0) == ROUGHNESS_BOUNDS[1]


@pytest.mark.parametrize("roughness", [3e-6, 3e-5, 3e-4])
def test_the_roughness_of_roads_is_learned(roughness: float) -> None:
    """From where drives began three times too low, well-measured roads lead to what they are."""
    table, at, height = walk_street(1, roughness)
    edge = np.concatenate([[0.0], np.cumsum(table.length_m)])
    rng = np.random.default_rng(2)
    passes = driven(
        table, range(len(table)), lambda row, x: np.interp(edge[row] + x, at, height), PRECISE, rng
    )
    road = RoadBeliefs(table, PassColumns.of({0: [replace(p, roughness=roughness / 3) for p in passes]}))
    learned(road, passes)
    # The scale of a Student's t of three degrees of freedom that is fitted to Gaussian steps is smaller than theirs.
    assert 0.4 < np.median(road.usual) / roughness < 1.5


def test_one_rough_interval_does_not_make_the_others_rough() -> None:
    """A kink in an even road: the walk gives way there, and there alone."""
    table = street(*[20.0] * 12)
    passes = [
        graded(
            table, row, lambda at, r=row: np.where(r < 6, 0.0, 0.01) + 0.01 * (r == 6) * at / 2, 0.003, sequence=row
        )  # type: ignore[misc]
        for row in range(12)
    ]  # fmt: skip
    road = RoadBeliefs(table, PassColumns.of({0: passes}))
    learned(road, passes)
    weights = road.roughness.weight
    assert weights[6] < 0.2 * np.median(weights)
    assert np.delete(weights, [5, 6, 7]).min() > 0.5 * np.median(weights)


def test_ends_meet_at_a_node_and_one_that_does_not_is_let_go() -> None:
    """Maps join what does not meet: a node whose roads lie 3 m apart leaves the others as they are."""
    table = street(40.0, 40.0, 40.0, 40.0)
    rng = np.random.default_rng(3)
    sensors = replace(PRECISE, walk_m2_per_s=(0.1, 1e-6))
    passes = driven(table, range(4), lambda row, at: np.where(row < 2, 100.0, 103.0) + 0 * at, sensors, rng)
    road = RoadBeliefs(table, PassColumns.of({0: passes}))
    x = learned(road, passes, 6)
    u = road.unknowns
    rows = np.arange(4)
    gap = x[u.first[1:]] - x[u.end(rows, np.ones(4, bool))][:-1]
    assert gap[1] > 2.5
    assert np.abs(gap[[0, 2]]).max() < NODE_SIGMA_M
    # One tie at either side of the node: the ends of row 1 and the start of row 2.
    weight = road.ties.weight
    assert min(weight[2], weight[4 + 1]) < 0.1
    assert np.delete(weight, [2, 5]).min() > 0.9


def test_a_network_of_nothing_driven_is_flat_and_unsure() -> None:
    table = street(40.0, 60.0)
    found = adjust(table, {0: [steady(table, 0, 2.0, 0.5)]})
    assert found.slope_sigma_percent[1] > 3.0
    assert abs(found.slope_percent[1]) < 2.0


def test_intervals_are_open_where_no_pass_goes() -> None:
    """Before the first and behind the last place that any pass reaches; what lies between two passes is not."""
    table = street(80.0, 80.0, 40.0, 15.0)
    passes = [
        graded(table, 0, flat, 0.01, part=(42.0, 55.0)),
        graded(table, 1, flat, 0.01, part=(5.0, 15.0), sequence=1),
        graded(table, 1, flat, 0.01, part=(48.0, 52.0), sequence=2),
        steady(table, 3, 0.0, sequence=3),
    ]
    road = RoadBeliefs(table, PassColumns.of({0: passes}))
    learned(road, passes, 1)
    opened: dict[int, tuple[bool, ...]] = dict.fromkeys(range(4), ())
    one = road.roughness
    rows = np.searchsorted(road.unknowns.first, one.variables[:, 0], side="right") - 1
    for row, weight in zip(rows.tolist(), one.weight.tolist(), strict=True):
        nobody = weight == pytest.approx(1 / (UNSEEN_VARIANCE * road.usual[row]), rel=1e-12)
        opened[row] += (bool(nobody),)
    assert opened == {
        0: (True, True, False, True),
        1: (False, False, False, True),
        2: (True, True),
        3: (False,),
    }


def test_what_nobody_drove_is_as_rough_as_any_road_may_be() -> None:
    """Its grade may change as Student's t says, whose variance is three times the scale's square."""
    assert pytest.approx(stats.t(ROUGHNESS_FREEDOM).var()) == UNSEEN_VARIANCE
    table, at, height = walk_street(4, 3e-5, 30)
    edge = np.concatenate([[0.0], np.cumsum(table.length_m)])
    rows = [row for row in range(30) if row % 10 < 7]
    rng = np.random.default_rng(5)
    passes = driven(table, rows, lambda row, x: np.interp(edge[row] + x, at, height), PRECISE, rng)
    road = RoadBeliefs(table, PassColumns.of({0: passes}))
    learned(road, passes)
    one = road.roughness
    row = np.searchsorted(road.unknowns.first, one.variables[:, 0], side="right") - 1
    even = one.weight * road.usual[row]
    assert min(even) <= 1 / UNSEEN_VARIANCE * (1 + 1e-12)
    assert np.median(even) > 1 / UNSEEN_VARIANCE


def test_heights_are_believed_about_where_they_were_found() -> None:
    """The first guess of all heights is 0; from the second round on it is the solution before."""
    table = street(40.0, 50.0)
    rng = np.random.default_rng(1)
    sensors = Sensors(0.01, altitude_m=0.2)
    passes = driven(table, (0, 1), lambda row, at: 2000.0 + 0.0 * at, sensors, rng)
    road = RoadBeliefs(table, PassColumns.of({0: passes}))
    assert not road.levels.vector.any()
    x = learned(road, passes, 3)
    assert road.levels.vector[:, 0] == pytest.approx(x[road.levels.variables[:, 0]], rel=1e-12)
    # All knots of what hangs together share what is known of its height.
    assert road.levels.weight.sum() == pytest.approx(LEVEL_SIGMA_M**-2)


def test_a_class_of_roads_that_is_rougher_than_the_others_is_known_for_it() -> None:
    """Two streets side by side; the last track is not driven, and is taken for one like the others."""
    n = 40
    even, at, height = walk_street(4, 1e-6, n)
    _, rough_at, rough = walk_street(5, 1e-4, n)
    edge = np.concatenate([[0.0], np.cumsum(even.length_m)])
    points = {k + (n + 1) * side: (float(x), 30.0 * side) for side in (0, 1) for k, x in enumerate(edge)}
    edges = [(k + (n + 1) * side, k + 1 + (n + 1) * side) for side in (0, 1) for k in range(n)]
    table = roads(points, edges, highway=["primary"] * n + ["track"] * n)

    def profile(row: int, x: np.ndarray) -> np.ndarray:
        return np.interp(edge[row % n] + x, *((at, height) if row < n else (rough_at, rough)))

    passes = driven(table, range(2 * n - 1), profile, PRECISE, np.random.default_rng(6))
    road = RoadBeliefs(table, PassColumns.of({0: [replace(p, roughness=1e-5) for p in passes]}))
    learned(road, passes)
    assert np.median(road.usual[n:]) > 3 * np.median(road.usual[:n])
    assert road.usual[-1] == pytest.approx(road.usual[-2], rel=0.3)


def test_a_pass_that_measured_nothing_knows_nothing_of_the_road() -> None:
    """Its drive went over it, and what is believed of roads before any drive is believed still."""
    table = street(40.0, 50.0)
    silent = [
        replace(p, information=0 * p.information, vector=0 * p.vector, square=0.0, rows=0, roughness=1e-6)
        for p in (steady(table, 0, 1.0), steady(table, 1, 1.0, sequence=1))
    ]
    found, before = (RoadBeliefs(table, PassColumns.of({0: passes})) for passes in (silent, []))
    learned(found, silent)
    assert found.usual == pytest.approx(before.usual)
    assert found.roughness.weight == pytest.approx(1 / (UNSEEN_VARIANCE * before.usual[0]), rel=1e-6)
