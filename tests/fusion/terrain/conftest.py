"""Elevation rasters and road networks for tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable

WriteRaster = Callable[..., Path]
WriteHgt = Callable[..., Path]
MakeNetwork = Callable[..., RoadNetwork]


def from_post(posts: Affine, column: float, row: float) -> Affine:
    """The same grid counted from another post."""
    a, b, c, d, e, f = posts[:6]
    return Affine(a, b, a * column + b * row + c, d, e, d * column + e * row + f)


def raster_of(
    path: Path, z: ArrayLike, posts: Affine, crs: Any = 4326, nodata: float | None = None, **tags: Any
) -> Path:
    """A GeoTIFF; ``posts`` takes (column, row) of a pixel's centre to the CRS."""
    z = np.asarray(z)
    profile = {
        "driver": "GTiff",
        "height": z.shape[0],
        "width": z.shape[1],
        "count": 1,
        "dtype": z.dtype,
        "crs": rasterio.crs.CRS.from_user_input(crs),
        "transform": from_post(posts, -0.5, -0.5),
        "nodata": nodata,
        "compress": "deflate",
    }
    with rasterio.open(path, "w", **profile) as dataset:
        dataset.write(z, 1)
        for name in ("scales", "offsets", "units"):
            if name in tags:
                setattr(dataset, name, (tags.pop(name),))
        dataset.update_tags(**tags)
    return path


def hgt_of(path: Path, z: ArrayLike) -> Path:
    """An SRTM tile: big-endian 16-bit posts, north row first, both edges included."""
    path.write_bytes(np.asarray(z).astype(">i2").tobytes())
    return path


def network_between(lon0: ArrayLike, lat0: ArrayLike, lon1: ArrayLike, lat1: ArrayLike) -> RoadNetwork:
    """One way per segment, numbered in order."""
    n = len(np.atleast_1d(lon0))
    table = RoadTable.from_columns(
        osm_way_id=np.arange(n),
        from_node=np.zeros(n),
        to_node=np.ones(n),
        lon0_deg=np.atleast_1d(lon0),
        lat0_deg=np.atleast_1d(lat0),
        lon1_deg=np.atleast_1d(lon1),
        lat1_deg=np.atleast_1d(lat1),
        oneway=np.zeros(n),
        bridge=np.zeros(n),
        tunnel=np.zeros(n),
        layer=np.zeros(n),
        highway=["road"] * n,
        name=[None] * n,
    )
    return RoadNetwork.project(table, LocalProjection(8.5, 49.0))


@pytest.fixture(scope="session")
def write_raster() -> WriteRaster:
    """``write_raster(path, z, posts, crs=4326, nodata=None, **tags)``."""
    return raster_of


@pytest.fixture(scope="session")
def write_hgt() -> WriteHgt:
    """``write_hgt(path, z)``."""
    return hgt_of


@pytest.fixture(scope="session")
def make_network() -> MakeNetwork:
    """``make_network(lon0, lat0, lon1, lat1)``, projected around (8.5, 49)."""
    return network_between
