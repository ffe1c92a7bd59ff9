"""The network adjustment against the same model solved densely, and what must hold whatever the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_adjustment import DenseAdjustment
from factor_support import Sensors, block_of_streets, driven, graded, roads, steady, street
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.published import Adjustment
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions
from fusion.roads.table import RoadTable

Drives = Mapping[int, Sequence[PassFactor]]
EVERYTHING = Sensors(
    0.02, 0.01, 0.02, altitude_m=0.5, pressure_m=0.1, walk_m2_per_s=(0.15, 0.01), mount=0.03, bias=0.01
)
LATE = Sensors(np.nan, altitude_m=0.2, walk_m2_per_s=(0.01, 0.01), lag_s=2.5)


def assert_as_dense(table: RoadTable, drives: Drives, terrain: Terrain | None = None) -> Adjustment:
    """Solve, compare with the dense reference to 1e-6 of a sigma, return the solution."""
    found = adjust(table, drives, terrain)
    quality = (found.model.sigma_m, found.model.length_m) if found.model else (1.0, 1.0)
    dense = DenseAdjustment(table, drives, terrain, quality)
    slope, sigma = dense.slopes()
    assert np.abs((found.slope_percent - slope) / sigma).max() < 1e-6
    assert found.slope_sigma_percent == pytest.approx(sigma, rel=1e-6)
    named = [(d, p.sequence) for d in sorted(drives) for p in sorted(drives[d], key=lambda p: p.sequence)]
    assert found.heard == dict(zip(named, dense.heard(), strict=True))
    assert found.lag_s == pytest.approx({d: dense.solution[u] for d, u in dense.lag.items()}, abs=1e-6)
    return found


def assert_same(left: Adjustment, right: Adjustment, sigmas: float = 1e-9) -> None:
    """Counts equal, slopes within so many sigmas, sigmas as alike."""
    for name in ("observations", "passes", "rejected"):
        assert np.array_equal(getattr(left, name), getattr(right, name)), name
    apart = np.abs(left.slope_percent - right.slope_percent) / left.slope_sigma_percent
    assert np.nanmax(apart, initial=0.0) < sigmas
    assert left.slope_sigma_percent == pytest.approx(right.slope_sigma_percent, rel=sigmas, nan_ok=True)


def hilly(row: int, at: np.ndarray) -> np.ndarray:
    """Grades of a road that waves, another wave on every row."""
    return np.asarray(0.05 * np.sin(row + at / 40))


def road_of(table: RoadTable) -> tuple[np.ndarray, np.ndarray]:
    """Where the segments of a street begin, and its true slopes, percent."""
    edge = np.concatenate([[0.0], np.cumsum(table.length_m)])
    slopes = []
    for a, b in zip(edge[:-1], edge[1:], strict=True):
        x = np.linspace(a, b, 400)
        slopes.append(100 * float(np.polyfit(x, height_at(x), 1)[0]))
    return edge, np.array(slopes)


def height_at(x: np.ndarray) -> np.ndarray:
    """Height of a hilly road at distances from its west end."""
    return np.asarray(150 + 0.02 * x + 3 * np.sin(x / 70))


def ride(table: RoadTable, sensors: Sensors, seed: int, rows: Sequence[int] | None = None) -> list[PassFactor]:
    """A drive along a street (or some of its rows) over ``height_at``."""
    edge, _ = road_of(table)
    chosen = range(len(table)) if rows is None else rows
    return driven(
        table, chosen, lambda row, at: height_at(edge[row] + at), sensors, np.random.default_rng(seed)
    )


def waves(
    table: RoadTable, seed: int, rows: Sequence[int] | None = None, sigma: float = 0.02
) -> list[PassFactor]:
    """A drive with one noisy pass over each of the rows, none of which knows of the others."""
    rng = np.random.default_rng(seed)
    return [
        graded(table, row, lambda at, row=row: hilly(row, at), sigma, rng, sequence=k)  # type: ignore[misc]
        for k, row in enumerate(range(len(table)) if rows is None else rows)
    ]


def terrain_over(table: RoadTable, seed: int, sigma_m: float = 2.0) -> Terrain:
    """A poor elevation model of a street, with a hole in it."""
    edge, _ = road_of(table)
    knots = len(knot_positions(table)[0])
    x = np.linspace(0, edge[-1], knots)
    height = height_at(x) + sigma_m * np.random.default_rng(seed).normal(size=knots)
    height[knots // 3] = np.nan
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


def test_a_terrain_model_beside_drives() -> None:
    table = street(60.0, 45.0, 70.0, 30.0, 80.0, 55.0)
    drives = {0: ride(table, EVERYTHING, 1, (0, 1, 2)), 1: ride(table, EVERYTHING, 2, (2, 3))}
    assert_as_dense(table, drives, terrain_over(table, 3))


def test_terrain_away_from_structures() -> None:
    table = street(*[80.0] * 6, bridge=[False] * 4 + [True, False])
    drives = {0: ride(table, EVERYTHING, 1, (0, 3))}
    terrain = terrain_over(table, 5)
    found = assert_as_dense(table, drives, terrain)
    place = np.repeat(np.arange(6), 5)
    unaware = adjust(table, drives, Terrain(np.where(place < 3, terrain.height_m, np.nan)))
    assert_same(found, unaware)  # on a structure and beside it the terrain says nothing about the road


def test_parts_that_are_not_joined() -> None:
    points = {0: (0.0, 0.0), 1: (50.0, 0.0), 2: (500.0, 0.0), 3: (560.0, 0.0), 4: (600.0, 20.0)}
    table = roads(points, [(0, 1), (2, 3), (3, 4)])
    assert_as_dense(table, {1: waves(table, 1)})


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_any_small_network(seed: int) -> None:
    """Streets of any length and direction, driven or not, in part or whole, by drives of any quality."""
    rng = np.random.default_rng(seed)
    table = block_of_streets(2, int(rng.integers(2, 4)), float(rng.uniform(12.0, 75.0)))
    drives: dict[int, list[PassFactor]] = {}
    for number in range(int(rng.integers(1, 4))):
        quality, rough = float(10 ** rng.uniform(-2.5, -1)), float(10 ** rng.uniform(-6, -4))
        rows = rng.permutation(len(table))[: int(rng.integers(1, len(table) + 1))].tolist()
        if rng.random() < 0.5:
            has = rng.random(4) < 0.5
            sensors = Sensors(
                quality, *np.where(has, [0.01, 0.02, 0.4, 0.1], np.nan).tolist(),
                mount=float(0.05 * rng.normal()), lag_s=2.0 if rng.random() < 0.5 else np.nan,
            )  # fmt: skip
            passes = driven(
                table, rows, lambda row, at: 100 + 2 * np.sin(row + at / 40), sensors, rng
            )
            drives[number] = [replace(p, roughness=rough, mount=k // 3) for k, p in enumerate(passes)]
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


# What must hold whatever the numbers


def test_the_order_of_drives_does_not_matter() -> None:
    table = street(60.0, 50.0, 70.0, 40.0, 55.0)
    drives = {seed: ride(table, EVERYTHING, seed) for seed in range(4)}
    first = adjust(table, drives)
    turned = adjust(table, {d: drives[d][::-1] for d in (2, 0, 3, 1)})
    assert_same(first, turned)
    # Nor do the numbers that drives go by, which say who came first.
    assert_same(first, adjust(table, {10 - d: drives[d] for d in drives}))


def test_deleting_a_drive_restores_what_was() -> None:
    table = street(60.0, 50.0, 70.0, 40.0, 55.0)
    stored: dict[int, list[PassFactor]] = {seed: ride(table, EVERYTHING, seed) for seed in (1, 2, 5)}
    start = adjust(table, stored)
    between = adjust(table, {**stored, 4: ride(table, LATE, 9)})
    assert np.abs(start.slope_percent - between.slope_percent).max() > 1e-3
    assert_same(start, adjust(table, dict(stored)))


def test_drawing_a_way_backwards_turns_the_sign_and_nothing_else() -> None:
    points = {0: (0.0, 0.0), 1: (70.0, 0.0), 2: (130.0, 30.0), 3: (70.0, 60.0), 4: (200.0, 40.0)}
    edges = [(0, 1), (1, 2), (1, 3), (2, 4)]
    lengths = roads(points, edges).length_m

    def solved(backwards: Sequence[bool]) -> Adjustment:
        table = roads(points, [e[::-1] if b else e for e, b in zip(edges, backwards, strict=True)])
        passes = []
        for row, turned in enumerate(backwards):
            if row == 1:
                continue  # a gap, drawn either way
            passes.append(
                graded(
                    table,
                    row,
                    lambda at, r=row, t=turned: -hilly(r, lengths[r] - at) if t else hilly(r, at),  # type: ignore[misc]
                    0.02,
                    sequence=row,
                )
            )
        return adjust(table, {0: passes})

    usual = solved([False] * 4)
    for backwards in ([True] * 4, [False, True, False, True], [True, False, True, False]):
        turned = solved(backwards)
        sign = np.where(backwards, -1.0, 1.0)
        assert turned.slope_percent == pytest.approx(sign * usual.slope_percent, abs=1e-6)
        assert turned.slope_sigma_percent == pytest.approx(usual.slope_sigma_percent, rel=1e-6)


def test_roads_that_cross_on_different_layers_know_nothing_of_each_other() -> None:
    """But for what is usual of roads, which all of them teach: the lower road is as it would be by itself."""
    points = {0: (-60.0, 0.0), 1: (60.0, 0.0), 2: (0.0, -60.0), 3: (0.0, 60.0)}
    table = roads(points, [(0, 1), (2, 3)], layer=[1, 0], bridge=[True, False])
    below = [steady(table, 1, 2.0)]
    quiet = adjust(table, {0: [steady(table, 0, 0.0)], 1: below})
    steep = adjust(table, {0: [steady(table, 0, 14.0)], 1: below})
    assert steep.slope_percent[0] > 10
    assert steep.slope_percent[1] == pytest.approx(quiet.slope_percent[1], abs=1e-4)
    assert steep.slope_sigma_percent[1] == pytest.approx(quiet.slope_sigma_percent[1], rel=1e-2)


@pytest.mark.parametrize("gap", [(20.0,), (60.0,), (30.0, 80.0, 25.0)])
def test_a_gap_between_driven_segments_is_guessed_with_less_certainty(gap: tuple[float, ...]) -> None:
    table = street(60.0, *gap, 60.0)
    ends = (0, len(table) - 1)
    said = [
        steady(table, row, slope, 0.005, sequence=row) for row, slope in zip(ends, (3.0, 5.0), strict=True)
    ]
    found = adjust(table, {0: said})
    inner = found.slope_percent[1:-1]
    assert np.all((inner > 2.5) & (inner < 5.5))
    assert np.all(found.slope_sigma_percent[1:-1] > found.slope_sigma_percent[list(ends)].max())
    assert np.all(found.slope_sigma_percent[1:-1] < 5.0)
    assert found.observations[1:-1].tolist() == found.passes[1:-1].tolist() == [0] * len(gap)
    assert found.driven_share.tolist() == [1.0, *[0.0] * len(gap), 1.0]
    assert np.all(found.observations[list(ends)] > 0)


def test_heights_carry_over_a_gap_that_no_slope_was_measured_in() -> None:
    """A barometer that goes on through a tunnel, or a street that the map has twice, knows the rise."""
    table = street(60.0, 150.0, 60.0)
    level = Sensors(np.nan, pressure_m=0.05, walk_m2_per_s=(0.1, 1e-3))
    edge, slopes = road_of(table)
    whole = driven(
        table, (0, 1, 2), lambda row, at: height_at(edge[row] + at), level, np.random.default_rng(1)
    )
    found = adjust(table, {0: [whole[0], whole[2]]})
    blind = adjust(table, {0: waves(table, 1, (0, 2))})
    # What the regression over the gap has of its inside is not known; what its ends are is.
    assert found.slope_sigma_percent[1] < 0.6 * blind.slope_sigma_percent[1]
    assert abs(found.slope_percent[1] - slopes[1]) < 2.5 * found.slope_sigma_percent[1]


def test_ends_of_segments_agree_at_a_junction() -> None:
    points = {0: (0.0, 0.0), 1: (-60.0, 0.0), 2: (60.0, 0.0), 3: (0.0, 60.0)}
    table = roads(points, [(1, 0), (0, 2), (0, 3)])
    rng = np.random.default_rng(2)
    level = replace(EVERYTHING, walk_m2_per_s=(0.15, 0.002))
    drives = {
        k: driven(table, (0, 1 + k % 2), lambda _, at: np.full(len(at), 120.0), level, rng) for k in range(4)
    }
    found = adjust(table, drives)
    u = found.unknowns
    ends = [found.solution.x[u.first[0] + u.count[0] - 2], *found.solution.x[u.first[1:]]]
    assert np.ptp(ends) < 0.2
    assert np.abs(found.slope_percent).max() < 1.96 * found.slope_sigma_percent.max()


def test_copies_of_a_drive_make_sigma_smaller() -> None:
    """As far as the map's own nodes are known: with a thousand drives that is what is left."""
    table = street(60.0, 50.0, 70.0)
    drive = waves(table, 3, sigma=0.03)
    sigma = [
        adjust(table, {k: drive for k in range(copies)}).slope_sigma_percent for copies in (1, 10, 100, 1000)
    ]
    assert np.all(np.diff(sigma, axis=0) < 0)
    assert np.all(sigma[1] < 0.6 * sigma[0])
    assert np.all(sigma[3] > 0.5 * sigma[2])


def test_sigma_is_wider_in_a_bend_of_the_profile_than_where_the_grade_is_even() -> None:
    """Where the map's node lies along the road matters only where the grade changes there."""
    table = street(30.0, 30.0)

    def sigma(bend: float) -> float:
        said = [
            graded(table, row, lambda at, r=row: bend * (30 * r + at) / 60, 0.003, sequence=row)  # type: ignore[misc]
            for row in (0, 1)
        ]
        return float(adjust(table, dict.fromkeys(range(100), said)).slope_sigma_percent[0])

    assert sigma(0.10) > 1.5 * sigma(0.0)


def test_a_drive_that_contradicts_the_others_is_rejected_and_shown() -> None:
    table = street(60.0, 50.0, 70.0, 40.0)
    rng = np.random.default_rng(8)
    fair = {seed: waves(table, seed, sigma=0.01) for seed in range(4)}
    skewed = [
        graded(table, row, lambda at, r=row: hilly(r, at) + 0.15, 0.01, rng, sequence=row)  # type: ignore[misc]
        for row in range(len(table))
    ]
    without, found = adjust(table, fair), adjust(table, {**fair, 9: skewed})
    assert found.rejected.tolist() == [1] * 4
    assert found.passes.tolist() == [4] * 4
    assert found.observations.tolist() == without.observations.tolist()
    assert [found.heard[9, row] for row in range(4)] == [False] * 4
    assert all(found.heard[d, row] for d in fair for row in range(4))
    # It has a weight of nearly nothing, not of nothing: a verdict may turn when more drives come.
    apart = np.abs(found.slope_percent - without.slope_percent) / without.slope_sigma_percent
    assert apart.max() < 0.5


def test_the_verdict_turns_when_others_agree_with_the_rejected_one() -> None:
    table = street(60.0, 50.0)
    rng = np.random.default_rng(8)
    skewed = [
        [
            graded(table, row, lambda at: 0.15 + 0 * at, 0.01, rng, sequence=row) for row in range(2)
        ]
        for _ in range(6)
    ]
    flat = [[graded(table, row, lambda at: 0 * at, 0.01, rng, sequence=row) for row in range(2)] for _ in range(2)]
    few = adjust(table, {0: flat[0], 1: flat[1], 2: skewed[0]})
    many = adjust(table, dict(enumerate([*flat, *skewed])))
    assert [few.heard[d, 0] for d in range(3)] == [True, True, False]
    assert [many.heard[d, 0] for d in range(8)] == [False] * 2 + [True] * 6


def test_laps_of_one_drive_are_one_witness_of_what_it_carries() -> None:
    """Ten laps with one tilted sensor know the slope no better than the tilt; ten drives do."""
    table = street(60.0, 70.0)
    tilted = Sensors(np.nan, 0.004, mount=0.02)
    edge, _ = road_of(table)

    def lap(seed: int) -> list[PassFactor]:
        return driven(table, (0, 1), lambda row, at: height_at(edge[row] + at), tilted, np.random.default_rng(seed))

    laps = [replace(p, sequence=2 * k + p.sequence) for k in range(10) for p in lap(k)]
    level = {20 + k: ride(table, Sensors(np.nan, altitude_m=1.0), k) for k in range(3)}
    one = adjust(table, {0: lap(0), **level}).slope_sigma_percent
    ten_laps = adjust(table, {0: laps, **level}).slope_sigma_percent
    ten_drives = adjust(table, {**{k: lap(k) for k in range(10)}, **level}).slope_sigma_percent
    assert np.all(ten_laps > 0.9 * one), "the tilt is one unknown, however many laps"
    assert np.all(ten_drives < ten_laps * 1.01)


def test_a_mount_is_known_from_the_whole_drive() -> None:
    """What the Doppler of one stretch teaches of the tilt, the pitch of another uses."""
    table = street(*[60.0] * 8)
    edge, _ = road_of(table)
    rng = np.random.default_rng(4)
    both = Sensors(0.01, 0.004, mount=0.06)
    passes = driven(table, range(8), lambda row, at: height_at(edge[row] + at), both, rng)
    pitch = driven(
        table, range(8), lambda row, at: height_at(edge[row] + at), replace(both, doppler=np.nan), rng
    )
    mixed = [*passes[:4], *pitch[4:]]
    taught = adjust(table, {0: mixed}).slope_sigma_percent[5:]
    alone = adjust(table, {0: [replace(p, mount=k // 4) for k, p in enumerate(mixed)]}).slope_sigma_percent[5:]
    assert np.all(taught < 0.5 * alone)


def test_many_drives_over_a_long_hilly_road_stay_solvable() -> None:
    """A thousand precise drives beside gaps that nobody drove: the weights span ten orders of magnitude."""
    table = street(*[55.0] * 40)
    rows = [row for row in range(40) if row % 5]
    once = [steady(table, row, 12.0, 0.002, sequence=k) for k, row in enumerate(rows)]
    many = [
        replace(
            f, information=1000 * f.information, vector=1000 * f.vector, square=1000 * f.square, rows=1000 * f.rows
        )
        for f in once
    ]  # fmt: skip
    found = adjust(table, {0: many})
    assert found.slope_percent[rows] == pytest.approx(np.full(32, 12.0), abs=0.01)
    assert np.all(found.slope_sigma_percent[rows] < 0.5)
    assert np.all(np.abs(found.slope_percent - 12.0) < 1.96 * found.slope_sigma_percent)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4])
def test_true_slopes_lie_within_sigma_as_often_as_sigma_says(count: int) -> None:
    """Roads drawn from the prior, driven with known noise; the map's nodes lie where they are said to be not."""
    rng = np.random.default_rng(12)
    ratio = []
    for _ in range(30):
        lengths = rng.uniform(12.0, 90.0, 12)
        table = street(*lengths.tolist())
        edge = np.concatenate([[0.0], np.cumsum(table.length_m)])
        step, at = 0.25, np.arange(-20.0, edge[-1] + 20.0, 0.25)
        grade = rng.normal(0, 0.04) + np.cumsum(np.sqrt(3e-5 * step) * rng.normal(size=len(at)))
        height = 200 + np.cumsum(grade) * step
        drives = {
            d: driven(
                table, range(12), lambda row, x, e=edge, a=at, h=height: np.interp(e[row] + x, a, h),  # type: ignore[misc]
                replace(EVERYTHING, mount=float(0.05 * rng.normal()), bias=float(0.01 * rng.normal())), rng,
            )
            for d in range(count)
        }  # fmt: skip
        truth = []
        for low, high in zip(edge[:-1], edge[1:], strict=True):
            inside = (at >= low) & (at <= high)
            truth.append(100 * np.polyfit(at[inside], height[inside], 1)[0])
        found = adjust(table, drives)
        ratio.append((found.slope_percent - truth) / found.slope_sigma_percent)
    share = np.mean(np.abs(ratio) <= 1.96)
    assert 0.90 <= share <= 1.0
    assert np.mean(np.abs(ratio) <= 0.5 * 1.96) < 0.97, "sigmas that hold anything"
