"""Which points are one drive."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from app.drives.live.cutting import GAP_M, Piece, cut, distance_m, filename_of, log_of, merged, points_in
from app.drives.live.points import LIMITS, US, LivePoint
from fusion.formats.versant_csv import COLUMNS
from live_senders import BEGAN_S, way

SILENCE_S = 900
SILENCE_US = SILENCE_S * US


def standing(n: int, at: LivePoint, every_s: float = 60.0) -> list[LivePoint]:
    """After that point, and within some metres of it."""
    return [
        at._replace(time_us=at.time_us + round(k * every_s * US), lon_deg=at.lon_deg + 1e-4 * (k % 3))
        for k in range(1, n + 1)
    ]


def test_nothing_is_no_drive() -> None:
    assert cut([], SILENCE_US) == []
    assert cut(way(1), SILENCE_US) == [Piece(0, 1, moved=False, is_over=False)]


def test_a_gap_in_time_ends_a_drive() -> None:
    first, second = way(50), way(50, begin_s=BEGAN_S + 98 + SILENCE_S, first=60)
    assert cut(first + second, SILENCE_US) == [Piece(0, 100, moved=True, is_over=False)]
    later = [p._replace(time_us=p.time_us + 1) for p in second]
    expected = [Piece(0, 50, moved=True, is_over=True), Piece(50, 100, moved=True, is_over=False)]
    assert cut(first + later, SILENCE_US) == expected


def test_a_gap_in_space_ends_a_drive() -> None:
    first = way(50)
    north = round(GAP_M / 30) + 60
    second = way(50, begin_s=BEGAN_S + 100, first=north)
    assert distance_m(first[-1], second[0]) > GAP_M
    assert [piece.is_over for piece in cut(first + second, SILENCE_US)] == [True, False]
    near = way(50, begin_s=BEGAN_S + 100, first=north - 100)
    assert len(cut(first + near, SILENCE_US)) == 1


def test_standing_for_as_long_as_the_silence_ends_a_drive_once() -> None:
    first = way(50)
    parked = standing(60, first[-1])
    second = way(50, begin_s=parked[-1].time_us / US + 2, first=50)
    pieces = cut(first + parked + second, SILENCE_US)
    assert [(piece.moved, piece.is_over) for piece in pieces] == [(True, True), (True, False)]
    assert SILENCE_S / 60 - 8 <= pieces[0].end - 50 <= SILENCE_S / 60 + 1  # its last metres count as standing
    assert pieces[1].begin == pieces[0].end


def test_what_never_moved_is_no_drive_however_long() -> None:
    (piece,) = cut(standing(600, way(1)[0]), SILENCE_US)
    assert (piece.moved, piece.is_over) == (False, False)


def test_the_other_side_of_the_date_line_is_near() -> None:
    (a,) = way(1)
    west, east = a._replace(lon_deg=-179.9999), a._replace(lon_deg=179.9999)
    assert distance_m(west, east) < 20


def test_a_log_has_the_columns_that_were_measured_and_no_others() -> None:
    points = [p._replace(pressure_hpa=None) for p in way(3)]
    points[1] = points[1]._replace(h_acc_m=None)
    lines = log_of(points).decode().splitlines()
    assert lines[0] == ("time_s,lat_deg,lon_deg,height_ell_m,h_acc_m,v_acc_m,speed_mps,s_acc_mps,heading_deg")
    assert lines[1] == "1764231300,48.1,8.2,300.0,4.0,3.0,15.0,0.5,1.0"
    assert lines[2] == "1764231302,48.1002698,8.2,300.9,,3.0,15.0,0.5,1.0"
    assert filename_of("owntracks", "my/phone", points) == "owntracks-my-phone-2025-11-27T08-15Z.csv"


def test_every_column_is_one_that_logs_have() -> None:
    assert set(LivePoint._fields[1:]) <= set(COLUMNS)
    assert set(LIMITS) == set(LivePoint._fields[3:])


number = st.floats(-1e4, 1e4, allow_nan=False)
point = st.builds(
    LivePoint,
    st.integers(0, 2**51),
    number,
    number,
    *[st.none() | number for _ in LivePoint._fields[3:]],
)


@given(st.lists(point, min_size=1, unique_by=lambda one: one.time_us))
def test_what_is_written_is_read_again(points: list[LivePoint]) -> None:
    ordered = sorted(points)
    assert points_in(log_of(ordered)) == ordered
    assert merged(ordered, points) == ordered
