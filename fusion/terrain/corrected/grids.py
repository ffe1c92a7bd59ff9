"""Grids of posts on which an elevation model is written: where each post lies. Knows no height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats


class PostGrid(Protocol):
    """Posts all around the world, by column (to the east) and row (to the south)."""

    def coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """Columns and rows of places, with fractions; any equal shapes."""
        ...

    def axes(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """Longitudes (degrees) of columns, and latitudes of rows."""
        ...


@dataclass(frozen=True)
class ArcSeconds:
    """Posts at whole multiples of some seconds of arc, as HGT tiles have them: column 0 at 180 W, row 0 at the pole."""

    step_s: int = 1

    @property
    def per_degree(self) -> int:
        """Posts from one whole degree to the next."""
        return 3600 // self.step_s

    def coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """See ``PostGrid``."""
        return (lon_deg + 180.0) * self.per_degree, (90.0 - lat_deg) * self.per_degree

    def axes(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """See ``PostGrid``."""
        return columns / self.per_degree - 180.0, 90.0 - rows / self.per_degree

    def one_post(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """Column and row of the post that GraphHopper takes for a place without interpolation (``HeightTile``).

        It divides a degree into one part more than there are steps between posts, and takes the part's own post.
        """
        n, lon, lat = self.per_degree, np.floor(lon_deg), np.floor(lat_deg)
        east, north = (np.floor((n + 1) * w) for w in (lon_deg - lon, lat_deg - lat))
        return (lon + 180) * n + east, (90 - lat) * n - north


TILE_PIXELS = 256


@dataclass(frozen=True)
class MercatorPixels:
    """The middles of the pixels of web maps' tiles of a zoom: tile (x, y) begins at column 256 x and row 256 y."""

    zoom: int

    def coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """See ``PostGrid``."""
        pixels = TILE_PIXELS * 2.0**self.zoom
        north = np.arcsinh(np.tan(np.radians(lat_deg)))
        return (lon_deg + 180.0) / 360.0 * pixels - 0.5, (1.0 - north / np.pi) / 2.0 * pixels - 0.5

    def axes(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """See ``PostGrid``."""
        pixels = TILE_PIXELS * 2.0**self.zoom
        north = np.pi * (1.0 - 2.0 * (rows + 0.5) / pixels)
        return (columns + 0.5) / pixels * 360.0 - 180.0, np.degrees(np.arctan(np.sinh(north)))


def posting_m(grid: PostGrid, column: float, row: float) -> tuple[float, float]:
    """Metres from a post to the next one east and south of it."""
    lon, lat = grid.axes(np.array([column, column + 1.0]), np.array([row, row + 1.0]))
    narrow = np.cos(np.radians(lat[0]))
    return float(METRES_PER_DEGREE * narrow * (lon[1] - lon[0])), float(METRES_PER_DEGREE * (lat[0] - lat[1]))
