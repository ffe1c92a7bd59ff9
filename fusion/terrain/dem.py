"""A digital elevation model: many rasters as one surface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from fusion.errors import TerrainError
from fusion.terrain.layer import Layer, Store
from fusion.terrain.patch import DemPatch
from fusion.terrain.raster import Raster, open_raster
from fusion.types import Floats

_MAX_PATCH_POSTS = 4_000_000
_CHUNK = 1_000_000


class Dem:
    """A lazy mosaic of elevation rasters of any CRS and posting; safe to use from several threads.

    The finest rasters that cover a point count; their voids are filled from coarser ones. ``datum`` says
    what heights refer to: "EGM96" for HGT tiles, what the CRS states for others, else "unknown", and
    "mixed (...)" where the rasters differ. ``description`` is a line for people.
    """

    def __init__(self, layers: Sequence[Layer]) -> None:
        """Use ``Dem.open``. ``layers`` come finest first."""
        self._layers = tuple(layers)
        self._store = Store()
        rasters = [raster for layer in layers for raster in layer.rasters]
        datums = sorted({raster.datum for raster in rasters})
        self.datum = datums[0] if len(datums) == 1 else f"mixed ({', '.join(datums)})"
        postings = ", ".join(sorted({f"{max(layer.posting_m):.3g} m" for layer in layers}))
        self.description = f"{len(rasters)} rasters, posting {postings}, datum {self.datum}"

    @classmethod
    def open(cls, paths: Sequence[Path]) -> Dem:
        """Read the headers of the rasters; heights are read as they are asked for.

        Raises ``TerrainError`` when no path is given, or one is missing, is no raster that rasterio reads,
        does not say where it lies, or is a picture.
        """
        if not paths:
            raise TerrainError("No elevation raster was given. Give at least one.")
        layers: list[Layer] = []
        for path in paths:
            raster = _header(path)
            home = next((layer for layer in layers if layer.takes(raster)), None)
            if home is None:
                layers.append(Layer(raster))
            else:
                home.add(raster)
        return cls(sorted(layers, key=lambda layer: layer.posting_m[0] * layer.posting_m[1]))

    def __enter__(self) -> Dem:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. The model cannot be used afterwards."""
        self._store.close()

    def heights(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Heights of the triangulated surface at WGS 84 degrees, metres, in the broadcast shape of both.

        NaN off the posts, and where the triangle has a void in every raster. Raises ``TerrainError`` when a
        file turns out to be damaged.
        """
        lon, lat = np.broadcast_arrays(np.asarray(lon_deg, np.float64), np.asarray(lat_deg, np.float64))
        flat_lon, flat_lat = lon.ravel(), lat.ravel()
        heights = np.full(len(flat_lon), np.nan)
        for start in range(0, len(heights), _CHUNK):
            part = slice(start, start + _CHUNK)
            self._fill(heights[part], flat_lon[part], flat_lat[part])
        return heights.reshape(lon.shape)

    def posts(
        self,
        bounds_deg: tuple[float, float, float, float],
        margin_posts: int = 1,
        margin_m: float = 0.0,
    ) -> DemPatch | None:
        """The posts of the finest layer over (west, south, east, north), widened by the larger margin.

        Its voids, and posts beyond its rasters, are filled from coarser layers. None where no raster has a
        height there. Beyond four million posts every second, third ... post is taken.
        """
        for layer in self._layers:
            patch = self._patch(layer, bounds_deg, margin_posts, margin_m)
            if patch is not None:
                return patch
        return None

    def _fill(self, heights: Floats, lon: Floats, lat: Floats) -> None:
        for layer in self._layers:
            todo = np.flatnonzero(np.isnan(heights) & np.isfinite(lon) & np.isfinite(lat))
            if len(todo):
                heights[todo] = layer.heights(self._store, *layer.grid_coordinates(lon[todo], lat[todo]))

    def _patch(
        self, layer: Layer, bounds_deg: tuple[float, float, float, float], margin_posts: int, margin_m: float
    ) -> DemPatch | None:
        west, south, east, north = bounds_deg
        corners = layer.grid_coordinates(
            np.array([west, east, east, west]), np.array([south, south, north, north])
        )
        if not np.isfinite(corners).all():
            return None
        spans = []
        for w, posting in zip(corners, layer.posting_m, strict=True):
            margin = max(margin_posts, int(np.ceil(margin_m / posting)))
            spans.append((int(np.floor(w.min())) - margin, int(np.floor(w.max())) + 1 + margin))
        (u0, u1), (v0, v1) = spans
        step = int(np.ceil(np.sqrt((u1 - u0 + 1) * (v1 - v0 + 1) / _MAX_PATCH_POSTS)))
        u, v = np.meshgrid(*(np.arange(a, b + step, step, dtype=float) for a, b in spans))
        z = layer.heights(self._store, u.ravel(), v.ravel())
        if np.isnan(z).all():
            return None
        if np.isnan(z).any() and len(self._layers) > 1:
            self._fill(z, *layer.lonlat(u.ravel(), v.ravel()))
        return DemPatch(z.reshape(u.shape), u0, v0, step, layer)


def _header(path: Path) -> Raster:
    raster, dataset = open_raster(Path(path))
    dataset.close()
    return raster
