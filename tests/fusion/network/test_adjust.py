"""The network adjustment against the same model solved densely, and what must hold whatever the numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_adjustment import DenseAdjustment
from factor_support import (
    ROUGHNESS,
    block_of_streets,
    evidence_of,
    graded,
    in_rows,
    levelled,
    roads,
    steady,
    street,
    unknown,
)
from fusion.network.adjust import SIGMA_FLOOR_PERCENT, Adjustment, adjust
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable


def assert_as_dense(
    table: RoadTable,
    evidence: Sequence[SegmentEvidence | None],
    terrain: np.ndarray | None = None,
    ids: np.ndarray | None = None,
) -> Adjustment:
    """Solve, compare with the dense reference, return the solution."""
    dem = unknown(table) if terrain is None else terrain
    found = adjust(table, evidence, dem, ids)
    slope, sigma = DenseAdjustment(table, evidence, dem, None if ids is None else ids.tolist()).slopes()
    assert found.slope_percent == pytest.approx(slope, abs=2e-5)
    assert found.slope_sigma_percent == pytest.approx(sigma, rel=2e-5)
    return found


def same(left: Adjustment, right: Adjustment, digits: float = 1e-7) -> bool:
    counts = all(
        np.array_equal(getattr(left, c), getattr(right, c)) for c in ("observations", "passes", "rejected")
    )
    return (
        counts
        and np.allclose(left.slope_percent, right.slope_percent, rtol=0, atol=digits)
        and np.allclose(left.slope_sigma_percent, right.slope_sigma_percent, rtol=digits, atol=0)
    )


def hilly(row: int, at: np.ndarray) -> np.ndarray:
    """Grades of a road that waves, another wave on every row."""
    return np.asarray(0.05 * np.sin(row + at / 40))


def along(start: float, at: np.ndarray, grade: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The grade of a segment that begins at ``start`` of a road given at many places."""
    return lambda distance: np.interp(start + distance, at, grade)


def waves(
    table: RoadTable, seed: int, rows: Sequence[int] | None = None, sigma: float = 0.02
) -> list[PassFactor]:
    """One noisy pass over each of the rows."""
    rng = np.random.default_rng(seed)
    return [
        graded(table, row, lambda at, row=row: hilly(row, at), sigma, rng)  # type: ignore[misc]
        for row in (range(len(table)) if rows is None else rows)
    ]


def test_a_street_of_short_segments() -> None:
    table = street(15.0, 18.0, 12.0, 19.0)
    assert_as_dense(table, in_rows(table, waves(table, 1) + waves(table, 2)))


def test_segments_of_many_intervals() -> None:
    table = street(45.0, 130.0, 330.0)
    assert_as_dense(table, in_rows(table, waves(table, 1)))


def test_gaps_of_one_and_of_many_intervals() -> None:
    table = street(45.0, 18.0, 70.0, 33.0, 95.0, 80.0)
    assert_as_dense(table, in_rows(table, waves(table, 1, (0, 2, 5))))


def test_a_block_of_streets_with_undriven_ones() -> None:
    table = block_of_streets(3, 3)
    assert_as_dense(table, in_rows(table, waves(table, 1, range(len(table) - 3))))


def test_passes_that_cover_different_parts_of_a_segment() -> None:
    table = street(100.0, 60.0)
    rng = np.random.default_rng(1)
    parts = [(0.0, 15.0), (82.0, 100.0), (30.0, 30.5)]
    passes = [graded(table, 0, lambda at: 0.03 + 0 * at, 0.01, rng, part=part) for part in parts]
    for count in (1, 2, 3):
        assert_as_dense(table, in_rows(table, passes[:count]))
    assert_as_dense(table, in_rows(table, passes[2:]))


def test_terrain_away_from_structures() -> None:
    points = {k: (80.0 * k, 0.0) for k in range(7)}
    table = roads(points, [(k, k + 1) for k in range(6)], bridge=[False] * 4 + [True, False])
    terrain = np.array([4.0, np.nan, -3.0, 8.0, 30.0, -30.0])
    found = assert_as_dense(table, in_rows(table, waves(table, 1, (0, 3))), terrain)
    blind = np.where([True, True, True, False, False, False], terrain, np.nan)
    unaware = adjust(table, in_rows(table, waves(table, 1, (0, 3))), blind)
    assert same(found, unaware), "on a structure and beside it the terrain says nothing about the road"


def test_terrain_on_long_segments_counts_more() -> None:
    table = street(60.0, 240.0)
    found = assert_as_dense(table, in_rows(table, waves(table, 1, (0,), 0.2)), np.array([2.0, 2.0]))
    assert found.slope_sigma_percent[1] < 2.5


def test_heights_with_history_inside_the_window() -> None:
    table = street(40.0, 50.0, 60.0, 30.0)
    chains = [(0,), (0, 1), (0, 1, 2), (1, 2, 3), (3,), (3, 2), (3, 2, 1)]
    rng = np.random.default_rng(4)
    offset = np.concatenate([[0.0], np.cumsum(table.length_m)])
    passes = [levelled(table, c, lambda row, at: 0.03 * (offset[row] + at), 0.1, rng) for c in chains]
    found = assert_as_dense(table, in_rows(table, passes))
    assert np.abs(found.slope_percent - 3.0).max() < 1.0


def test_history_outside_the_window_is_marginalised() -> None:
    """Ids that are not rows, as in a database; the history of some factors is not among them."""
    table = street(40.0, 50.0, 60.0, 30.0, 55.0)
    offset = np.concatenate([[0.0], np.cumsum(table.length_m)])
    rng = np.random.default_rng(5)
    chains = [(0, 1), (0, 1, 2), (1, 2, 3), (2, 3), (2, 3, 4), (4, 3), (4, 3, 2)]
    passes = [levelled(table, c, lambda row, at: 0.03 * (offset[row] + at), 0.05, rng) for c in chains]
    ids = np.array([1007, 1003, 1009, 1001, 1005])
    stored = [replace(p, segments=tuple(int(ids[s]) for s in p.segments)) for p in passes]
    known = evidence_of(stored)
    inside = np.array([False, False, True, True, True])
    part = assert_as_dense(
        table.subset(inside),
        [known.get(i) for i in ids[inside].tolist()],
        unknown(table)[inside],
        ids[inside],
    )
    whole = adjust(table, [known.get(i) for i in ids.tolist()], unknown(table), ids)
    # Two factors of row 2 lose their history; what the rest says stays, and nothing is claimed that is not known.
    assert np.all(part.slope_sigma_percent > 0.99 * whole.slope_sigma_percent[2:])
    assert part.slope_sigma_percent[0] > 1.01 * whole.slope_sigma_percent[2]
    assert np.abs(part.slope_percent - whole.slope_percent[2:]).max() < 1.0


def test_parts_that_are_not_joined() -> None:
    points = {0: (0.0, 0.0), 1: (50.0, 0.0), 2: (500.0, 0.0), 3: (560.0, 0.0), 4: (600.0, 20.0)}
    table = roads(points, [(0, 1), (2, 3), (3, 4)])
    both = assert_as_dense(table, in_rows(table, waves(table, 1)))
    first = np.array([True, False, False])
    alone = adjust(table.subset(first), in_rows(table, waves(table, 1))[:1], np.full(1, np.nan))
    assert both.slope_percent[0] == pytest.approx(alone.slope_percent[0], abs=1e-9)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_any_small_network(seed: int) -> None:
    """Streets of any length and direction, driven or not, in part or whole, by passes of any quality."""
    rng = np.random.default_rng(seed)
    table = block_of_streets(3, int(rng.integers(1, 4)), float(rng.uniform(12.0, 75.0)))
    passes = []
    for row, length in enumerate(table.length_m.tolist()):
        for _ in range(int(rng.integers(0, 4))):
            low, high = np.sort(rng.uniform(0, length, 2))
            part = (float(low), float(high)) if high - low > 3 and rng.random() < 0.5 else None
            quality, rough = float(10 ** rng.uniform(-3, -1)), float(10 ** rng.uniform(-6, -4))
            passes.append(
                graded(table, row, lambda at, r=row: hilly(r, at), quality, rng, part=part, roughness=rough)  # type: ignore[misc]
            )
    terrain = np.where(rng.random(len(table)) < 0.7, rng.normal(0.0, 5.0, len(table)), np.nan)
    assert_as_dense(table, in_rows(table, passes), terrain)


# What must hold whatever the numbers


def test_nothing_to_solve() -> None:
    found = adjust(RoadTable.empty(), [], np.empty(0))
    assert len(found.slope_percent) == len(found.slope_sigma_percent) == len(found.observations) == 0


def test_the_order_of_drives_does_not_matter() -> None:
    table = block_of_streets(3, 3)
    drives = [waves(table, seed) for seed in range(4)]
    first = adjust(table, in_rows(table, [f for d in drives for f in d]), unknown(table))
    turned = adjust(table, in_rows(table, [f for d in drives[::-1] for f in d[::-1]]), unknown(table))
    assert same(first, turned)


def test_deleting_a_drive_restores_every_bit() -> None:
    table = block_of_streets(3, 2)
    stored = list(enumerate(f for seed in range(3) for f in waves(table, seed)))
    gone = list(enumerate(waves(table, 9), start=len(stored)))

    def by_row(passes: list[tuple[int, PassFactor]], row: int) -> list[tuple[int, PassFactor]]:
        return [p for p in passes if p[1].segments[-1] == row]

    before = [SegmentEvidence.build(by_row(stored, row)) for row in range(len(table))]
    with_it = [one.with_passes(by_row(gone, row), dict(stored)) for row, one in enumerate(before)]
    after = [SegmentEvidence.build(by_row(stored, row)[::-1]) for row in range(len(table))]
    start, between, end = (adjust(table, e, unknown(table)) for e in (before, with_it, after))
    assert not same(start, between, 1e-3)
    for name in ("slope_percent", "slope_sigma_percent", "observations", "passes", "rejected"):
        assert np.array_equal(getattr(start, name), getattr(end, name)), name


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
                )
            )
        terrain = np.array([2.0, 1.0, np.nan, -1.0]) * np.where(backwards, -1, 1)
        return adjust(table, in_rows(table, passes), terrain)

    usual = solved([False] * 4)
    for backwards in ([True] * 4, [False, True, False, True], [True, False, True, False]):
        turned = solved(backwards)
        sign = np.where(backwards, -1.0, 1.0)
        assert turned.slope_percent == pytest.approx(sign * usual.slope_percent, abs=1e-6)
        assert turned.slope_sigma_percent == pytest.approx(usual.slope_sigma_percent, rel=1e-6)


def test_roads_that_cross_on_different_layers_know_nothing_of_each_other() -> None:
    points = {0: (-60.0, 0.0), 1: (60.0, 0.0), 2: (0.0, -60.0), 3: (0.0, 60.0)}
    table = roads(points, [(0, 1), (2, 3)], layer=[1, 0], bridge=[True, False])
    below = [steady(table, 1, 2.0)]
    quiet = adjust(table, in_rows(table, [steady(table, 0, 0.0), *below]), unknown(table))
    steep = adjust(table, in_rows(table, [steady(table, 0, 14.0), *below]), unknown(table))
    assert steep.slope_percent[0] > 10
    assert steep.slope_percent[1] == pytest.approx(quiet.slope_percent[1], abs=1e-9)
    assert steep.slope_sigma_percent[1] == pytest.approx(quiet.slope_sigma_percent[1], rel=1e-9)


@pytest.mark.parametrize("gap", [(20.0,), (60.0,), (30.0, 80.0, 25.0)])
def test_a_gap_between_driven_segments_is_guessed_with_less_certainty(gap: tuple[float, ...]) -> None:
    table = street(60.0, *gap, 60.0)
    ends = (0, len(table) - 1)
    drive = [steady(table, row, slope, 0.005) for row, slope in zip(ends, (3.0, 5.0), strict=True)]
    found = adjust(table, in_rows(table, drive), unknown(table))
    inner = found.slope_percent[1:-1]
    assert np.all((inner > 2.5) & (inner < 5.5))
    assert np.all(found.slope_sigma_percent[1:-1] > found.slope_sigma_percent[list(ends)].max())
    assert np.all(found.slope_sigma_percent[1:-1] < 5.0)
    assert found.observations[1:-1].tolist() == found.passes[1:-1].tolist() == [0] * len(gap)
    assert np.all(found.observations[list(ends)] > 0)


def test_copies_of_a_drive_make_sigma_smaller_down_to_the_floor() -> None:
    table = street(60.0, 50.0, 70.0)
    drive = waves(table, 3, sigma=0.03)
    sigma = [
        adjust(table, in_rows(table, drive * copies), unknown(table)).slope_sigma_percent
        for copies in (1, 10, 100, 1000)
    ]
    assert np.all(np.diff(sigma, axis=0) < 0)
    assert np.all(sigma[1] < 0.6 * sigma[0])
    assert np.all(np.array(sigma) > SIGMA_FLOOR_PERCENT)
    assert sigma[-1] == pytest.approx(np.full(3, SIGMA_FLOOR_PERCENT), rel=0.2)


def test_a_drive_that_contradicts_the_others_is_rejected_and_counted() -> None:
    table = street(60.0, 50.0, 70.0, 40.0)
    fair = [f for seed in range(4) for f in waves(table, seed, sigma=0.01)]
    rng = np.random.default_rng(8)
    skewed = [
        graded(table, row, lambda at, r=row: hilly(r, at) + 0.05, 0.01, rng)  # type: ignore[misc]
        for row in range(len(table))
    ]
    without = adjust(table, in_rows(table, fair), unknown(table))
    found = adjust(table, in_rows(table, fair + skewed), unknown(table))
    assert found.rejected.tolist() == [1] * 4
    assert found.passes.tolist() == [4] * 4
    assert found.observations.tolist() == without.observations.tolist()
    assert found.slope_percent == pytest.approx(without.slope_percent, abs=1e-9)
    assert found.slope_sigma_percent == pytest.approx(without.slope_sigma_percent, rel=1e-9)


def test_drives_that_scatter_are_trusted_less() -> None:
    table = street(60.0)
    agreeing = [steady(table, 0, 3.0) for _ in range(4)]
    scattered = [steady(table, 0, slope) for slope in (1.5, 2.5, 3.5, 4.5)]
    quiet, loud = (adjust(table, in_rows(table, f), unknown(table)) for f in (agreeing, scattered))
    assert quiet.slope_percent[0] == pytest.approx(loud.slope_percent[0], abs=0.02)
    assert loud.slope_sigma_percent[0] > 1.2 * quiet.slope_sigma_percent[0]


def test_many_drives_over_a_long_hilly_road_stay_solvable() -> None:
    """A thousand precise drives beside gaps that nobody drove: the weights span ten orders of magnitude."""
    table = street(*[55.0] * 40)
    driven = [row for row in range(40) if row % 5]
    once = [levelled(table, (row,), lambda _, at: 0.12 * at, 0.002) for row in driven]
    many = [replace(f, information=1000 * f.information, vector=1000 * f.vector) for f in once]
    found = adjust(table, in_rows(table, many), unknown(table))
    assert found.slope_percent[driven] == pytest.approx(np.full(32, 12.0), abs=0.01)
    assert found.slope_sigma_percent[driven] == pytest.approx(np.full(32, SIGMA_FLOOR_PERCENT), rel=0.06)
    assert np.all(np.abs(found.slope_percent - 12.0) < 1.96 * found.slope_sigma_percent)


@pytest.mark.slow
def test_true_slopes_lie_within_sigma_as_often_as_sigma_says() -> None:
    """Roads drawn from the prior itself, measured with known noise: 95 % within 1.96 sigma, never far fewer."""
    rng = np.random.default_rng(12)
    ratio = []
    for _ in range(40):
        lengths = rng.uniform(12.0, 90.0, 12)
        table = street(*lengths.tolist())
        step, edge = 0.25, np.concatenate([[0.0], np.cumsum(table.length_m)])
        at = np.arange(0.0, edge[-1] + 1.0, step)
        # ROUGHNESS is what a drive learns in quiet stretches; the adjustment takes roads for twice as rough.
        grade = rng.normal(0, 0.04) + np.cumsum(np.sqrt(2 * ROUGHNESS * step) * rng.normal(size=len(at)))
        height = np.cumsum(grade) * step
        passes, truth = [], []
        for row in range(len(table)):
            inside = (at >= edge[row]) & (at <= edge[row + 1])
            truth.append(100 * np.polyfit(at[inside], height[inside], 1)[0])
            for _ in range(int(rng.integers(0, 3)) if row not in (0, 11) else 1):
                passes.append(graded(table, row, along(edge[row], at, grade), 0.03, rng))
        found = adjust(table, in_rows(table, passes), unknown(table))
        ratio.append((found.slope_percent - truth) / found.slope_sigma_percent)
    share = np.mean(np.abs(ratio) <= 1.96)
    assert 0.90 <= share <= 0.99
    assert 0.7 < np.sqrt(np.mean(np.square(ratio))) < 1.15
