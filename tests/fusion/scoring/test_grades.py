"""Errors of grade by length, where the answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.scoring.grades import LENGTHS_M, grade_scores, height_offset_m
from fusion.scoring.made import STEP_M, made_reference
from fusion.scoring.profiles import PROFILE_GAP_M, Heights, Profile, Reference
from fusion.simulate.scene.town import make_town

ALONG = np.arange(0.0, 20_000.0, 5.0)


def reference(slope_percent: float = 5.0) -> Reference:
    return Reference.of("straight", Profile(slope_percent / 100 * ALONG, ALONG))


def heights(height_m: object, gap_m: float = PROFILE_GAP_M) -> Heights:
    return Heights.of(ALONG, np.asarray(height_m, float), gap_m)


def test_a_steeper_profile_is_off_by_its_difference_at_every_length() -> None:
    for one in grade_scores(reference(), heights(0.06 * ALONG + 40.0)):
        figures = (one.rms_percent, one.median_percent, one.bias_percent, one.p95_percent)
        assert figures == pytest.approx([1.0] * 4)
        assert one.rise_rms_m == pytest.approx(one.length_m / 100)
        assert one.coverage == 1.0
    assert height_offset_m(reference(0.0), heights(np.full(len(ALONG), 40.0))) == 40.0


def test_noise_counts_less_the_longer_the_stretch() -> None:
    rng = np.random.default_rng(2)
    noisy = heights(0.05 * ALONG + rng.normal(0, 0.7, len(ALONG)))
    for one in grade_scores(reference(), noisy, (50.0, 200.0)):
        assert one.rms_percent == pytest.approx(100 * 0.7 * np.sqrt(2) / one.length_m, rel=0.1)
        assert one.p95_percent == pytest.approx(1.96 * one.rms_percent, rel=0.1)
        assert abs(one.bias_percent) < one.rms_percent / 5


def test_a_level_road_is_off_by_the_reference_itself() -> None:
    assert [one.rms_percent for one in grade_scores(reference(), None)] == pytest.approx(
        [5.0] * len(LENGTHS_M)
    )


def test_gaps_are_not_bridged_and_lower_the_coverage() -> None:
    beyond = (ALONG > 5000) & (ALONG < 15_000)
    (one,) = grade_scores(reference(), heights(np.where(beyond, np.nan, 0.05 * ALONG)), (100.0,))
    assert one.coverage == pytest.approx(0.5, abs=0.01)
    assert one.rms_percent == pytest.approx(0, abs=1e-9)
    (none,) = grade_scores(reference(), heights(np.full(len(ALONG), np.nan)), (100.0,))
    assert (none.stretches, np.isnan(none.rms_percent)) == (0, True)
    (longer,) = grade_scores(reference(), heights(0.05 * ALONG), (1e6,))
    assert (longer.possible, np.isnan(longer.coverage)) == (0, True)
    known = heights([0.0, 10.0, *[np.nan] * (len(ALONG) - 3), 20.0])
    assert known.at(np.array([-1.0, 2.5, 5.0, 7.0, ALONG[-1], 1e9])) == pytest.approx(
        [np.nan, 5, 10, np.nan, 20, np.nan], nan_ok=True
    )
    assert known.known_m == 5.0


def test_a_made_reference_is_the_road_of_its_town() -> None:
    town, profile = make_town(1), made_reference("town-1")
    assert profile.places_deg is not None
    assert profile.along_m is not None
    assert profile.along_m[:3] == pytest.approx([0, STEP_M, 2 * STEP_M])
    again = made_reference("town-1")
    assert np.array_equal(again.height_m, profile.height_m)
    assert not np.array_equal(made_reference("town-2").height_m[:100], profile.height_m[:100])
    x, y = town.projection.to_xy(*profile.places_deg.T)
    # Streets follow the ground but for bridges, tunnels and what builders level.
    assert np.median(np.abs(profile.height_m - town.height(x, y))) < 1.0
    grade = np.diff(profile.height_m) / STEP_M
    assert 0.01 < np.sqrt(np.mean(grade**2)) < 0.08
    assert np.abs(grade).max() < 0.25
