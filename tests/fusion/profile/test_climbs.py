"""Ascent, the steepest stretch and climbs: by hand, by what must hold of any profile, and by slower ways."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.profile.climbs import (
    LEAST_GAIN_M,
    LOSS_M,
    RAMP_PERCENT,
    SMOOTHED_TURN_M,
    STEEPEST_M,
    HeightLine,
    ascent,
    category,
    climbs,
    height_lines,
    steepest,
    turns,
)
from fusion.types import Floats

STEP_M = 10.0
profiles = st.lists(st.floats(-8, 8), min_size=1, max_size=80).map(lambda steps: np.cumsum([200.0, *steps]))
"""Heights at every 10 m: hills of any kind."""


def line(height_m: Floats, sigma_m: float = 1.0, grade_sigma_percent: float = 0.5) -> HeightLine:
    """Heights that a method smoothed, one at every 10 m."""
    n = len(height_m)
    return HeightLine(
        STEP_M * np.arange(n),
        np.asarray(height_m, float),
        np.full(n, sigma_m),
        np.full(n, grade_sigma_percent),
    )


def road(*parts: tuple[float, float]) -> HeightLine:
    """A road of parts: length (m) and grade (percent) of each."""
    steps = np.concatenate([np.full(round(length / STEP_M), grade / 100 * STEP_M) for length, grade in parts])
    return line(np.r_[0.0, np.cumsum(steps)] + 100)


def by_pairs(height_m: Floats, least_m: float) -> tuple[float, float]:
    """Ascent and descent another way: the smallest swing between two turns is taken out while it is too small."""
    heights = list(height_m)
    if max(heights) - min(heights) < least_m:
        heights = [heights[0], heights[-1]]
    while True:
        heights = [h for k, h in enumerate(heights) if k == 0 or h != heights[k - 1]]
        heights = [
            h
            for k, h in enumerate(heights)
            if k in {0, len(heights) - 1} or (h - heights[k - 1]) * (heights[k + 1] - h) < 0
        ]
        inner = [(abs(a - b), k) for k, (a, b) in enumerate(pairwise(heights)) if 0 < k < len(heights) - 2]
        if not inner or min(inner)[0] >= least_m:
            break
        del heights[min(inner)[1] : min(inner)[1] + 2]
    steps = np.diff(heights)
    return float(steps[steps > 0].sum()), float(-steps[steps < 0].sum())


@given(profiles)
def test_ascent_less_descent_is_what_the_ends_differ_by_and_turns_round_on_the_way_back(
    heights: Floats,
) -> None:
    there, back = ascent([line(heights)]), ascent([line(heights[::-1])])
    assert there.up_m - there.down_m == pytest.approx(heights[-1] - heights[0], abs=1e-6)
    assert (back.up_m, back.down_m) == (pytest.approx(there.down_m), pytest.approx(there.up_m))
    assert (back.up_sigma_m, back.down_sigma_m) == (
        pytest.approx(there.down_sigma_m),
        pytest.approx(there.up_sigma_m),
    )


@given(profiles, st.sampled_from([-50.0, 50.0]), st.sampled_from([-50.0, 50.0]))
def test_ascent_is_that_of_another_way(heights: Floats, before_m: float, after_m: float) -> None:
    """Both ways agree on all turns but those next to the ends, where less than the least may count or not."""
    whole = np.r_[heights[0] + before_m, heights, heights[-1] + after_m]
    found = ascent([line(whole)])
    assert (found.up_m, found.down_m) == pytest.approx(by_pairs(whole, SMOOTHED_TURN_M))
    part, other = ascent([line(heights)]), by_pairs(heights, SMOOTHED_TURN_M)
    assert abs(part.up_m - other[0]) <= SMOOTHED_TURN_M + 1e-6


@given(profiles, st.floats(0.5, 20))
def test_between_turns_every_rise_and_fall_counts(heights: Floats, least_m: float) -> None:
    rows = turns(heights, least_m)
    assert (rows[0], rows[-1]) == (0, len(heights) - 1)
    assert (np.abs(np.diff(heights[rows]))[1:-1] >= least_m).all()


def test_noise_is_no_ascent() -> None:
    noise = np.random.default_rng(1).normal(0, 0.2, 5000)
    assert ascent([line(200 + noise)]).up_m < 1
    raw = line(200 + 6 * noise, grade_sigma_percent=np.nan)
    assert ascent([raw]).up_m < 10
    assert np.abs(np.diff(noise)).sum() / 2 > 500, "what a plain sum of rises would say"


def test_the_sigma_of_ascent_holds() -> None:
    """Heights whose errors fade over 500 m, as a smoother's do."""
    rng = np.random.default_rng(2)
    along = STEP_M * np.arange(1500)
    true = 200 + 30 * np.sin(along / 900) + 12 * np.sin(along / 310 + 1)
    fade, sigma = np.exp(-STEP_M / 500), 1.0
    within = []
    for _ in range(200):
        error = np.empty(len(true))
        error[0] = rng.normal(0, sigma)
        for k, step in enumerate(rng.normal(0, sigma * np.sqrt(1 - fade**2), len(true) - 1)):
            error[k + 1] = fade * error[k] + step
        smooth = np.convolve(np.pad(error, 12, mode="edge"), np.ones(25) / 25, "valid")
        found, exact = ascent([line(true + smooth, sigma)]), ascent([line(true)])
        within.append(abs(found.up_m - exact.up_m) < 1.96 * found.up_sigma_m)
    assert np.mean(within) >= 0.9
    assert ascent([line(true, np.nan)]).up_m > 100
    assert np.isnan(ascent([line(true, np.nan)]).up_sigma_m)


def test_nothing_is_counted_across_an_interruption_and_standing_is_no_distance() -> None:
    along = np.array([0, 10, 10, 10, 20, 900, 910, 920.0])
    height = np.array([100, 101, 103, 102, np.nan, 300, 305, 310])
    starts = np.arange(8) == 5
    parts = height_lines(along, height, np.ones(8), np.ones(8), starts)
    assert [part.along_m.tolist() for part in parts] == [[0, 10], [900, 910, 920]]
    assert parts[0].height_m.tolist() == [100, 102]
    assert ascent(parts).up_m == pytest.approx(12)
    assert height_lines(along[:1], height[:1], np.ones(1), np.ones(1), starts[:1]) == []
    assert ascent([]).up_m == 0


def test_the_steepest_stretch_by_hand() -> None:
    found = steepest([road((500, 2), (100, -9), (300, 6), (80, 9.5))])
    assert found is not None
    assert (found.from_m, found.to_m) == pytest.approx((500, 600))
    assert (found.percent, found.sigma_percent) == pytest.approx((-9, 0.5))
    assert steepest([road((90, 5))]) is None
    assert steepest([]) is None


@given(profiles)
def test_the_steepest_stretch_is_found_and_is_the_same_on_the_way_back(heights: Floats) -> None:
    there, back = steepest([line(heights)]), steepest([line(heights[::-1])])
    if len(heights) < 11:
        assert there is None is back
        return
    grades = (heights[10:] - heights[:-10]) / STEEPEST_M * 100
    assert there is not None
    assert back is not None
    assert (
        abs(there.percent)
        == pytest.approx(np.abs(grades).max(), abs=1e-6)
        == pytest.approx(abs(back.percent))
    )


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([(500, 0), (1000, 8.5), (500, 0)], [(500, 1500, "4")]),
        ([(500, 0), (4000, 8.5), (500, -8)], [(500, 4500, "2")]),
        ([(2000, 1), (1000, 8.5)], [(2000, 3000, "4")]),
        ([(5000, 3.3)], [(0, 5000, "3")]),
        ([(5000, 2.9)], []),
        ([(600, 5.5)], []),
        ([(700, 5.5)], [(0, 700, None)]),
        ([(1000, 8.5), (400, 0), (1000, 8.5)], [(0, 2400, "3")]),
        ([(1000, 8.5), (600, 0), (1000, 8.5)], [(0, 1000, "4"), (1600, 2600, "4")]),
        ([(1000, 8.5), (100, -6), (1000, 8.5)], [(0, 2100, "3")]),
        ([(1000, 8.5), (200, -8), (1000, 8.5)], [(0, 1000, "4"), (1200, 2200, "4")]),
        ([(5000, 8.5), (1000, 0), (5000, 8.5)], [(0, 11_000, "HC")]),
        ([(1000, -8), (3000, 1)], []),
    ],
    ids=str,
)
def test_climbs_by_hand(
    parts: list[tuple[float, float]], expected: list[tuple[float, float, str | None]]
) -> None:
    """A road's parts, and the climbs on it: small dips and flats belong to a climb, greater ones end it."""
    found = climbs([road(*parts)])
    assert [(round(one.from_m), round(one.to_m), one.category) for one in found] == expected


def test_what_is_said_of_a_climb() -> None:
    (one,) = climbs([road((300, -2), (1000, 6), (100, 12), (500, 4), (1000, -5))])
    assert (one.from_m, one.to_m, one.gain_m) == pytest.approx((300, 1900, 92))
    assert one.percent == pytest.approx(5.75)
    assert one.sigma_percent == pytest.approx(100 * np.sqrt(2) / 1600)
    assert (one.steepest.from_m, one.steepest.percent) == pytest.approx((1300, 12))
    assert one.steepest.sigma_percent == pytest.approx(0.5)


@given(profiles)
def test_of_any_profile_climbs_are_what_the_rule_says(heights: Floats) -> None:
    of = line(heights)
    found = climbs([of])
    above = heights - RAMP_PERCENT / 100 * of.along_m
    covered = np.zeros(len(heights), bool)
    for one in found:
        foot, top = round(one.from_m / STEP_M), round(one.to_m / STEP_M)
        assert not covered[foot + 1 : top].any(), "they never overlap"
        covered[foot : top + 1] = True
        assert one.gain_m == pytest.approx(heights[top] - heights[foot])
        assert one.gain_m >= LEAST_GAIN_M - 1e-6
        assert (above[foot : top + 1] >= above[foot] - 1e-6).all(), "no beginning below the ramp"
        assert (above[foot : top + 1] <= above[top] + 1e-6).all(), "no end below the ramp"
        assert one.steepest.percent >= one.percent - 1e-6 or one.to_m - one.from_m > STEEPEST_M
    for foot in range(len(heights)):
        for top in range(foot + 1, len(heights)):
            loss = np.maximum.accumulate(above[foot : top + 1]) - above[foot : top + 1]
            climbs_on = loss.max() < LOSS_M and (above[foot + 1 : top + 1] > above[foot]).all()
            if climbs_on and heights[top] - heights[foot] >= LEAST_GAIN_M + 1e-6:
                assert covered[foot : top + 1].any(), "none is passed over"


def test_categories() -> None:
    scores = (3500, 7999, 8000, 16_000, 32_000, 63_999, 64_000, 80_000)
    assert [category(one) for one in scores] == [None, None, "4", "3", "2", "2", "1", "HC"]
