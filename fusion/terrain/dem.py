"""A digital elevation model: many rasters as one surface.

Stacks the mosaics of one grid each, finest first, and answers by place. Knows no roads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from fusion.errors import TerrainError
from fusion.terrain.cache import DemCache
from fusion.terrain.mosaic import DemPatch, Mosaic
from fusion.terrain.quality import pair, with_quality
from fusion.terrain.raster import read_header
from fusion.types import Floats

_MAX_PATCH_POSTS = 4_000_000  # 32 MB of heights; beyond, posts are left out
_PLACES_AT_ONCE = 1_000_000  # bounds the memory of coordinates in between


class Dem:
    """Elevation rasters of any CRS and posting, read as they are asked for; safe to use from several threads.

    The finest rasters that cover a point count; their voids are filled from coarser ones. ``datum`` says
    what heights refer to: "EGM96" for HGT tiles, what the CRS states for others, else "unknown", and
    "mixed (...)" where the rasters differ. ``description`` is a line for people, ``names`` are the rasters' files;
    ``without_quality`` are those of them without a quality layer, which ``filtered`` leaves as they are.
    """

    def __init__(self, mosaics: Sequence[Mosaic], cache: DemCache) -> None:
        """Use ``Dem.open``. ``mosaics`` come finest first and read through ``cache``."""
        self._mosaics = tuple(mosaics)
        self._cache = cache
        rasters = [raster for mosaic in mosaics for raster in mosaic.rasters]
        self.names = tuple(raster.path.name for raster in rasters)
        self.without_quality = tuple(raster.path.name for raster in rasters if raster.quality is None)
        datums = sorted({raster.datum for raster in rasters})
        self.datum = datums[0] if len(datums) == 1 else f"mixed ({', '.join(datums)})"
        postings = ", ".join(sorted({f"{max(mosaic.posting_m):.3g} m" for mosaic in mosaics}))
        self.description = f"{len(rasters)} rasters, posting {postings}, datum {self.datum}"
        if len(self.without_quality) < len(rasters):
            known = len(rasters) - len(self.without_quality)
            self.description += f", quality layers of {known}"

    @classmethod
    def open(cls, paths: Sequence[Path]) -> Dem:
        """Read the headers of the rasters; heights are read as they are asked for.

        The quality layer of ``..._dem.tif`` is ``..._num.tif`` beside it, or among ``paths``. Raises
        ``TerrainError`` when no path is given, or one is missing, is no raster that rasterio reads, does not say
        where it lies, or is a picture, or a quality layer without its elevations or on another grid than theirs.
        """
        if not paths:
            raise TerrainError("No elevation raster was given. Give at least one.")
        cache = DemCache()
        mosaics: list[Mosaic] = []
        for path, quality in pair(paths):
            raster = with_quality(read_header(path), quality)
            home = next((mosaic for mosaic in mosaics if mosaic.takes(raster)), None)
            if home is None:
                mosaics.append(Mosaic(raster, cache))
            else:
                home.add(raster)
        return cls(sorted(mosaics, key=lambda mosaic: mosaic.posting_m[0] * mosaic.posting_m[1]), cache)

    def __enter__(self) -> Dem:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files. Neither the model nor what ``filtered`` made of it can be used afterwards."""
        self._cache.close()

    def filtered(self, min_quality: int) -> Dem:
        """The same model, with posts that fewer than ``min_quality`` scenes saw as voids; 0 keeps all.

        Posts filled from another source count as seen by none (``fusion.terrain.quality``). As other voids, they are
        left out of planes, make the triangles at them unknown, and are filled from coarser rasters where there are
        some; nothing is guessed from their neighbours. Rasters without a quality layer keep all their posts. Cheap:
        the files and what was read are shared, and closing either model closes both.
        """
        if min_quality < 0:
            raise ValueError(f"the number of scenes is {min_quality}, and cannot be negative")
        return Dem([mosaic.filtered(min_quality) for mosaic in self._mosaics], self._cache)

    def heights(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Heights of the triangulated surface at WGS 84 degrees, metres, in the broadcast shape of both.

        NaN off the posts, and where the triangle has a void in every raster. Raises ``TerrainError`` when a
        file turns out to be damaged.
        """
        lon, lat = np.broadcast_arrays(np.asarray(lon_deg, np.float64), np.asarray(lat_deg, np.float64))
        flat_lon, flat_lat = lon.ravel(), lat.ravel()
        heights = np.full(len(flat_lon), np.nan)
        for start in range(0, len(heights), _PLACES_AT_ONCE):
            part = slice(start, start + _PLACES_AT_ONCE)
            self._fill(heights[part], flat_lon[part], flat_lat[part])
        return heights.reshape(lon.shape)

    def posts(
        self, lon_deg: Floats, lat_deg: Floats, margin_posts: int = 1, margin_m: float = 0.0
    ) -> DemPatch | None:
        """The posts of the finest mosaic around places, shape (n,) each: the smallest rectangle of its cells that
        holds all of them, widened by the larger margin.

        Its voids, and posts beyond its rasters, are filled from coarser mosaics. None where no raster has a
        height there. Beyond four million posts every second, third ... post is taken.
        """
        for mosaic in self._mosaics:
            patch = self._patch(mosaic, lon_deg, lat_deg, margin_posts, margin_m)
            if patch is not None:
                return patch
        return None

    def _fill(self, heights: Floats, lon: Floats, lat: Floats) -> None:
        for mosaic in self._mosaics:
            todo = np.flatnonzero(np.isnan(heights) & np.isfinite(lon) & np.isfinite(lat))
            if len(todo):
                heights[todo] = mosaic.heights(*mosaic.grid_coordinates(lon[todo], lat[todo]))

    def _patch(
        self, mosaic: Mosaic, lon: Floats, lat: Floats, margin_posts: int, margin_m: float
    ) -> DemPatch | None:
        u, v = mosaic.grid_coordinates(lon, lat)
        spans = []
        for w, posting in zip((u.tolist(), v.tolist()), mosaic.posting_m, strict=True):
            if not all(map(math.isfinite, w)):
                return None
            margin = max(margin_posts, math.ceil(margin_m / posting))
            spans.append((math.floor(min(w)) - margin, math.floor(max(w)) + 2 + margin))
        (u0, u1), (v0, v1) = spans
        step = math.ceil(math.sqrt((u1 - u0) * (v1 - v0) / _MAX_PATCH_POSTS))
        columns, rows = range(u0, u1 + step - 1, step), range(v0, v1 + step - 1, step)
        z = mosaic.window(columns, rows)
        void = np.isnan(z)
        if void.any():
            if void.all():
                return None
            if len(self._mosaics) > 1:
                self._fill_posts(z, mosaic, columns, rows)
        return DemPatch(z, u0, v0, step, u, v, mosaic)

    def _fill_posts(self, z: Floats, mosaic: Mosaic, columns: range, rows: range) -> None:
        u, v = np.meshgrid(np.array(columns, float), np.array(rows, float))
        self._fill(z.reshape(-1), *mosaic.lonlat(u.ravel(), v.ravel()))
