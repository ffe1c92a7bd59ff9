"""Whose elevation an answer is made with: rasters that lie elsewhere are not credited."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from affine import Affine

from app.terrain.imports import import_dem
from web_fixtures import SOUTH, WEST


def raster(path: Path, west: float, south: float) -> Path:
    """A level raster over half a degree each way."""
    with rasterio.open(
        path, "w", driver="GTiff", width=50, height=50, count=1, dtype="float32", crs="EPSG:4326",
        transform=Affine(0.01, 0, west, 0, -0.01, south + 0.5),
    ) as dataset:  # fmt: skip
        dataset.write(np.full((50, 50), 100, np.float32), 1)
    return path


def mercator(z: int, lon_deg: float, lat_deg: float) -> tuple[int, int]:
    """The tile of a place."""
    north = math.asinh(math.tan(math.radians(lat_deg))) / math.pi
    return int((lon_deg + 180) / 360 * 2**z), int((1 - north) / 2 * 2**z)


def test_answers_credit_the_rasters_under_what_they_show(filled: Any, tmp_path: Path) -> None:
    items = "/collections/segments/items"
    west, south = WEST - 0.1, SOUTH - 0.1
    under, away = raster(tmp_path / "under.tif", west, south), raster(tmp_path / "away.tif", west + 20, south)
    import_dem(filled.sessions, [under, away], filled.settings.dem_dir)
    for address in (items, "/collections/segments", "/tiles.json"):
        said = filled.client.get(address).json()["attribution"]
        assert said.endswith("elevation from under.tif"), address
    for z, (x, y) in {
        13: mercator(13, WEST + 0.003, SOUTH + 0.003),
        14: mercator(14, 179.992, -17.0),
    }.items():
        tile = filled.client.get(f"/tiles/{z}/{x}/{y}.geojson").json()
        assert tile["features"]
        assert ("under.tif" in tile["attribution"]) == (z == 13)
        assert "away.tif" not in tile["attribution"]
    empty = filled.client.get(items, params={"bbox": "100,10,101,11"}).json()
    assert empty["features"] == []
    assert "elevation" not in empty["attribution"]
