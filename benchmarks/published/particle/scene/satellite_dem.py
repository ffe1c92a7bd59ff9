"""Elevation rasters of the kinds that Al Assaad's thesis uses, over a simulated scene.

What a satellite sees is the surface, embankments included, averaged over its resolution, with three errors: an offset
of the whole scene, bumps as wide as the correlation of the stereo pairs, and noise of each post. The thesis states only
the accuracy that it enters into its filter (3.3.2: 12.6 m for ASTER GDEM V2, 6 m for World 30); the shares here are
chosen so that the posts of a scene err by that much on the whole: most of ASTER's error is local, half of World 30's is
a matter of datum, because the thesis says of its profiles (figure 3.3) that they vary as the GNSS heights do.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio import Affine
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from fusion.registry import Registry
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import correlated_field
from fusion.types import Floats, Ints

_FINE_M = 5.0
"""Grid on which the surface is drawn before the satellite averages it."""
_HALF_CROWN_M = 7.0
_BANK = 0.5
"""Height over width of an embankment's side."""
_REACH_M = 60.0
_TYPICAL_SCENES = 8.0
_SCENES_SPREAD = 0.6
_SCENES_LENGTH_M = 300.0


@dataclass(frozen=True)
class DemModel:
    """A raster of ``rows`` x ``columns`` posts around the scene's centre, ``posting`` apart (east, north).

    The posting is in units of ``crs``, whose horizontal part comes before a plus sign.
    ``blur_m`` is the resolution (a Gaussian's sigma); ``offset_m``, ``local_m`` (correlated over ``length_m``) and
    ``white_m`` are one sigma. With ``scenes`` the last two hold for a post of eight scenes and shrink and grow with the
    root of their number.
    """

    crs: str
    posting: tuple[float, float]
    rows: int
    columns: int
    blur_m: float
    offset_m: float
    local_m: float
    length_m: float
    white_m: float
    dtype: str
    scenes: bool
    stream: int


DEM_MODELS: Registry[DemModel] = Registry("elevation raster")
DEM_MODELS.add(
    "aster",
    DemModel("EPSG:32631+5773", (19.51, 30.89), 91, 160, 35.0, 4.0, 10.3, 120.0, 3.0, "int16", True, 50),
)
DEM_MODELS.add(
    "world30",
    DemModel("EPSG:9707", (1 / 3600, 1 / 3600), 91, 160, 20.0, 4.5, 3.8, 120.0, 1.2, "float32", False, 51),
)


def write_raster(town: Town, path: Path, model: str = "aster") -> None:
    """Write heights above EGM96 as a GeoTIFF of one of ``DEM_MODELS``: "aster" (UTM, 14,560 posts) or "world30".

    Raises ``UnknownNameError`` for another name.
    """
    dem_model = DEM_MODELS[model]
    x, y, transform = _posts(town, dem_model)
    heights = _surface(town, x, y, dem_model.blur_m) + raster_error(town, dem_model)
    _write(path, np.round(heights) if dem_model.dtype == "int16" else heights, dem_model, transform, "m")


def write_quality(town: Town, path: Path, model: str = "aster") -> None:
    """Write the number of scenes behind each post, as ASTER's NUM files do, on the same grid as the raster."""
    dem_model = DEM_MODELS[model]
    _write(path, scene_numbers(town, dem_model), dem_model, _posts(town, dem_model)[2], "")


def scene_numbers(town: Town, model: DemModel) -> Ints:
    """Scenes behind each post, at least 1, shape (rows, columns): eight on the whole, few in some patches."""
    rng = np.random.default_rng([town.seed, model.stream, 1])
    field = correlated_field(rng, (model.rows, model.columns), _spacing(town, model), _SCENES_LENGTH_M)
    return np.clip(np.round(_TYPICAL_SCENES * np.exp(_SCENES_SPREAD * field)), 1, 60).astype(np.int64)


def raster_error(town: Town, model: DemModel) -> Floats:
    """Error of each post, metres, shape (rows, columns), from north to south."""
    rng = np.random.default_rng([town.seed, model.stream])
    shape = (model.rows, model.columns)
    offset = model.offset_m * float(rng.normal())
    local = model.local_m * correlated_field(rng, shape, _spacing(town, model), model.length_m)
    local += model.white_m * rng.normal(size=shape)
    if model.scenes:
        local *= np.sqrt(_TYPICAL_SCENES / scene_numbers(town, model))
    return np.asarray(offset + local)


def _posts(town: Town, model: DemModel) -> tuple[Floats, Floats, Affine]:
    """The posts on the town's plane, metres, and the raster's transform."""
    to_lonlat = Transformer.from_crs(model.crs.split("+")[0], "EPSG:4326", always_xy=True)
    centre = to_lonlat.transform(town.projection.lon0_deg, town.projection.lat0_deg, direction="INVERSE")
    (dx, dy), (u0, v0) = model.posting, centre
    u0, v0 = round(u0 / dx) * dx, round(v0 / dy) * dy
    u = u0 + dx * (np.arange(model.columns) - (model.columns - 1) / 2)
    v = v0 - dy * (np.arange(model.rows) - (model.rows - 1) / 2)
    x, y = town.projection.to_xy(*to_lonlat.transform(*np.meshgrid(u, v)))
    return x, y, Affine(dx, 0.0, u[0] - dx / 2, 0.0, -dy, v[0] + dy / 2)


def _spacing(town: Town, model: DemModel) -> tuple[float, float]:
    """Metres between neighbouring posts, east and north."""
    x, y, _ = _posts(town, model)
    return float(np.mean(np.diff(x, axis=1))), float(-np.mean(np.diff(y, axis=0)))


def _surface(town: Town, x_m: Floats, y_m: Floats, blur_m: float) -> Floats:
    """Ground with its earthworks, averaged over the satellite's resolution, at points of any one shape."""
    margin = 3 * blur_m
    left, bottom = float(x_m.min()) - margin, float(y_m.min()) - margin
    gx, gy = np.meshgrid(
        np.arange(left, float(x_m.max()) + margin, _FINE_M),
        np.arange(bottom, float(y_m.max()) + margin, _FINE_M),
    )
    surface = gaussian_filter(
        town.height(gx, gy) + earthworks(town, gx, gy), blur_m / _FINE_M, mode="nearest"
    )
    at = [(y_m - bottom) / _FINE_M, (x_m - left) / _FINE_M]
    return np.asarray(map_coordinates(surface, at, order=1))


def earthworks(town: Town, x_m: Floats, y_m: Floats) -> Floats:
    """How far embankments rise above the ground and cuttings lie below it, metres, at points of any one shape.

    A bank is as high as the nearest road on it, flat over the road's width, and falls off one in two. Bridges and
    tunnels leave the ground as it is.
    """
    road = np.flatnonzero(~(town.roads.bridge | town.roads.tunnel))
    count = np.maximum(2, np.ceil(town.length_m[road] / _FINE_M).astype(np.int64) + 1)
    segment = np.repeat(road, count)
    share = np.concatenate([np.linspace(0.0, 1.0, c) for c in count])
    a, b = town.start[segment], town.end[segment]
    px = town.node_x_m[a] + share * (town.node_x_m[b] - town.node_x_m[a])
    py = town.node_y_m[a] + share * (town.node_y_m[b] - town.node_y_m[a])
    rise = town.road_height(segment, share) - town.height(px, py)
    points = np.column_stack([np.ravel(x_m), np.ravel(y_m)])
    far, near = cKDTree(np.column_stack([px, py])).query(points, distance_upper_bound=_REACH_M)
    finite = np.isfinite(far)
    bank = np.zeros(len(points))
    height = rise[near[finite]]
    side = np.maximum(far[finite] - _HALF_CROWN_M, 0.0) * _BANK
    bank[finite] = np.sign(height) * np.maximum(np.abs(height) - side, 0.0)
    return bank.reshape(np.shape(x_m))


def _write(path: Path, values: NDArray[np.generic], model: DemModel, transform: Affine, unit: str) -> None:
    profile = {"driver": "GTiff", "width": model.columns, "height": model.rows, "count": 1, "crs": model.crs}
    profile |= {"dtype": model.dtype, "compress": "deflate", "nodata": -32768, "transform": transform}
    with rasterio.open(path, "w", **profile) as target:
        target.write(values.astype(model.dtype), 1)
        target.update_tags(DESCRIPTION="Synthetic scene, errors included")
        if unit:
            target.set_band_unit(1, unit)
