"""The town's elevation raster: the ground with the correlated errors and voids of a satellite DEM."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import Affine
from scipy.ndimage import gaussian_filter

from fusion.simulate.scene.town import HALF_SIZE_M, Town
from fusion.types import Floats

POSTING_DEG = 1.0 / 3600.0
"""One arc second, about 31 m to the north."""
NODATA = -32768
ERROR_SIGMA_M = 4.0
"""One sigma of a post's error."""
ERROR_LENGTH_M = 100.0
"""Distance at which the error's correlation has fallen to 1/e."""
_MARGIN_M = 400.0
"""How far the raster reaches beyond the town."""
_VOIDS = 4
_VOID_RADIUS_M = (35.0, 60.0)


def write_dem(town: Town, path: Path) -> None:
    """Write whole metres (16 bit), WGS 84 with EGM96 heights (EPSG:9707), one arc second, voids -32768."""
    height, west, north = dem_heights(town)
    rows, columns = height.shape
    values = np.where(np.isfinite(height), np.round(height), NODATA).astype(np.int16)
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "int16"}
    profile |= {"crs": "EPSG:9707", "nodata": NODATA, "compress": "deflate"}
    profile |= {"transform": Affine(POSTING_DEG, 0.0, west, 0.0, -POSTING_DEG, north)}
    with rasterio.open(path, "w", **profile) as target:
        target.write(values, 1)
        target.update_tags(VERTICAL_DATUM="EGM96", DESCRIPTION="Synthetic town, errors included")
        target.set_band_unit(1, "m")


def dem_heights(town: Town) -> tuple[Floats, float, float]:
    """Heights of the posts (rows from north, NaN in voids), the grid's west and north edge (degrees)."""
    reach = HALF_SIZE_M + _MARGIN_M
    lon, lat = town.projection.to_lonlat(np.array([-reach, reach]), np.array([-reach, reach]))
    west, east = int(np.floor(lon[0] / POSTING_DEG)), int(np.ceil(lon[1] / POSTING_DEG))
    bottom, top = int(np.floor(lat[0] / POSTING_DEG)), int(np.ceil(lat[1] / POSTING_DEG))
    column = (np.arange(west, east) + 0.5) * POSTING_DEG
    row = (np.arange(top, bottom, -1) - 0.5) * POSTING_DEG
    x, y = town.projection.to_xy(*np.meshgrid(column, row))
    rng = np.random.default_rng([town.seed, 5])
    spacing = float(np.mean(np.diff(x, axis=1))), float(-np.mean(np.diff(y, axis=0)))
    height = town.height(x, y) + ERROR_SIGMA_M * correlated_field(rng, x.shape, spacing, ERROR_LENGTH_M)
    height[_void(rng, x, y)] = np.nan
    return height, west * POSTING_DEG, top * POSTING_DEG


def correlated_field(
    rng: np.random.Generator, shape: tuple[int, int], spacing_m: tuple[float, float], length_m: float
) -> Floats:
    """A random field of unit variance on a grid, of shape (rows, columns) and spacing (east, north).

    White noise is blurred by a Gaussian half as long as ``length_m``, at which the correlation has fallen to 1/e.
    """
    across, down = (length_m / 2 / s for s in spacing_m)
    white = rng.normal(size=shape)
    blurred = gaussian_filter(white, (down, across), mode="wrap", truncate=5.0)
    return np.asarray(blurred * np.sqrt(4 * np.pi * across * down))


def _void(rng: np.random.Generator, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Round holes somewhere in the town."""
    holes = np.zeros(x.shape, bool)
    for _ in range(_VOIDS):
        cx, cy = rng.uniform(-850.0, 850.0, 2)
        holes |= np.hypot(x - cx, y - cy) < rng.uniform(*_VOID_RADIUS_M)
    return holes
