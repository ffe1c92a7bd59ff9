"""Tiles, read back by GDAL."""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from shapely.geometry import box

from app.core.db import Sessions
from app.map import store
from app.map.tiles import store as tiles
from app.network import extracts as road_store
from fusion.roads.table import RoadTable
from fusion.types import Ints
from road_support import replace_roads

EARTH_M = 40_075_016.685578488
AT_Z14 = (14, 8579, 5612)  # holds 8.51 E, 49.0 N


def tile_of(lon_deg: float, lat_deg: float, z: int) -> tuple[int, int, int]:
    x = (lon_deg + 180) / 360 * 2**z
    y = (1 - math.asinh(math.tan(math.radians(lat_deg))) / math.pi) / 2 * 2**z
    return z, int(x), int(y)


def tile_box(z: int, x: int, y: int):  # type: ignore[no-untyped-def]
    size = EARTH_M / 2**z
    west, north = x * size - EARTH_M / 2, EARTH_M / 2 - y * size
    return box(west, north - size, west + size, north)


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., object]:
    """``read(bytes, z, x, y)``: the tile's only layer as a GeoDataFrame in EPSG:3857."""

    def decode(data: bytes, z: int, x: int, y: int):  # type: ignore[no-untyped-def]
        path = tmp_path / f"{uuid.uuid4()}.mvt"
        path.write_bytes(data)
        assert [name for name, _ in pyogrio.list_layers(path)] == [tiles.SEGMENTS]
        return pyogrio.read_dataframe(path, Z=str(z), X=str(x), Y=str(y), CLIP="NO")

    return decode


def test_a_segment_that_is_shorter_than_the_grid_is_fine_is_in_its_tile(
    sessions: Sessions, chain: Callable[..., RoadTable], read: Callable[..., object]
) -> None:
    """A map of all segments has all of them: at zoom 13 a unit is 1.2 m of the plane, these are 0.6 m long."""
    k = np.arange(50)
    short = chain(50, lon0_deg=8.5 + 5e-6 * k, lon1_deg=8.5 + 5e-6 * (k + 1))
    with sessions.begin() as session:
        replace_roads(session, short, "short.osm", "0" * 64)
    with sessions() as session:
        ids = [int(i) for i in road_store.all_roads(session)[1]]
        for zoom in (13, 14, 18):
            tile = tile_of(8.5, 49.0, zoom)
            frame = read(tiles.mvt(session, *tile), *tile)
            assert sorted(frame["mvt_id"]) == ids, zoom  # type: ignore[index]


def test_a_tile_carries_what_a_map_draws(
    sessions: Sessions, segment_ids: Ints, add_drive: Callable[..., uuid.UUID], read: Callable[..., object]
) -> None:
    add_drive(segment_ids, {2: (-4.25, 0.5)})
    tile = tile_of(8.5025, 49.0, 14)
    with sessions() as session:
        frame = read(tiles.mvt(session, *tile), *tile)
    assert set(frame.columns) == {  # type: ignore[attr-defined]
        "mvt_id", "slope_percent", "slope_sigma_percent", "drives", "highway", "oneway", "geometry"
    }  # fmt: skip
    by_id = frame.set_index("mvt_id")  # type: ignore[attr-defined]
    driven = by_id.loc[segment_ids[2]]
    assert (driven.slope_percent, driven.slope_sigma_percent) == pytest.approx((-4.25, 0.5))
    assert (driven.drives, driven.highway, driven.oneway) == (1, "residential", 0)
    undriven = by_id.drop(segment_ids[2])
    assert undriven.slope_percent.isna().all()
    assert (undriven.drives == 0).all()


def test_a_line_keeps_its_direction_and_place(
    sessions: Sessions, segment_ids: Ints, read: Callable[..., object]
) -> None:
    tile = tile_of(8.5005, 49.0, 14)
    with sessions() as session:
        frame = read(tiles.mvt(session, *tile), *tile)
    line = frame.set_index("mvt_id").geometry[segment_ids[0]]  # type: ignore[attr-defined]
    x = np.radians([8.5, 8.501]) * 6_378_137
    y = math.asinh(math.tan(math.radians(49))) * 6_378_137
    unit_m = EARTH_M / 2**14 / tiles.EXTENT
    assert np.allclose(line.coords, [(x[0], y), (x[1], y)], atol=unit_m)


def test_a_line_just_outside_is_in_the_buffer(
    sessions: Sessions, chain: Callable[..., RoadTable], read: Callable[..., object]
) -> None:
    z, x, y = tile_of(8.5, 49.0, 14)
    edge_lon = x / 2**z * 360 - 180
    unit_deg = 360 / 2**z / tiles.EXTENT
    west = np.array([20.0, 100.0]) * unit_deg  # within and beyond the 64 units of the buffer
    table = chain(
        2, lon0_deg=edge_lon - west, lon1_deg=edge_lon - west, lat0_deg=[48.9999] * 2, lat1_deg=[49.0] * 2
    )
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)
        frame = read(tiles.mvt(session, z, x, y), z, x, y)
        near = next(store.all_segments(session))
        assert store.geojson_tile(session, z, x, y) == []
    assert frame.mvt_id.tolist() == [near.id]  # type: ignore[attr-defined]


def test_a_tile_without_segments_is_empty(sessions: Sessions, segment_ids: Ints) -> None:
    with sessions() as session:
        assert tiles.mvt(session, 14, 0, 0) == b""
        assert store.geojson_tile(session, 14, 0, 0) == []


def test_the_geojson_tiles_of_a_row_hold_every_segment_whole(sessions: Sessions, segment_ids: Ints) -> None:
    z, first, y = tile_of(8.5, 49.0, 16)
    _, last, _ = tile_of(8.51, 49.0, 16)
    assert last > first
    with sessions() as session:
        found = {x: store.geojson_tile(session, z, x, y) for x in range(first, last + 1)}
        every = {row.id: row for row in store.all_segments(session)}
    assert {row.id for rows in found.values() for row in rows} == set(every)
    for x, rows in found.items():
        for row in rows:
            assert row == every[row.id]
            (lon0, _), (lon1, _) = row.coordinates
            west, east = x / 2**z * 360 - 180, (x + 1) / 2**z * 360 - 180
            assert lon0 <= east + 1e-9
            assert lon1 >= west - 1e-9


@pytest.mark.parametrize(
    ("zoom", "shown"),
    [
        (13, {"motorway", "primary", "tertiary", "residential", "track"}),
        (12, {"motorway", "primary", "tertiary", "track"}),
        (10, {"motorway", "primary", "tertiary", "track"}),
        (9, {"motorway", "primary", "track"}),
        (7, {"motorway", "track"}),
    ],
)
def test_far_out_only_driven_or_major_roads_are_shown(
    sessions: Sessions,
    chain: Callable[..., RoadTable],
    add_drive: Callable[..., uuid.UUID],
    zoom: int,
    shown: set[str],
) -> None:
    classes = ["motorway", "primary", "tertiary", "residential", "track"]
    with sessions.begin() as session:
        replace_roads(session, chain(5, highway=classes), "x", "0" * 64)
        ids = road_store.all_roads(session)[1]
    add_drive(ids, {4: (1.0, 1.0)})
    tile = tile_of(8.5025, 49.0, zoom)
    with sessions() as session:
        assert {row.highway for row in store.geojson_tile(session, *tile, full_zoom=13)} == shown
