"""Which unknown is what: nodes that segments share, knots, and what passes of one drive have in common."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from factor_support import PLANE, Profile, Sensors, block_of_streets, driven, graded, roads, street
from fusion.network.pass_columns import PassColumns
from fusion.network.pass_factor import BIAS, EAST, ENTRY, EXIT, LAG, MOUNT, NORTH, SQUAT, PassFactor
from fusion.network.unknowns import DriveUnknowns, RoadUnknowns, knot_positions

EVERYTHING = Sensors(0.02, 0.01, 0.02, altitude_m=0.5, pressure_m=0.1)


def flat(_: int, at: np.ndarray) -> np.ndarray:
    return np.full(len(at), 100.0)


def hilly(_: int, at: np.ndarray) -> np.ndarray:
    return 100 + np.sin(at / 10)


def passes_of(sensors: Sensors, height: Profile = flat, count: int = 4) -> list[PassFactor]:
    table = street(*[30.0] * count)
    return driven(table, range(count), height, sensors, np.random.default_rng(1))


def test_segments_share_the_heights_of_their_nodes_and_nothing_else() -> None:
    points = {10: (0.0, 0.0), 5: (45.0, 0.0), 7: (45.0, 30.0)}
    u = RoadUnknowns(roads(points, [(10, 5), (5, 7), (7, 10)]))
    assert u.nodes == 3
    assert u.end_node[0] == u.start_node[1]
    assert u.end_node[1] == u.start_node[2]
    assert u.end_node[2] == u.start_node[0]
    own = [np.arange(f, f + c) for f, c in zip(u.first, u.count, strict=True)]
    assert np.concatenate(own).tolist() == list(range(3, u.size))
    assert u.intervals.tolist() == [3, 2, 3]


def test_ends_are_the_first_and_the_last_height_of_a_segment() -> None:
    u = RoadUnknowns(street(30.0, 70.0, 10.0))
    rows = np.arange(3)
    start, end = u.end(rows, np.zeros(3, bool)), u.end(rows, np.ones(3, bool))
    for mine in u.by_intervals():
        variables = u.variables(mine)
        assert variables[:, 0].tolist() == start[mine].tolist()
        assert variables[:, -2].tolist() == end[mine].tolist()
    assert sorted(np.concatenate(u.by_intervals()).tolist()) == [0, 1, 2]


def test_what_a_pass_does_not_speak_of_is_no_unknown() -> None:
    table = street(30.0, 40.0)
    passes = [graded(table, row, lambda at: 0 * at, 0.01, sequence=row) for row in range(2)]
    u = DriveUnknowns(PassColumns.of({0: passes}), 100)
    assert u.end == u.begin == 100
    assert np.all(u.of_pass == -1)
    assert u.lag is None
    assert all(len(side) == 0 for side in u.joints(0))


def test_constants_are_the_drive_s_and_errors_are_the_pass_es() -> None:
    u = DriveUnknowns(PassColumns.of({0: passes_of(EVERYTHING)}), 50)
    assert sorted(u.constants.values()) == [MOUNT, BIAS]
    for kind in (MOUNT, BIAS):
        assert len(set(u.of_pass[:, kind].tolist())) == 1
    assert np.all(u.of_pass[:, [SQUAT, LAG]] == -1)
    errors = np.concatenate([u.of_pass[:, ENTRY], u.of_pass[:, EXIT]], axis=1)
    assert len(set(errors.ravel().tolist())) == errors.size == 16
    assert u.end == 50 + 2 + 16


def test_a_lag_is_one_for_the_drive() -> None:
    hill = driven(
        street(30.0, 30.0), (0, 1), lambda _, at: 100 + 0.05 * at, Sensors(altitude_m=0.3, lag_s=2.0),
        np.random.default_rng(1),
    )  # fmt: skip
    u = DriveUnknowns(PassColumns.of({0: hill}), 0)
    assert u.lag is not None
    assert u.of_pass[:, LAG].tolist() == [u.lag] * 2
    assert DriveUnknowns(PassColumns.of({0: passes_of(EVERYTHING)}), 0).lag is None


def test_passes_with_one_setting_of_the_mount_share_it() -> None:
    passes = [replace(p, mount=mount) for p, mount in zip(passes_of(EVERYTHING), (0, 0, 2, 0), strict=True)]
    u = DriveUnknowns(PassColumns.of({0: passes}), 0)
    mount, bias = u.of_pass[:, MOUNT], u.of_pass[:, BIAS]
    assert mount[0] == mount[1] == mount[3] != mount[2]
    assert len(set(bias.tolist())) == 1
    assert sorted(u.constants.values()) == [MOUNT, MOUNT, BIAS]


def test_passes_of_one_part_of_a_drive_share_the_error_of_its_positions() -> None:
    wrong = passes_of(replace(EVERYTHING, farther_m=2.0), hilly)
    u = DriveUnknowns(
        PassColumns.of({0: [replace(p, place=part) for p, part in zip(wrong, (4, 4, 1, 4), strict=True)]}), 0
    )
    first, second, third, fourth = u.of_pass[:, EAST].tolist()
    assert first == second == fourth != third
    assert u.keys[EAST, 1] == third
    assert u.keys[EAST, 4] == first
    assert not [key for key in u.keys if key[0] == NORTH]  # the street leads east


def test_errors_go_on_from_a_pass_to_the_next_one_that_knows_them() -> None:
    both = passes_of(EVERYTHING)
    barometer_only = passes_of(Sensors(np.nan, pressure_m=0.1))
    mixed = [both[0], barometer_only[1], both[2], both[3]]
    u = DriveUnknowns(PassColumns.of({0: mixed}), 0)
    assert [side.tolist() for side in u.joints(0)] == [[0, 2], [2, 3]]
    assert [side.tolist() for side in u.joints(1)] == [[0, 1, 2], [1, 2, 3]]


@settings(max_examples=50)
@given(seed=st.integers(0, 2**31))
def test_every_unknown_is_somebody_s(seed: int) -> None:
    """Numbers run on without a hole, and each is one thing."""
    rng = np.random.default_rng(seed)
    passes = []
    for k in range(int(rng.integers(1, 7))):
        has = np.where(rng.random(5) < 0.5, 0.1, np.nan)
        sensors = Sensors(*has.tolist()) if np.isfinite(has).any() else EVERYTHING
        one = driven(street(25.0), (0,), flat, sensors, rng)[0]
        passes.append(replace(one, sequence=k, mount=int(rng.integers(0, 3))))
    u = DriveUnknowns(PassColumns.of({0: passes}), 1000)
    spoken = u.of_pass[u.of_pass >= 0]
    assert sorted(set(spoken.tolist())) == list(range(1000, u.end))
    for k, one in enumerate(passes):
        assert (u.of_pass[k] >= 0).tolist() == one.used.tolist()


@pytest.mark.parametrize("side_m", [15.0, 70.0])
def test_knots_lie_on_their_segments_at_even_distances(side_m: float) -> None:
    table = block_of_streets(2, 2, side_m)
    lon, lat = knot_positions(table)
    u = RoadUnknowns(table)
    assert len(lon) == int((u.intervals + 1).sum())
    x, y = PLANE.to_xy(lon, lat)
    place = 0
    for row, n in enumerate((u.intervals + 1).tolist()):
        here = slice(place, place + n)
        apart = np.hypot(np.diff(x[here]), np.diff(y[here]))
        assert apart == pytest.approx(np.full(n - 1, table.length_m[row] / (n - 1)), rel=1e-3)
        assert lon[here][[0, -1]] == pytest.approx([table.lon0_deg[row], table.lon1_deg[row]], abs=1e-12)
        place += n
