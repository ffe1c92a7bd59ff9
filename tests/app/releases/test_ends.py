"""Where trips end, and what of them is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.releases.ends import (
    FARTHEST_M,
    NEAREST_M,
    SAME_PLACE_M,
    STOP_S,
    Circle,
    Driven,
    Timed,
    apart,
    distance_m,
    ends_of,
    hidden,
    near,
)
from fusion.frames import METRES_PER_DEGREE

LAT = 49.0
EAST_DEG = 1 / (METRES_PER_DEGREE * np.cos(np.radians(LAT)))
"""Degrees of longitude of a metre."""


def east(lon_m: np.ndarray, time_s: np.ndarray | None = None) -> Timed:
    """A drive along a line eastwards, a row each second."""
    times = np.arange(len(lon_m), dtype=float) if time_s is None else time_s
    return Timed(times, 8.0 + lon_m * EAST_DEG, np.full(len(lon_m), LAT))


def places(track: Timed) -> list[float]:
    """Metres east of where it ended or stood."""
    return sorted({round((lon - 8.0) / EAST_DEG) for lon, _ in ends_of(track).tolist()})


def street(count: int = 30, length_m: float = 50.0) -> Driven:
    """Segments eastwards, in the order of driving."""
    k = np.arange(count)
    lon = 8.0 + k * length_m * EAST_DEG
    lat = np.full(count, LAT)
    return Driven(k, k + 500, k, k + 1, lon, lat, lon + length_m * EAST_DEG, lat, 10.0 * k)


def test_a_drive_ends_where_it_begins_and_where_it_ends() -> None:
    assert places(east(10.0 * np.arange(300))) == [0, 2990]


def test_a_stop_is_an_end_and_a_traffic_light_is_none() -> None:
    def stands(seconds: int) -> Timed:
        moving = 10.0 * np.arange(200)
        return east(np.concatenate([moving, np.full(seconds, moving[-1]), moving[-1] + moving]))

    assert places(stands(90)) == [0, 3980]
    assert [round(place, -2) for place in places(stands(200))] == [0, 2000, 4000]


def test_a_recording_that_pauses_ends_on_both_sides() -> None:
    lon_m = np.concatenate([10.0 * np.arange(100), 5000 + 10.0 * np.arange(100)])
    time_s = np.arange(200.0) + np.where(np.arange(200) < 100, 0.0, STOP_S)
    assert places(east(lon_m, time_s)) == [0, 990, 5000, 5990]


def test_what_is_not_known_of_a_drive_is_left_out() -> None:
    track = east(10.0 * np.arange(300))
    track.lon_deg[[0, 150, 299]] = np.nan
    assert places(track) == [10, 2980]
    assert len(ends_of(Timed(*(np.full(3, np.nan) for _ in range(3))))) == 0


def test_ends_nearer_than_a_car_park_are_one_place() -> None:
    ends = np.array([(8.0, LAT), (8.0 + 90 * EAST_DEG, LAT), (8.0 + 300 * EAST_DEG, LAT)])
    assert list(apart(ends)) == [tuple(ends[0]), tuple(ends[2])]


@given(st.floats(-200, 1700), st.floats(NEAREST_M, FARTHEST_M))
def test_nothing_is_told_within_the_radius(at_m: float, radius_m: float) -> None:
    circle, drive = Circle(8.0 + at_m * EAST_DEG, LAT, radius_m), street()
    everywhere = dict.fromkeys(range(40), 3)
    out = set(hidden(drive, [circle], everywhere).tolist())
    for k in range(len(drive)):
        nearest_m = max(50.0 * k - at_m, at_m - 50.0 * (k + 1), 0.0)
        if abs(nearest_m - radius_m) > 0.5:
            assert (k in out) == (nearest_m < radius_m), k


def test_a_cut_is_at_a_junction() -> None:
    drive, circle = street(), Circle(8.0, LAT, 190.0)
    crossing_at = {node: 4 if node in {12, 20} else 2 for node in range(31)}
    assert hidden(drive, [circle], crossing_at).tolist() == list(range(12))
    both = [circle, Circle(8.0 + 1500 * EAST_DEG, LAT, 150.0)]
    assert hidden(drive, both, crossing_at).tolist() == [*range(12), *range(20, 30)]


def test_no_junction_is_looked_for_far_away() -> None:
    drive, circle = street(), Circle(8.0, LAT, 150.0)
    known = dict.fromkeys((segment - 500 + end for segment in near(drive, [circle]) for end in (0, 1)), 2)
    out = hidden(drive, [circle], known)
    assert 3 < len(out) < 20


def test_a_drive_that_comes_by_again_is_hidden_there_as_well() -> None:
    there, back = street(), street()
    columns = {
        name: np.concatenate([getattr(there, name), getattr(back, name)[::-1]])
        for name in vars(there)
        if name != "sequence"
    }
    drive = Driven(sequence=np.arange(60), **columns)
    out = hidden(drive, [Circle(8.0 + 740 * EAST_DEG, LAT, 160.0)], dict.fromkeys(range(40), 3))
    assert set(out.tolist()) == {59 - k for k in out.tolist()}


def test_distances_are_metres() -> None:
    assert distance_m(8.0, LAT, 8.0 + 90 * EAST_DEG, LAT) == pytest.approx(90, rel=1e-6)
    assert distance_m(8.0, LAT, 8.0, LAT + 1e-3) == pytest.approx(111.132)
    assert SAME_PLACE_M < NEAREST_M < FARTHEST_M
