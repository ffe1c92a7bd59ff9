"""Tiles that are made without a database hold the lines that meet them, as the service's do."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.exports.formats.pmtiles import tile_number
from app.exports.writing.vector_tiles import tiles_of
from app.map.segment import Segment
from app.map.tiles.store import BUFFER, EXTENT, column_of, row_of
from mvt_support import layers

AT = (8.7, 49.4)
OFFSETS = st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03))


def segment(start: tuple[float, float], end: tuple[float, float], **more: Any) -> Segment:
    known: dict[str, Any] = {
        "id": None, "osm_way_id": 1, "from_node": 2, "to_node": 3, "length_m": 10.0, "highway": "residential",
        "name": None, "oneway": 0, "bridge": False, "tunnel": False, "slope_percent": 1.23456,
        "slope_sigma_percent": 0.5, "drives": 2, "observations": 9, "dem_slope_percent": None,
        "updated_at": datetime(2024, 1, 1, tzinfo=UTC), "coordinates": (start, end),
    }  # fmt: skip
    return Segment(**known | more)


def units(lon: float, lat: float, z: int, x: int, y: int) -> tuple[float, float]:
    across = (lon + 180) / 360 * 2**z
    down = (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2 * 2**z
    return EXTENT * (across - x), EXTENT * (down - y)


@given(OFFSETS, OFFSETS, st.integers(12, 15))
def test_every_tile_that_a_line_meets_has_its_part(
    one: tuple[float, float], other: tuple[float, float], z: int
) -> None:
    start, end = ((AT[0] + dx, AT[1] + dy) for dx, dy in (one, other))
    tiles = dict(tiles_of([segment(start, end)], (z, z), tile_number))
    (west, north), (east, south) = units(*start, z, 0, 0), units(*end, z, 0, 0)
    # Some places along the line: each lies in a tile that there is.
    for share in np.linspace(0, 1, 23):
        at = (west + share * (east - west)) / EXTENT, (north + share * (south - north)) / EXTENT
        assert (z, math.floor(at[0]), math.floor(at[1])) in tiles
    for (zoom, x, y), tile in tiles.items():
        ((_, (feature,)),) = layers(tile).items()
        ends = np.array([units(*start, zoom, x, y), units(*end, zoom, x, y)])
        long = max(float(np.hypot(*(ends[1] - ends[0]))), 1e-9)
        for px, py in feature["path"]:
            assert min(px, py) >= -BUFFER - 1
            assert max(px, py) <= EXTENT + BUFFER + 1
            step, off = ends[1] - ends[0], np.array([px, py]) - ends[0]
            if long > 3:
                assert abs(step[0] * off[1] - step[1] * off[0]) / long <= 1.01, "on the line"


def test_what_is_known_of_a_segment_is_in_its_feature() -> None:
    plain = segment(AT, (8.7001, 49.4001))
    special = segment(
        AT, AT, bridge=True, oneway=-1, dem_slope_percent=-3.27, highway="primary", slope_percent=-2.0
    )
    ((address, tile),) = tiles_of([plain, special], (14, 14), tile_number)
    one, other = layers(tile)["segments"]
    assert address == (14, column_of(14, AT[0]), row_of(14, AT[1]))
    assert one["properties"] == {
        "slope_percent": 1.2346, "slope_sigma_percent": 0.5, "drives": 2, "highway": "residential", "oneway": 0,
    }  # fmt: skip
    assert other["properties"] == {
        "slope_percent": -2.0, "slope_sigma_percent": 0.5, "drives": 2, "highway": "primary", "oneway": -1,
        "bridge": True, "dem_slope_percent": -3.3,
    }  # fmt: skip
    (x0, y0), (x1, y1) = other["path"]
    assert x1 - x0 in {1, 2} and y1 == y0, "shorter than the grid is fine: still there"


def test_tiles_come_in_the_order_of_their_numbers() -> None:
    rng = np.random.default_rng(1)
    ends = np.array(AT) + rng.uniform(-0.2, 0.2, (200, 2, 2))
    found = [
        address
        for address, _ in tiles_of([segment(*map(tuple, e)) for e in ends.tolist()], (12, 14), tile_number)
    ]
    numbers = [tile_number(*address) for address in found]
    assert numbers == sorted(set(numbers))
    assert list(tiles_of([], (12, 14), tile_number)) == []
