"""Where things lie on a profile's axes: measurements, limits, bearings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.drives.outputs.profile import Profile, RoadFacts
from app.drives.outputs.profile_marks import apart, datum_words, dots_of, limits, placed_m, steps_of
from fusion.types import DrawnMeasurements

UNKNOWN = float("nan")
numbers = st.floats(-1e4, 1e4)


def profile() -> Profile:
    """Forty epochs, 11 m and a second apart, but for 100 s and a kilometre before the twentieth."""
    n = 40
    late = np.arange(n) >= 20
    zero, no = np.zeros(n), np.zeros(n, bool)
    return Profile(
        time_s=np.arange(n) + 100.0 * late,
        lon_deg=zero,
        lat_deg=zero,
        distance_m=11.0 * np.arange(n) + 1000.0 * late,
        alt_m=200 + zero,
        alt_sigma_m=zero,
        slope_percent=zero,
        slope_sigma_percent=zero,
        grade_percent=zero,
        grade_sigma_percent=zero,
        segment_id=np.zeros(n, np.int64),
        forward=np.ones(n, np.int64),
        gap=(np.arange(n) == 0) | (np.arange(n) == 20),
        has_gnss=~no,
        bridge=no,
        tunnel=no,
        dem_height_m=zero,
        road_name=np.full(n, None),
    )


@pytest.mark.parametrize(
    ("end", "bearing"),
    [((8.0, 49.0), 0.0), ((9.0, 48.0), np.pi / 2), ((8.0, 47.0), np.pi), ((7.0, 48.0), -np.pi / 2)],
)
def test_the_bearing_is_clockwise_from_north(end: tuple[float, float], bearing: float) -> None:
    assert RoadFacts((8.0, 48.0), end, bridge=False, tunnel=False).bearing_rad == pytest.approx(bearing)


def test_the_bearing_across_the_date_line() -> None:
    facts = RoadFacts((179.999, 10.0), (-179.999, 10.0), bridge=True, tunnel=False)
    assert (facts.bearing_rad, facts.bridge) == (pytest.approx(np.pi / 2), True)


def test_measurements_lie_on_the_axis_of_the_estimate() -> None:
    p = profile()
    assert placed_m(p, p.time_s) == pytest.approx(p.distance_m)
    halves = placed_m(p, p.time_s[:18] + 0.5)
    assert halves == pytest.approx(0.5 * (p.distance_m[:18] + p.distance_m[1:19]))


def test_measurements_in_an_interruption_are_not_placed_across_it() -> None:
    p = profile()
    at = placed_m(p, np.array([19.4, 60.0, 119.5, 120.0, -50.0, 1e9, p.time_s[-1] + 0.4]))
    nowhere = np.isnan(at)
    assert nowhere.tolist() == [False, True, False, False, True, True, False]
    assert at[~nowhere].tolist() == [p.distance_m[19], p.distance_m[20], p.distance_m[20], p.distance_m[-1]]


def test_a_sensor_without_a_look_is_drawn_by_its_name() -> None:
    p = profile()
    n = len(p)
    foreign = DrawnMeasurements(
        ("foreign sensor",),
        np.zeros(n, np.int64),
        p.time_s,
        p.distance_m,
        np.full(n, 0.03),
        np.zeros(n, bool),
    )
    (one,) = dots_of(p, foreign)
    assert one.label == "foreign sensor"


@given(
    st.lists(st.tuples(numbers, st.floats(0, 1e6) | st.just(UNKNOWN)), min_size=1, max_size=20),
    st.lists(numbers, max_size=5),
)
def test_the_axis_holds_every_estimate_and_stays_near(
    rows: list[tuple[float, float]], behind: list[float]
) -> None:
    value, sigma = np.array(rows).T
    ends = limits(value, sigma, 5.0, np.array(behind, float))
    assert ends is not None
    assert ends[0] <= value.min() <= value.max() <= ends[1]
    assert 5.0 <= ends[1] - ends[0] <= 5 * max(np.ptp(value), 5.0)


def test_no_estimate_has_no_axis() -> None:
    assert limits(np.full(3, UNKNOWN), np.ones(3), 1.0, np.ones(2)) is None


def test_steps_that_the_line_does_not_reach_are_found() -> None:
    """Four segments of ten epochs; the line climbs with 2 % on the first two, then with 0."""
    p = profile()
    k = np.arange(40) // 10
    p = replace(
        p,
        segment_id=k.astype(np.int64),
        grade_percent=np.where(k < 2, 2.0, 0.0),
        slope_percent=np.array([2.1, 3.0, 0.5, -5.0])[k],
        slope_sigma_percent=np.array([0.1, 0.3, 0.3, UNKNOWN])[k],
    )
    steps = steps_of(p)
    assert apart(p, steps).tolist() == [False, True, False, False]
    assert not apart(replace(p, grade_percent=np.full(40, UNKNOWN)), steps).any(), (
        "no line, nothing to differ from"
    )
    nothing = replace(p, slope_percent=np.full(40, UNKNOWN))
    assert apart(nothing, steps_of(nothing)).shape == (0,)


@given(st.integers(0, 39), st.floats(-20, 20), st.floats(0.01, 3))
def test_a_level_line_is_left_as_far_as_the_bar_reaches(epoch: int, slope: float, sigma: float) -> None:
    flat = np.full(40, 1.5)
    segment = np.where(np.arange(40) // 5 == epoch // 5, 7, -1)
    p = replace(
        profile(),
        grade_percent=flat,
        segment_id=segment,
        slope_percent=np.where(segment == 7, slope, UNKNOWN),
    )
    p = replace(p, slope_sigma_percent=np.full(40, sigma))
    off = apart(p, steps_of(p))
    assert abs(abs(slope - 1.5) - 1.96 * sigma) < 1e-6 or off.tolist() == [abs(slope - 1.5) > 1.96 * sigma]


@pytest.mark.parametrize(
    ("report", "words"),
    [
        ({"height_datum": "the WGS 84 ellipsoid", "dem_datum": "EGM96"}, "Heights: the WGS 84 ellipsoid."),
        ({"height_datum": None, "dem_datum": "EGM96"}, "Heights: those of the elevation model (EGM96)."),
        ({}, "What the heights refer to is not known."),
    ],
)
def test_what_heights_refer_to_in_words(report: dict[str, str | None], words: str) -> None:
    assert datum_words(report) == words
