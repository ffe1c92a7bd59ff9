"""What the adjustment says of heights: loops close, the datum is the drives', the steepest stretch is where it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drive_factors import drive_along, street_east
from fusion.network.adjust import adjust
from fusion.network.combine import NETWORK_ONLY
from fusion.network.curve import height_rows, interval_count, variable_count
from fusion.network.drive_beliefs import START_SIGMA_M
from fusion.network.road_beliefs import LEVEL_SIGMA_M
from fusion.network.segment_slopes import KNOWN_SIGMA_M
from fusion.network.steepest import STRETCH_M, steepest
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions
from fusion.types import Floats

LENGTHS = (60.0, 15.0, 100.0, 330.0, 45.0)


def wave(at: Floats) -> Floats:
    """A road that goes up and down by five metres, every 380 m."""
    return np.asarray(200 + 5 * np.sin(at / 60))


def starts(lengths: tuple[float, ...] = LENGTHS) -> Floats:
    return np.concatenate([[0.0], np.cumsum(lengths)])


def test_heights_are_those_of_nodes_and_lie_on_the_drives_datum() -> None:
    table = street_east(*LENGTHS)
    found = adjust(
        table, {0: drive_along(table, wave, offset_m=2.0), 1: drive_along(table, wave, offset_m=4.0)}
    )
    np.testing.assert_array_equal(found.height_to_m[:-1], found.height_from_m[1:])
    np.testing.assert_allclose(found.height_from_m, wave(starts()[:-1]) + 3.0, atol=0.1)
    # Each of the two drives knows its datum to 30 m, and where nothing is known roads lie within LEVEL_SIGMA_M.
    datum_m = (2 / START_SIGMA_M[0] ** 2 + LEVEL_SIGMA_M**-2) ** -0.5
    assert np.all(found.height_sigma_m > datum_m)
    assert np.all(found.height_sigma_m < 31)


def test_heights_are_not_drawn_towards_the_sea() -> None:
    """A pass at 2000 m, which the equations begin to look for at 0, is the same road as one at the coast."""
    table = street_east(*LENGTHS)
    low, high = (
        adjust(table, {0: drive_along(table, lambda at, up=up: wave(at) + up)})  # type: ignore[misc]
        for up in (-200.0, 1800.0)
    )
    np.testing.assert_allclose(low.height_from_m, wave(starts()[:-1]) - 200.0, atol=0.05)
    np.testing.assert_allclose(high.height_from_m - low.height_from_m, 2000.0, atol=0.01)
    assert high.slope_percent == pytest.approx(low.slope_percent, abs=1e-5)
    assert high.height_sigma_m == pytest.approx(low.height_sigma_m, rel=1e-6)


def test_loops_close() -> None:
    """Around a loop the differences of heights add up to nothing."""
    table = street_east(50.0, 50.0, 50.0, 50.0, loop=True)
    found = adjust(table, {0: drive_along(table, lambda at: 100 + 2 * np.sin(np.pi * at / 100))})
    rise = found.height_to_m - found.height_from_m
    assert np.sum(rise) == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(rise) > 1


def test_a_drive_without_heights_gives_slopes_and_no_heights() -> None:
    table = street_east(*LENGTHS)
    found = adjust(table, {0: drive_along(table, wave, altitude_sigma_m=None)})
    assert np.isfinite(found.slope_percent).all()
    assert np.isfinite(found.steepest_percent).all()
    for name in ("height_from_m", "height_to_m", "height_sigma_m"):
        assert np.isnan(getattr(found, name)).all()
    parts = found.parts([1] * len(table))
    assert all(part is not None and part.height_from_m is None for part in parts)


def test_an_elevation_model_brings_heights() -> None:
    table = street_east(*LENGTHS)
    lon, _ = knot_positions(table)
    terrain = Terrain(500.0 + 0.0 * lon)
    found = adjust(table, {0: drive_along(table, lambda at: 0.0 * at, altitude_sigma_m=None)}, terrain)
    assert found.height_from_m == pytest.approx(np.full(len(table), 500.0), abs=2.0)
    assert np.all(found.height_sigma_m < KNOWN_SIGMA_M)


def test_what_is_not_known_is_none_and_nothing_is_lost() -> None:
    table = street_east(*LENGTHS)
    found = adjust(table, {0: drive_along(table, wave, rows=[1])})
    parts = found.parts([0, 1, 0, 0, 0])
    for row, part in enumerate(parts):
        assert part is not None
        assert part.driven_share == (1.0 if row == 1 else 0.0)
        assert part.network
        for name in NETWORK_ONLY:
            assert getattr(part, name) == getattr(found, name)[row]


def search(heights: Floats, grades: Floats, length_m: float) -> tuple[float, float, float]:
    """The steepest stretch of one segment with these knots."""
    knots = np.column_stack([heights, grades]).ravel()
    count = interval_count(np.array([length_m]))
    assert len(knots) == variable_count(length_m)
    grade, begin, end = steepest(knots, np.array([0]), count, np.array([length_m]))
    return float(grade[0]), float(begin[0]), float(end[0])


@settings(max_examples=60)
@given(length_m=st.floats(1.0, 900.0), seed=st.integers(0, 1000))
def test_no_stretch_is_steeper_than_the_steepest(length_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(variable_count(length_m)) // 2
    heights, grades = np.cumsum(rng.normal(0, 1, count)), rng.normal(0, 0.05, count)
    grade, begin, end = search(heights, grades, length_m)
    stretch = min(STRETCH_M, length_m)
    assert end - begin == pytest.approx(stretch)
    assert -1e-9 <= begin <= length_m - stretch + 1e-9
    knots = np.column_stack([heights, grades]).ravel()

    def mean_grade(from_m: Floats) -> Floats:
        up = height_rows(from_m + stretch, length_m) - height_rows(from_m, length_m)
        return np.asarray(up @ knots / stretch)

    assert grade == pytest.approx(mean_grade(np.array([begin]))[0], abs=1e-9)
    everywhere = np.abs(mean_grade(np.linspace(0, length_m - stretch, 3000)))
    assert abs(grade) >= everywhere.max() * 0.99


def test_the_steepest_stretch_of_a_known_road() -> None:
    """A road that is level but for a ramp of 25 m downwards at 10 %; and of an even one the beginning."""
    at = np.linspace(0.0, 100.0, 6)
    grade, begin, end = search(np.interp(at, [40, 60], [2, 0]), np.array([0, 0, -0.1, -0.1, 0, 0.0]), 100.0)
    assert (grade, begin, end) == (pytest.approx(-0.1), pytest.approx(40.0), pytest.approx(60.0))
    assert search(0.03 * at, np.full(6, 0.03), 100.0) == (pytest.approx(0.03), 0.0, STRETCH_M)
    assert search(np.array([0.0, 0.6]), np.array([0.05, 0.05]), 12.0) == (pytest.approx(0.05), 0.0, 12.0)
