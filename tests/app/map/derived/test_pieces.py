"""Lines cut into pieces, and tiles made of them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from app.map.derived.chains import Course
from app.map.derived.drawing import LEVELS, ROOM_BYTES, Piece, Stretches, cut, pieces_of
from app.map.derived.drawn_store import Ends, all_roads, changed_tiles, greater_roads, stretches_of

NAN = math.nan
FINE, MIDDLE, COARSE = LEVELS[12], LEVELS[10], LEVELS[8]


def stretches(*roads: dict[str, Any]) -> Stretches:
    """Roads of two or more ``points``, 100 m long if nothing else is said."""
    usual = {
        "highway": "primary",
        "oneway": 0,
        "length_m": 100.0,
        "slope_percent": NAN,
        "sigma_percent": NAN,
        "drives": 0,
    }
    rows = [usual | road for road in roads]
    columns = {name: np.array([row[name] for row in rows]) for name in usual}
    columns["highway"] = columns["highway"].astype(object)
    return Stretches(
        ids=np.arange(1, len(rows) + 1),
        **columns,  # type: ignore[arg-type]
        points=np.array([point for row in rows for point in row["points"]], float).reshape(-1, 2),  # type: ignore[type-var]
        first=np.cumsum([0, *(len(row["points"]) for row in rows)]),
    )


def street(n: int, **columns: Any) -> Stretches:
    """n stretches one after the other, to the east."""
    return stretches(*({"points": [(100 * k, 0), (100 * k + 100, 0)], **columns} for k in range(n)))


def course(roads: Stretches, turned: bool = False) -> list[Course]:
    rows = list(range(len(roads)))
    return [Course(rows[::-1] if turned else rows, [turned] * len(rows))]


def drawn(piece: Piece) -> list[tuple[float, float]]:
    return [tuple(point) for point in shapely.get_coordinates(shapely.from_wkb(piece.geom_3857)).tolist()]


LINES = st.lists(st.tuples(st.floats(1, 150), st.booleans()), min_size=1, max_size=30)


@given(LINES)
def test_lines_are_cut_where_they_are_too_long_or_change(line: list[tuple[float, bool]]) -> None:
    length, measured = [m for m, _ in line], [known for _, known in line]
    pieces = cut(length, measured, 300.0, 30.0)
    assert [piece[0] for piece in pieces] == [0, *(piece[1] for piece in pieces[:-1])]
    assert pieces[-1][1] == len(line)
    for start, end, known in pieces:
        assert start < end
        assert sum(length[start:end]) <= 300.0 or end == start + 1
        assert not known or any(measured[start:end])
    # Whatever is long enough to be seen is told as it is.
    k = 0
    while k < len(line):
        end = k
        while end < len(line) and measured[end] == measured[k]:
            end += 1
        if sum(length[k:end]) >= 30.0 and min(length) >= 30.0:
            assert all(known == measured[k] for a, b, known in pieces if a < end and b > k)
        k = end
    short = cut([5.0, 4.0], [True, True], 300.0, 30.0)
    assert short == [(0, 2, True)]


def test_a_bit_goes_with_what_is_beside_it() -> None:
    assert cut([100, 20, 100], [True, False, True], 300.0, 30.0) == [(0, 3, True)]
    assert cut([100, 20, 100], [False, True, False], 300.0, 30.0) == [(0, 3, False)]
    assert cut([100, 40, 100], [True, False, True], 300.0, 30.0) == [
        (0, 1, True),
        (1, 2, False),
        (2, 3, True),
    ]
    assert cut([25, 20], [True, False], 300.0, 30.0) == [(0, 2, True)]


def test_slopes_are_along_the_line() -> None:
    one = {"slope_percent": 2.0, "sigma_percent": 0.3, "drives": 4}
    two = {"slope_percent": -5.0, "sigma_percent": 0.6, "drives": 2, "length_m": 50.0}
    roads = stretches({"points": [(0, 0), (100, 0)], **one}, {"points": [(150, 0), (100, 0)], **two})
    (there,) = pieces_of(FINE, [Course([0, 1], [False, True])], roads)
    (back,) = pieces_of(FINE, [Course([1, 0], [False, True])], roads)
    assert there.slope_percent == pytest.approx((200 + 250) / 150)
    assert back.slope_percent == -there.slope_percent
    assert there.slope_sigma_percent == back.slope_sigma_percent == pytest.approx(0.4)
    assert there.drives == 2
    assert there.segment_id == 1
    assert drawn(there) == [(0, 0), (150, 0)]
    assert drawn(back) == [(150, 0), (0, 0)]


def test_nothing_measured_is_null() -> None:
    (piece,) = pieces_of(FINE, course(street(2)), street(2))
    assert (piece.slope_percent, piece.slope_sigma_percent, piece.drives) == (None, None, 0)


@given(st.lists(st.tuples(st.floats(1, 400), st.sampled_from([None, 0, 1, 7])), min_size=1, max_size=12))
def test_what_nobody_drove_of_a_gap_has_no_slope_and_no_drives(line: list[tuple[float, int | None]]) -> None:
    """A gap between drives has a slope of its own; a piece may lie in it altogether (None: not even that)."""
    roads = stretches(
        *(
            {"points": [(500 * k, 0), (500 * k + 500, 0)], "length_m": long, "drives": drives or 0}
            | ({} if drives is None else {"slope_percent": 3.0, "sigma_percent": 0.5})
            for k, (long, drives) in enumerate(line)
        )
    )
    for piece in pieces_of(MIDDLE, course(roads), roads):
        assert (piece.slope_percent is None) == (piece.drives == 0)
        assert piece.drives in {0, 1, 7}


def test_a_line_that_is_a_point_from_afar_stays_a_line() -> None:
    ring = stretches(
        {"points": [(0, 0), (1, 0), (1, 1), (0, 0)]},
        {"points": [(900, 0), (900, 900), (0, 900), (900, 0)]},
    )
    for level in LEVELS.values():
        for piece in pieces_of(level, [Course([0], [False]), Course([1], [False])], ring):
            assert shapely.from_wkb(piece.geom_3857).length > 0


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 400))
def test_a_tile_has_room_for_so_much_and_the_important_stay(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    classes = np.array(["motorway", "primary", "residential", "service"], object)
    slope = np.where(rng.random(n) < 0.5, rng.normal(size=n), NAN)
    many = stretches(
        *({"points": (1000 * k + rng.normal(0, 300, (6, 2))).tolist()} for k in range(n)),
    )
    many = dataclasses.replace(
        many,
        highway=classes[rng.integers(0, 4, n)],
        slope_percent=slope,
        sigma_percent=np.abs(slope),
        drives=np.isfinite(slope).astype(int),
        length_m=rng.uniform(50, 250, n),
    )
    pieces = pieces_of(FINE, [Course([k], [False]) for k in range(n)], many)
    assert len({piece.segment_id for piece in pieces}) == len(pieces)
    takes = sum(9 + 6.5 * (p.slope_percent is not None) + 2 * len(drawn(p)) for p in pieces)
    assert takes <= ROOM_BYTES
    gone = set(many.ids.tolist()) - {piece.segment_id for piece in pieces}
    if gone:
        assert takes > ROOM_BYTES - 30
        lost = {many.highway[k - 1] for k in gone if not many.drives[k - 1]}
        kept = {piece.highway for piece in pieces if not piece.drives}
        for better, worse in itertools.pairwise(classes):
            assert not (better in lost and worse in kept)


def test_each_way_for_itself_at_the_finest_level() -> None:
    roads = street(4, slope_percent=1.0, sigma_percent=0.2, drives=1)
    ends = Ends(*(np.array(v) for v in ([7, 7, 8, 8], [1, 2, 3, 4], [2, 3, 4, 5], [0] * 4)))
    assert [piece.segment_id for piece in all_roads(roads, ends)] == [1, 3]
    assert [piece.length_m for piece in all_roads(roads, ends)] == [200.0, 200.0]
    long = street(7)
    ends = Ends(*(np.array(v) for v in ([7] * 7, range(7), range(1, 8), [0] * 7)))
    assert [piece.length_m for piece in all_roads(long, ends)] == [300.0, 300.0, 100.0]
    nothing = street(1).subset(np.empty(0, np.int64))
    assert all_roads(nothing, Ends(*(np.empty(0, np.int64) for _ in range(4)))) == []


def test_greater_roads_go_on_across_ways_and_side_streets() -> None:
    main = [{"points": [(100 * k, 0), (100 * k + 100, 0)]} for k in range(3)]
    side = {"points": [(100, 0), (100, 80)], "highway": "residential"}
    (piece,) = greater_roads(MIDDLE, stretches(*main, side))
    assert piece.length_m == 300.0
    assert drawn(piece) == [(0, 0), (300, 0)]


def test_one_way_roads_point_where_one_may_go() -> None:
    against = {
        "points": [(200, 0), (100, 0)],
        "oneway": -1,
        "slope_percent": -3.0,
        "sigma_percent": 1,
        "drives": 1,
    }
    along = {"points": [(0, 0), (100, 0)], "oneway": 1, "slope_percent": 3.0, "sigma_percent": 1, "drives": 1}
    (piece,) = greater_roads(MIDDLE, stretches(along, against))
    assert (piece.oneway, piece.slope_percent, drawn(piece)) == (1, 3.0, [(0, 0), (200, 0)])


def test_longer_driven_stretches_are_shown_whatever_their_class() -> None:
    driven = {"slope_percent": 3.0, "sigma_percent": 1.0, "drives": 1, "highway": "residential"}
    main = {"points": [(0, 900), (100, 900)]}
    far = [{"points": [(100 * k, 0), (100 * k + 100, 0)], **driven} for k in range(3)]
    assert len(greater_roads(MIDDLE, stretches(main, *far))) == 2
    assert len(greater_roads(MIDDLE, stretches(main, *far[:2]))) == 1
    # Farther away it takes more.
    assert len(greater_roads(COARSE, stretches(main, *far))) == 1


@pytest.mark.parametrize("level", [MIDDLE, COARSE, LEVELS[6]])
@pytest.mark.parametrize(
    "classes", [["track"], ["service", "residential"], ["primary_link", "track"], ["new"]]
)
def test_no_tile_with_roads_is_empty(level: Any, classes: list[str]) -> None:
    roads = [{"points": [(0, 100 * k), (90, 100 * k)], "highway": name} for k, name in enumerate(classes)]
    found = greater_roads(level, stretches(*roads))
    assert len(found) == 1


def test_pieces_are_what_the_next_level_is_made_of() -> None:
    roads = street(30, slope_percent=2.0, sigma_percent=0.5, drives=3)
    pieces = greater_roads(MIDDLE, roads)
    assert [piece.length_m for piece in pieces] == [1200.0, 1200.0, 600.0]
    (whole,) = greater_roads(COARSE, stretches_of(pieces))
    assert (whole.length_m, whole.slope_percent, whole.drives, whole.segment_id) == (3000.0, 2.0, 3, 1)
    assert drawn(whole) == [(0, 0), (3000, 0)]
    assert greater_roads(COARSE, stretches_of([])) == []


def test_every_tile_that_a_changed_piece_reaches_into_is_told() -> None:
    half, side = 20037508.342789244, 2 * 20037508.342789244 / 2**14
    x, y = 8579, 5634
    west, north = x * side - half, half - y * side

    def piece(*points: tuple[float, float]) -> Piece:
        """Through places of the tile, in parts of its side."""
        (found,) = pieces_of(
            FINE,
            [Course([0], [False])],
            stretches({"points": [(west + a * side, north - b * side) for a, b in points]}),
        )
        return found

    def met(*points: tuple[float, float]) -> set[tuple[int, int]]:
        tile, made = x << 14 | y, piece(*points)
        there, gone = {tile: {1: made}}, {tile: {}}
        found = changed_tiles(12, there, gone)  # type: ignore[arg-type]
        assert found == changed_tiles(12, gone, there)  # type: ignore[arg-type]
        assert changed_tiles(12, there, there) == set()
        return {((one >> 14) - x, (one & 16383) - y) for one in found}

    assert met((0.3, 0.3), (0.7, 0.7)) == {(0, 0)}
    assert met((0.5, 0.5), (1.5, 0.5)) == {(0, 0), (1, 0)}
    assert met((0.5, 0.5), (0.95, 0.5)) == {(0, 0), (1, 0)}  # a tile draws a little beyond its edge
    assert met((0.5, 0.5), (3.5, 3.5)) >= {(k, k) for k in range(4)}
