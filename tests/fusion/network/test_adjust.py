"""The network adjustment against the same model solved densely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_adjustment import DenseAdjustment
from factor_support import Sensors, block_of_streets, driven, graded, roads, street
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.terrain import Terrain
from fusion.roads.table import RoadTable
from street_support import EVERYTHING, LATE, height_at, hilly, knots_m, ride, waves

Drives = Mapping[int, Sequence[PassFactor]]


def assert_as_dense(table: RoadTable, drives: Drives, terrain: Terrain | None = None) -> Adjustment:
    """Solve, compare with the dense reference to 1e-6 of a sigma, return the solution."""
    found = adjust(table, drives, terrain)
    quality = (found.model.sigma_m, found.model.length_m) if found.model else (1.0, 1.0)
    dense = DenseAdjustment(table, drives, terrain, quality)
    slope, sigma = dense.slopes()
    assert np.abs((found.slope_percent - slope) / sigma).max() < 1e-6
    assert found.slope_sigma_percent == pytest.approx(sigma, rel=1e-6)
    named = [(d, p.sequence) for d in sorted(drives) for p in sorted(drives[d], key=lambda p: p.sequence)]
    assert found.accepted == dict(zip(named, dense.accepted(), strict=True))
    assert found.lag_s == pytest.approx({d: dense.solution[u] for d, u in dense.lag.items()}, abs=1e-6)
    return found


def terrain_over(table: RoadTable, seed: int, sigma_m: float = 2.0) -> Terrain:
    """A poor elevation model of a street, with a hole in it."""
    x = knots_m(table)
    height = height_at(x) + sigma_m * np.random.default_rng(seed).normal(size=len(x))
    height[len(x) // 3] = np.nan
    return Terrain(height)


def test_a_street_of_short_segments() -> None:
    table = street(15.0, 18.0, 12.0, 19.0)
    assert_as_dense(table, {1: waves(table, 1), 2: waves(table, 2)})


def test_segments_of_many_intervals() -> None:
    table = street(45.0, 130.0, 330.0)
    assert_as_dense(table, {1: waves(table, 1)})


def test_gaps_of_one_and_of_many_intervals() -> None:
    table = street(45.0, 18.0, 70.0, 33.0, 95.0, 80.0)
    assert_as_dense(table, {1: waves(table, 1, (0, 2, 5))})


def test_a_block_of_streets_with_undriven_ones() -> None:
    table = block_of_streets(3, 3)
    assert_as_dense(table, {1: waves(table, 1, range(len(table) - 3))})


def test_passes_that_cover_different_parts_of_a_segment() -> None:
    table = street(100.0, 60.0)
    rng = np.random.default_rng(1)
    parts = [(0.0, 15.0), (82.0, 100.0), (30.0, 30.5)]
    drives = {
        k: [graded(table, 0, lambda at: 0.03 + 0 * at, 0.01, rng, part=part)] for k, part in enumerate(parts)
    }
    for count in (1, 2, 3):
        assert_as_dense(table, {k: drives[k] for k in range(count)})
    assert_as_dense(table, {2: drives[2]})


@pytest.mark.parametrize(
    "sensors",
    [
        EVERYTHING,
        LATE,
        Sensors(np.nan, 0.01, mount=0.05),
        Sensors(np.nan, pressure_m=0.1),
        Sensors(0.05, altitude_m=1.0, walk_m2_per_s=(0.5, 0.01)),
    ],
    ids=["everything", "late altimeter", "pitch", "pressure", "altitude and Doppler"],
)
def test_drives_with_errors_that_they_carry_along(sensors: Sensors) -> None:
    table = street(40.0, 50.0, 60.0, 30.0)
    drives = {seed: ride(table, sensors, seed) for seed in (3, 7)}
    drives[9] = ride(table, sensors, 9, (1, 2))
    assert_as_dense(table, drives)


def test_a_mount_that_moved_between_two_passes() -> None:
    table = street(40.0, 50.0, 60.0)
    moved = [replace(p, mount=k // 2) for k, p in enumerate(ride(table, EVERYTHING, 2))]
    assert_as_dense(table, {0: moved})


@pytest.mark.parametrize("parts", [(0, 0, 0, 0), (0, 0, 1, 5), (3, 0, 0, 2)])
def test_positions_that_are_wrong_together(parts: tuple[int, ...]) -> None:
    table = street(40.0, 50.0, 60.0, 30.0)
    sensors = replace(EVERYTHING, farther_m=4.0)
    drives = {
        seed: [replace(p, place=part) for p, part in zip(ride(table, sensors, seed), parts, strict=True)]
        for seed in (3, 7)
    }
    assert_as_dense(table, drives)


def test_a_terrain_model_beside_drives() -> None:
    table = street(60.0, 45.0, 70.0, 30.0, 80.0, 55.0)
    drives = {0: ride(table, EVERYTHING, 1, (0, 1, 2)), 1: ride(table, EVERYTHING, 2, (2, 3))}
    assert_as_dense(table, drives, terrain_over(table, 3))


def test_terrain_away_from_structures() -> None:
    table = street(*[80.0] * 6, bridge=[False] * 4 + [True, False])
    drives = {0: ride(table, EVERYTHING, 1, (0, 3))}
    terrain = terrain_over(table, 5)
    found = assert_as_dense(table, drives, terrain)
    before = np.repeat(np.arange(6), 5) < 3
    unaware = adjust(table, drives, Terrain(np.where(before, terrain.height_m, np.nan)))
    # On a structure and beside it the terrain says nothing about the road.
    assert found.slope_percent == pytest.approx(unaware.slope_percent, abs=1e-9)
    assert found.slope_sigma_percent == pytest.approx(unaware.slope_sigma_percent, rel=1e-9)


def test_parts_that_are_not_joined() -> None:
    points = {0: (0.0, 0.0), 1: (50.0, 0.0), 2: (500.0, 0.0), 3: (560.0, 0.0), 4: (600.0, 20.0)}
    table = roads(points, [(0, 1), (2, 3), (3, 4)])
    assert_as_dense(table, {1: waves(table, 1)})


@pytest.mark.slow
@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_any_small_network(seed: int) -> None:
    """Streets of any length and direction, driven or not, in part or whole, by drives of any quality."""
    rng = np.random.default_rng(seed)
    table = block_of_streets(2, int(rng.integers(2, 4)), float(rng.uniform(12.0, 75.0)))
    table.highway[:] = rng.choice(["residential", "primary"], len(table))
    drives: dict[int, list[PassFactor]] = {}
    for number in range(int(rng.integers(1, 4))):
        quality, rough = float(10 ** rng.uniform(-2.5, -1)), float(10 ** rng.uniform(-6, -4))
        rows = rng.permutation(len(table))[: int(rng.integers(1, len(table) + 1))].tolist()
        if rng.random() < 0.5:
            has = rng.random(4) < 0.5
            sensors = Sensors(
                quality, *np.where(has, [0.01, 0.02, 0.4, 0.1], np.nan).tolist(),
                mount=float(0.05 * rng.normal()), lag_s=2.0 if rng.random() < 0.5 else np.nan,
                farther_m=3.0 if rng.random() < 0.5 else 0.0,
            )  # fmt: skip
            passes = driven(table, rows, lambda row, at: 100 + 2 * np.sin(row + at / 40), sensors, rng)
            drives[number] = [
                replace(p, roughness=rough, mount=k // 3, place=k // 2) for k, p in enumerate(passes)
            ]
            continue
        drives[number] = []
        for k, row in enumerate(rows):
            low, high = np.sort(rng.uniform(0, table.length_m[row], 2)).tolist()
            part = (low, high) if high - low > 3 and rng.random() < 0.5 else None
            drives[number].append(
                graded(
                    table, row, lambda at, r=row: hilly(r, at), quality, rng, part=part, roughness=rough, sequence=k
                )  # type: ignore[misc]
            )  # fmt: skip
    assert_as_dense(table, drives)
