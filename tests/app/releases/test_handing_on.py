"""Which rows of a track are left where it is handed on without the ends of the trip."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from app.releases.ends import ON_FROM_THERE_M, Circle, Driven
from app.releases.handing_on import rows_left
from fusion.frames import METRES_PER_DEGREE
from fusion.types import Bools, Track

LAT = 49.0
EAST_DEG = 1 / (METRES_PER_DEGREE * np.cos(np.radians(LAT)))
SEGMENT_M, STEP_M = 50.0, 10.0
PASSES = 40


def street() -> Driven:
    """Segments 500 and on eastwards, one after the other, each in five seconds."""
    k = np.arange(PASSES)
    lon, lat = 8.0 + k * SEGMENT_M * EAST_DEG, np.full(PASSES, LAT)
    return Driven(k, k + 500, k, k + 1, lon, lat, lon + SEGMENT_M * EAST_DEG, lat, 5.0 * k)


def along_the_street(**changed: np.ndarray) -> Track:
    """A row each second along all of it."""
    n = int(PASSES * SEGMENT_M / STEP_M)
    east_m = STEP_M * np.arange(n)
    columns = {spec.name: np.full(n, np.nan) for spec in fields(Track)}
    known = {
        "time_s": np.arange(n, dtype=float),
        "lon_deg": 8.0 + east_m * EAST_DEG,
        "lat_deg": np.full(n, LAT),
        "segment": 500 + (east_m // SEGMENT_M).astype(int),
        "has_gnss": np.ones(n, bool),
        "after_outage": np.zeros(n, bool),
    }
    return Track(**{**columns, **known, **changed})


def left(track: Track, circles: list[Circle], hidden: set[int]) -> Bools:
    drive = street()
    return rows_left(track, drive, np.isin(drive.sequence, list(hidden)), circles)


def runs(rows: Bools) -> list[tuple[int, int]]:
    """First and last row of each stretch that is left."""
    borders = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    return [(begin, end - 1) for begin, end in borders.reshape(-1, 2).tolist()]


START = Circle(8.0, LAT, 165.0)


def test_rows_go_with_the_passes_that_are_told_to_nobody() -> None:
    assert runs(left(along_the_street(), [START], {0, 1, 2, 3, 4, 5, 30})) == [(30, 149), (155, 199)]


def test_no_row_is_left_within_a_circle() -> None:
    rows = left(along_the_street(), [START], set())
    assert runs(rows) == [(17, 199)]


def test_a_row_at_the_border_of_passes_goes_by_its_segment() -> None:
    """Passes are entered between two rows, and perhaps a little later than the track says."""
    late = street()
    drive = Driven(**{**vars(late), "entered_s": late.entered_s + 0.7})
    out = np.isin(drive.sequence, [10, 11])
    assert runs(rows_left(along_the_street(), drive, out, [])) == [(0, 49), (60, 199)]


@pytest.mark.parametrize("unplaced", [range(3), range(20, 35), range(190, 200)])
def test_rows_without_a_place_do_not_tell_when_the_drive_began(unplaced: range) -> None:
    track = along_the_street()
    for column in (track.lon_deg, track.lat_deg):
        column[list(unplaced)] = np.nan
    track.segment[list(unplaced)] = -1
    rows = left(track, [START, Circle(8.0 + 1995 * EAST_DEG, LAT, 160.0)], {*range(6), *range(36, 40)})
    assert not rows[list(unplaced)].any()
    assert rows[40:170].all()


def test_an_outage_between_what_is_left_stays() -> None:
    track = along_the_street()
    track.lon_deg[100:110] = np.nan
    track.segment[100:110] = -1
    assert runs(left(track, [START], set(range(4)))) == [(20, 199)]


def test_rows_on_no_road_are_cut_together_and_not_at_the_circle() -> None:
    track = along_the_street()
    track.segment[:40] = -1
    assert runs(left(track, [START], set())) == [(40, 199)]


def test_rows_on_no_road_are_left_where_it_is_far() -> None:
    track = along_the_street()
    track.segment[:] = -1
    first = int((START.radius_m + ON_FROM_THERE_M) // STEP_M) + 1
    assert runs(left(track, [START], set())) == [(first, 199)]


def test_without_a_place_and_a_road_nothing_is_left() -> None:
    track = along_the_street()
    track.lat_deg[:] = np.nan
    track.segment[:] = -1
    assert not rows_left(track, None, np.zeros(0, bool), []).any()


def test_of_no_rows_none_is_left() -> None:
    empty = Track(**{spec.name: getattr(along_the_street(), spec.name)[:0] for spec in fields(Track)})
    assert left(empty, [START], {0}).shape == (0,)
