"""What must hold of the network adjustment whatever the numbers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from factor_support import POSITION_SIGMA_M, Sensors, driven, graded, roads, steady, street
from fusion.network import segment_slopes
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from street_support import EVERYTHING, LATE, hill_of, hilly, ride, true_percent, waves


def assert_same(left: Adjustment, right: Adjustment, sigmas: float = 1e-9) -> None:
    """Counts equal, slopes within so many sigmas, sigmas as alike."""
    for name in ("observations", "passes", "rejected"):
        assert np.array_equal(getattr(left, name), getattr(right, name)), name
    apart = np.abs(left.slope_percent - right.slope_percent) / left.slope_sigma_percent
    assert np.nanmax(apart, initial=0.0) < sigmas
    assert left.slope_sigma_percent == pytest.approx(right.slope_sigma_percent, rel=sigmas, nan_ok=True)


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
    slopes = true_percent(table)
    whole = driven(table, (0, 1, 2), hill_of(table), level, np.random.default_rng(1))
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


def test_copies_of_a_drive_make_sigma_smaller(monkeypatch: pytest.MonkeyPatch) -> None:
    """As far as the map's own nodes are known: with a thousand drives that is what is left."""
    table = street(60.0, 50.0, 70.0)
    drive = waves(table, 3, sigma=0.03)

    def sigmas() -> np.ndarray:
        counts = (1, 10, 100, 1000)
        return np.array([adjust(table, dict.fromkeys(range(n), drive)).slope_sigma_percent for n in counts])

    whole = sigmas()
    monkeypatch.setattr(segment_slopes, "PLACE_SIGMA_M", 0.0)
    monkeypatch.setattr(segment_slopes, "LANE_SIGMA_M", 0.0)
    own = sigmas()
    assert np.all(np.diff(own, axis=0) < 0)
    assert np.all(whole >= own)
    assert np.all(whole[1] < 0.6 * whole[0])
    assert np.all(whole[3] > 0.5 * whole[2])
    assert np.all(own[3] < 0.5 * own[2])


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
    assert [found.accepted[9, row] for row in range(4)] == [False] * 4
    assert all(found.accepted[d, row] for d in fair for row in range(4))
    # It has a weight of nearly nothing, not of nothing: a rejection may turn when more drives come.
    apart = np.abs(found.slope_percent - without.slope_percent) / without.slope_sigma_percent
    assert apart.max() < 0.5


def test_a_rejection_turns_when_others_agree_with_the_rejected_one() -> None:
    table = street(60.0, 50.0)
    rng = np.random.default_rng(8)
    skewed = [
        [graded(table, row, lambda at: 0.15 + 0 * at, 0.01, rng, sequence=row) for row in range(2)]
        for _ in range(6)
    ]
    flat = [
        [graded(table, row, lambda at: 0 * at, 0.01, rng, sequence=row) for row in range(2)] for _ in range(2)
    ]
    few = adjust(table, {0: flat[0], 1: flat[1], 2: skewed[0]})
    many = adjust(table, dict(enumerate([*flat, *skewed])))
    assert [few.accepted[d, 0] for d in range(3)] == [True, True, False]
    assert [many.accepted[d, 0] for d in range(8)] == [False] * 2 + [True] * 6


def test_a_pass_over_a_part_speaks_of_the_whole_and_contradicts_no_whole_one() -> None:
    """A crest of 400 m, from +6 to -6 %: its first quarter rises by 4.5 %, all of it by nothing."""
    table = street(60.0, 400.0, 60.0)
    rng = np.random.default_rng(5)

    def crest(at: np.ndarray) -> np.ndarray:
        return np.asarray(0.06 - 0.12 * at / 400)

    def drive(part: tuple[float, float] | None) -> list[PassFactor]:
        before = graded(table, 0, lambda at: 0.06 + 0 * at, 0.01, rng)
        return [before, graded(table, 1, crest, 0.01, rng, part=part, sequence=1)]

    quarter = (0.0, 100.0)
    one = adjust(table, {0: drive(quarter)})
    assert abs(one.slope_percent[1]) < 1.96 * one.slope_sigma_percent[1]
    assert one.driven_share[1] == pytest.approx(0.25, abs=0.01)
    mixed = adjust(table, {**{k: drive(quarter) for k in range(3)}, 3: drive(None)})
    assert all(mixed.accepted.values())
    assert abs(mixed.slope_percent[1]) < 0.3
    assert mixed.driven_share[1] == 1.0
    assert mixed.slope_sigma_percent[1] < 0.3 * one.slope_sigma_percent[1]


def test_parts_of_a_segment_are_counted_once_where_they_overlap() -> None:
    table = street(100.0)
    parts = [(0.0, 40.0), (20.0, 50.0), (80.0, 100.0)]
    drives = {k: [graded(table, 0, lambda at: 0 * at, 0.01, part=part)] for k, part in enumerate(parts)}
    assert adjust(table, drives).driven_share[0] == pytest.approx(0.7, abs=1e-6)


def test_laps_of_one_drive_count_as_one_for_what_it_carries() -> None:
    """Ten laps with one tilted sensor know the slope no better than the tilt; ten drives do."""
    table = street(60.0, 70.0)
    tilted = Sensors(np.nan, 0.004, mount=0.02)

    def lap(seed: int) -> list[PassFactor]:
        return driven(table, (0, 1), hill_of(table), tilted, np.random.default_rng(seed))

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
    rng = np.random.default_rng(4)
    both = Sensors(0.01, 0.004, mount=0.06)
    passes = driven(table, range(8), hill_of(table), both, rng)
    pitch = driven(table, range(8), hill_of(table), replace(both, doppler=np.nan), rng)
    mixed = [*passes[:4], *pitch[4:]]
    taught = adjust(table, {0: mixed}).slope_sigma_percent[5:]
    alone = adjust(table, {0: [replace(p, mount=k // 4) for k, p in enumerate(mixed)]}).slope_sigma_percent[
        5:
    ]
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
@pytest.mark.parametrize(("count", "wrong"), [(1, False), (4, False), (4, True)])
def test_true_slopes_lie_within_sigma_as_often_as_sigma_says(count: int, wrong: bool) -> None:
    """Roads drawn from the prior, driven with known noise; the map's nodes lie where they are said to be not, and so do
    all positions of a drive where these are ``wrong``."""
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
                replace(
                    EVERYTHING, mount=float(0.05 * rng.normal()), bias=float(0.01 * rng.normal()),
                    farther_m=float(POSITION_SIGMA_M * rng.normal()) if wrong else 0.0,
                ), rng,
            )
            for d in range(count)
        }  # fmt: skip
        truth = []
        for low, high in itertools.pairwise(edge):
            inside = (at >= low) & (at <= high)
            truth.append(100 * np.polyfit(at[inside], height[inside], 1)[0])
        found = adjust(table, drives)
        ratio.append((found.slope_percent - truth) / found.slope_sigma_percent)
    share = np.mean(np.abs(ratio) <= 1.96)
    assert 0.90 <= share <= 1.0
    assert np.mean(np.abs(ratio) <= 0.5 * 1.96) < 0.97, "sigmas that hold anything"
