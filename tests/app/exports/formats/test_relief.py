"""Elevation models with measured roads, out of a database, read by nothing of ours."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from pmtiles.reader import MmapSource, Reader, all_tiles

from app.exports.formats.dem_terrarium import terrarium_png
from app.exports.writing.relief import Relief, ReliefOptions, about
from fusion.errors import BadOptionsError, RoadsError

Mapped = Any  # of conftest, which cannot be imported


def slopes_of(tile: np.ndarray, town: Any) -> tuple[np.ndarray, np.ndarray]:
    """Of the town's segments, percent: as Valhalla samples an HGT tile, and the true ones."""

    def at(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        last = len(tile) - 1
        u, v = (lon - np.floor(lon)) * last, (1 - (lat - np.floor(lat))) * last
        x, y = np.floor(u).astype(int), np.floor(v).astype(int)
        a, b = u - x, v - y
        return (  # type: ignore[no-any-return]
            (1 - a) * (1 - b) * tile[y, x]
            + a * (1 - b) * tile[y, x + 1]
            + (1 - a) * b * tile[y + 1, x]
            + a * b * tile[y + 1, x + 1]
        )

    roads, height = town.roads, town.node_height_m
    rise = at(roads.lon1_deg, roads.lat1_deg) - at(roads.lon0_deg, roads.lat0_deg)
    true = height[town.end] - height[town.start]
    return 100 * rise / town.length_m, 100 * true / town.length_m


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def tiles(mapped: Mapped, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, list[str]]:
    path = tmp_path_factory.mktemp("relief") / "town.hgt.zip"
    return path, *mapped.write("dem-hgt", path)


def test_a_router_that_reads_the_tile_knows_measured_slopes(
    mapped: Mapped, tiles: tuple[Path, int, list[str]], tmp_path: Path
) -> None:
    path, count, notes = tiles
    with zipfile.ZipFile(path) as archive:
        assert count == 1
        assert archive.namelist() == ["README.txt", "N47/N47E007.hgt", "changed/N47E007.tif"]
        tile = np.frombuffer(archive.read("N47/N47E007.hgt"), ">i2").reshape(3601, 3601).astype(float)
        text = archive.read("README.txt").decode()
        with rasterio.MemoryFile(archive.read("changed/N47E007.tif")) as file, file.open() as dataset:
            change = dataset.read(1)
    assert "Roads © OpenStreetMap contributors" in text and "EGM96" in text
    assert set(np.unique(change)) >= {0, 1, 2}
    assert any("EGM96" in note and "taken off" in note for note in notes)
    assert any("1 of 1 tiles hold voids" in note for note in notes), "the raster covers the town alone"
    town = mapped.town
    measured = (town.roads.osm_way_id % 4 >= 2) & ~town.roads.bridge & ~town.roads.tunnel
    found, true = slopes_of(tile, town)
    assert rms((found - true)[measured]) < 0.7
    assert np.median(np.abs(found - true)[measured]) < 0.15


def test_other_routers_find_the_tile_in_their_own_way(
    mapped: Mapped, tiles: tuple[Path, int, list[str]], tmp_path: Path
) -> None:
    tile = zipfile.ZipFile(tiles[0]).read("N47/N47E007.hgt")
    mapped.write("dem-hgt", tmp_path / "g.hgt.zip", router="graphhopper")
    inner = zipfile.ZipFile(io.BytesIO(zipfile.ZipFile(tmp_path / "g.hgt.zip").read("N47E007.hgt.zip")))
    assert inner.namelist() == ["N47E007.hgt"]
    assert len(inner.read("N47E007.hgt")) == len(tile)
    assert inner.read("N47E007.hgt") != tile, "without interpolation it takes one post for a node"
    mapped.write("dem-hgt", tmp_path / "b.hgt.zip", router="brouter", arc_seconds="3")
    assert len(zipfile.ZipFile(tmp_path / "b.hgt.zip").read("N47E007.hgt")) == 2 * 1201**2
    with pytest.raises(BadOptionsError, match="arc_seconds"):
        mapped.write("dem-hgt", tmp_path / "b.hgt.zip", arc_seconds="2")


def test_without_a_road_that_is_known_well_there_is_nothing_to_write(mapped: Mapped, tmp_path: Path) -> None:
    with pytest.raises(RoadsError, match=r"0\.1 m"):
        mapped.write("dem-hgt", tmp_path / "x.hgt.zip", most_sigma_m="0.1")
    with pytest.raises(RoadsError):
        mapped.write("dem-geotiff", tmp_path / "x.tif", bbox=(1.0, 1.0, 2.0, 2.0))


def test_terrarium_tiles_hold_what_the_geotiff_holds(mapped: Mapped, tmp_path: Path) -> None:
    count, _ = mapped.write("dem-terrarium", tmp_path / "t.terrarium.pmtiles", min_zoom="11")
    mapped.write("dem-geotiff", tmp_path / "t.tif")
    with (tmp_path / "t.terrarium.pmtiles").open("rb") as file:
        source = MmapSource(file)
        header, metadata = Reader(source).header(), Reader(source).metadata()
        found = dict(all_tiles(source))
    assert header["tile_type"].name == "PNG" and header["tile_compression"].name == "NONE"
    assert metadata["encoding"] == "terrarium" and metadata["height_datum"] == "EGM96"
    assert len(found) == count and {z for z, _, _ in found} == {11, 12}
    with rasterio.open(tmp_path / "t.tif") as raster:
        z, affine = raster.read(1), raster.transform
    differences = []
    for (zoom, x, y), data in found.items():
        if zoom == 12:
            colours = np.asarray(Image.open(io.BytesIO(data)), float)
            height = colours @ [256, 1, 1 / 256] - 32768
            pixels = 256 * 2**zoom
            lon = (256 * x + np.arange(256) + 0.5) / pixels * 360 - 180
            north = np.pi * (1 - 2 * (256 * y + np.arange(256) + 0.5) / pixels)
            lat = np.degrees(np.arctan(np.sinh(north)))
            column = np.round((lon - affine.c) / affine.a - 0.5).astype(int)
            row = np.round((lat - affine.f) / affine.e - 0.5).astype(int)
            inside = np.ix_((row >= 0) & (row < z.shape[0]), (column >= 0) & (column < z.shape[1]))
            mine = z[np.clip(row, 0, len(z) - 1)][:, np.clip(column, 0, z.shape[1] - 1)]
            differences.append((height - mine)[inside].ravel())
    apart = np.concatenate(differences)
    assert np.nanmedian(np.abs(apart)) < 1, "posts are half a posting apart, on a slope"


def test_colours_of_heights() -> None:
    image = np.asarray(Image.open(io.BytesIO(terrarium_png(np.array([[0.0, -10.5], [4000.25, np.nan]])))))
    assert image.tolist() == [[[128, 0, 0], [127, 245, 128]], [[143, 160, 64], [128, 0, 0]]]


def test_the_text_beside_tiles_names_each_raster_and_its_licence() -> None:
    rasters = [
        {"name": "a.tif", "source": "State survey", "licence": "dl-de/by-2-0"},
        {"name": "b.tif", "source": None, "licence": None},
    ]
    stated = {"attribution": "Roads ©", "provenance": json.dumps({"elevation": {"rasters": rasters}})}
    relief: Any = Relief(terrain=None, roads=None, datum="EGM2008")  # type: ignore[arg-type]
    text = about(stated, relief, ReliefOptions())
    assert "Elevation: a.tif, source: State survey, licence: dl-de/by-2-0\n" in text
    assert "Elevation: b.tif, source: not stated, licence: not stated\n" in text
    assert "metres above EGM2008" in text
