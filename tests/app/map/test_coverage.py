"""Where most roads are: what a map opens on."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from app.map.coverage import MOST_ROADS, crowded_box
from app.network import ZOOM
from app.network.cells import cell_bounds

EVERYWHERE = (-180.0, -90.0, 180.0, 90.0)
HEIDELBERG = 8586 << ZOOM | 5609

sides = st.integers(100, (1 << ZOOM) - 100)
crowds = st.dictionaries(
    st.builds(lambda x, y: x << ZOOM | y, sides, sides), st.integers(1, 1000), min_size=1
)


def test_a_lone_road_far_away_does_not_count() -> None:
    far = (8586 + 900) << ZOOM | 5000
    box = crowded_box({HEIDELBERG: 5000, far: 10}, EVERYWHERE)
    assert box == cell_bounds(HEIDELBERG)


def test_two_towns_are_both_in_it() -> None:
    other = (8586 + 40) << ZOOM | (5609 + 30)
    west, south, east, north = crowded_box({HEIDELBERG: 500, other: 500}, EVERYWHERE)
    for place in (HEIDELBERG, other):
        left, bottom, right, top = cell_bounds(place)
        assert west <= left and south <= bottom and east >= right and north >= top


@given(crowds)
def test_no_side_leaves_out_more_than_it_may(found: dict[int, int]) -> None:
    west, south, east, north = crowded_box(found, EVERYWHERE)
    total = sum(found.values())
    for side, sign, edge in ((0, 1, west), (1, 1, south), (2, -1, east), (3, -1, north)):
        beyond = sum(n for cell, n in found.items() if sign * (cell_bounds(cell)[side] - edge) < -1e-9)
        assert beyond <= (1 - MOST_ROADS) / 2 * total + 1e-6


def test_it_ends_where_the_roads_do() -> None:
    west, south, east, north = cell_bounds(HEIDELBERG)
    inset = (east - west) / 4, (north - south) / 4
    whole = (west + inset[0], south + inset[1], east - inset[0], north - inset[1])
    assert crowded_box({HEIDELBERG: 3}, whole) == whole


def test_a_map_of_two_countries_opens_on_the_one_with_more_roads() -> None:
    """From as far as both are seen nothing is drawn at all."""
    sweden = {(8586 + 600 + k) << ZOOM | 4200: 300 for k in range(5)}
    karlsruhe = {(8586 + k) << ZOOM | 5609: 310 for k in range(5)}
    california = {2600 << ZOOM | 6300: 100}
    box = crowded_box(sweden | karlsruhe | california, EVERYWHERE, widest=192)
    assert box == (*cell_bounds(HEIDELBERG)[:2], *cell_bounds(HEIDELBERG + (4 << ZOOM))[2:])


@given(crowds, st.integers(1, 500))
def test_what_is_opened_is_never_too_wide_and_never_empty(found: dict[int, int], widest: int) -> None:
    west, south, east, north = crowded_box(found, EVERYWHERE, widest)
    assert west < east and south < north
    assert (east - west) / 360 * (1 << ZOOM) <= widest + 1e-6
    assert any(
        west <= left < east and south <= bottom < north
        for left, bottom, _, _ in (cell_bounds(cell) for cell in found)
    )
