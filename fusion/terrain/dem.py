"""A digital elevation model: many rasters as one surface.

Stacks the mosaics of one grid each, by priority and then finest first, and answers by place. Knows no roads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fusion.errors import TerrainError
from fusion.messages import say
from fusion.terrain.cache import DemCache
from fusion.terrain.mosaic import DemPatch, Mosaic
from fusion.terrain.quality import pair, with_quality
from fusion.terrain.raster import Raster, read_header
from fusion.types import Floats, Ints

_MAX_PATCH_POSTS = 4_000_000  # 32 MB of heights; beyond, posts are left out
_PLACES_AT_ONCE = 1_000_000  # bounds the memory of coordinates in between


class Dem:
    """Elevation rasters of any CRS and posting, read as they are asked for; safe to use from several threads.

    Where several cover a point, the one of the highest priority counts. Among equal priorities it is the finest, and
    within one grid the first. The next one fills its voids. Two rasters seldom agree at a seam: ``heights`` steps
    there by as much as they differ, ``heights_along`` keeps each line on one raster, and ``posts`` keeps to one grid,
    with its voids filled.

    ``datum`` says what heights refer to: "EGM96" for HGT tiles, what the CRS states for others, else "unknown", and
    "mixed (...)" where the rasters differ. ``description`` is a line for people, ``names`` are the rasters' files,
    ``postings_m`` the distances between the posts of each grid, along rows and along columns. ``without_quality`` are
    the rasters without a quality layer, which ``filtered`` leaves as they are.
    """

    def __init__(self, mosaics: Sequence[Mosaic], cache: DemCache) -> None:
        """Use ``Dem.open``. ``mosaics`` come in the order in which they count, and read through ``cache``."""
        self._mosaics = tuple(mosaics)
        self._cache = cache
        # A grid whose rasters have several priorities is there once for each.
        rasters = list(dict.fromkeys(raster for mosaic in mosaics for raster in mosaic.rasters))
        self.names = tuple(raster.path.name for raster in rasters)
        self.without_quality = tuple(raster.path.name for raster in rasters if raster.quality is None)
        datums = sorted({raster.datum for raster in rasters})
        self.datum = datums[0] if len(datums) == 1 else f"mixed ({', '.join(datums)})"
        self.postings_m = tuple(mosaic.posting_m for mosaic in mosaics)
        postings = ", ".join(sorted({f"{max(mosaic.posting_m):.3g} m" for mosaic in mosaics}))
        self.description: str = say("dem.described", n=len(rasters), postings=postings, datum=self.datum)
        if len(self.without_quality) < len(rasters):
            known = len(rasters) - len(self.without_quality)
            self.description += f", quality layers of {known}"

    @classmethod
    def open(
        cls,
        paths: Sequence[Path],
        priorities: Sequence[int] | None = None,
        *,
        trusted: bool = False,
        before_read: Callable[[], object] = lambda: None,
    ) -> Dem:
        """Read the headers of the rasters; heights are read as they are asked for.

        ``trusted``: these are files of whoever runs this, of any format that GDAL reads; else GeoTIFF, HGT and DTED
        alone, and no other file is looked at but quality layers. ``before_read`` is called before each block of posts
        that is read, and may raise what ends the reading.

        ``priorities`` has one number for each path, the higher the sooner it counts; None: all alike.
        The quality layer of ``..._dem.tif`` is ``..._num.tif`` beside it, or among ``paths``. Raises
        ``TerrainError`` when no path is given, or one is missing, is no raster that rasterio reads, does not say
        where it lies, or is a picture, or a quality layer without its elevations or on another grid than theirs.
        """
        if not paths:
            raise TerrainError(say("raster.none"))
        cache = DemCache(before_read)
        priority_of = dict(zip(map(Path, paths), priorities or [0] * len(paths), strict=True))
        grids: list[_Grid] = []
        for path, quality in pair(paths):
            raster = with_quality(read_header(path, trusted=trusted), quality)
            home = next((grid for grid in grids if grid[0].takes(raster)), None)
            if home is None:
                home = Mosaic(raster, cache), []
                grids.append(home)
            else:
                home[0].add(raster)
            home[1].append((priority_of[path], raster))
        levels = [level for grid in grids for level in _levels(grid, cache)]
        levels.sort(key=lambda level: (-level[0], level[1].posting_m[0] * level[1].posting_m[1]))
        return cls([mosaic for _, mosaic in levels], cache)

    def __enter__(self) -> Dem:
        return self

    def __exit__(self, *error: object) -> None:
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

    def heights_along(self, lon_deg: Floats, lat_deg: Floats, line: Ints) -> Floats:
        """Heights as ``heights`` gives them, m, shape (n,), but of one raster's grid along each line (n,: its number,
        from 0), so that no line has a step where two rasters meet.

        A line takes the first mosaic that knows all its places. Where none does, mosaics fill each other as far as
        their rasters state one datum; what is left is NaN.
        """
        heights = np.full(len(lon_deg), np.nan)
        order = np.argsort(line, kind="stable")
        begins = np.flatnonzero(np.diff(line[order], prepend=-1))
        # Whole lines, so many places that the memory in between is bounded.
        cuts = np.unique(begins[np.searchsorted(begins, np.arange(0, len(order), _PLACES_AT_ONCE))[1:] - 1])
        for part in np.split(order, cuts):
            lines = np.unique(line[part], return_inverse=True)[1].ravel()
            heights[part] = self._along(lon_deg[part], lat_deg[part], lines)
        return heights

    def _along(self, lon_deg: Floats, lat_deg: Floats, line: Ints) -> Floats:
        heights = np.full(len(lon_deg), np.nan)
        todo = np.flatnonzero(np.isfinite(lon_deg) & np.isfinite(lat_deg))
        begun: list[str | None] = [None] * (int(line.max(initial=-1)) + 1)
        for mosaic in self._mosaics:
            if not len(todo):
                break
            sampled = mosaic.heights(*mosaic.grid_coordinates(lon_deg[todo], lat_deg[todo]))
            known = np.isfinite(sampled)
            part = np.zeros(len(begun), bool)
            part[line[todo[~known]]] = True
            complete = ~part[line[todo]]
            heights[todo[complete]] = sampled[complete]
            self._fill_lines(
                heights, line, todo[known & ~complete], sampled[known & ~complete], mosaic, begun
            )
            todo = todo[~complete]
        return heights

    @staticmethod
    def _fill_lines(
        heights: Floats, line: Ints, places: Ints, heights_m: Floats, mosaic: Mosaic, begun: list[str | None]
    ) -> None:
        """Write what is found where lines have nothing yet, and nothing of another datum."""
        datum = mosaic.rasters[0].datum
        for k in np.unique(line[places]).tolist():
            begun[k] = begun[k] or datum
        mine = np.array([begun[k] == datum for k in line[places].tolist()], bool)
        empty = mine & np.isnan(heights[places])
        heights[places[empty]] = heights_m[empty]

    def sources_at(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[str, ...]:
        """Names of the rasters that give the heights at these WGS 84 degrees, in the order of ``names``.

        Those of the posts at the corners of the triangles that ``heights`` reads; empty where no height is known.
        """
        lon, lat = (
            w.ravel() for w in np.broadcast_arrays(np.asarray(lon_deg, float), np.asarray(lat_deg, float))
        )
        todo, given = np.flatnonzero(np.isfinite(lon) & np.isfinite(lat)), set()
        for mosaic in self._mosaics:
            u, v = mosaic.grid_coordinates(lon[todo], lat[todo])
            known = np.isfinite(mosaic.heights(u, v))
            given |= {raster.path.name for raster in mosaic.sources(u[known], v[known])}
            todo = todo[~known]
        return tuple(name for name in dict.fromkeys(self.names) if name in given)

    def posts(
        self, lon_deg: Floats, lat_deg: Floats, margin_posts: int = 1, margin_m: float = 0.0
    ) -> DemPatch | None:
        """The posts of the first mosaic around places, shape (n,) each: the smallest rectangle of its cells that
        holds all of them, widened by the larger margin.

        Its voids, and posts beyond its rasters, are filled from the next mosaics. None where no raster has a
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


_Grid = tuple[Mosaic, list[tuple[int, Raster]]]
"""Rasters of one grid: as one mosaic in their order, and each with its priority."""


def _levels(grid: _Grid, cache: DemCache) -> Iterator[tuple[int, Mosaic]]:
    """The grid once for each priority of its rasters: with the rasters of that priority and of all higher ones.

    The higher ones come first. So the cells between two tiles of different priorities belong to the lower priority, and
    no gap opens there.
    """
    mosaic, rasters = grid
    priorities = sorted({priority for priority, _ in rasters}, reverse=True)
    if len(priorities) == 1:
        yield priorities[0], mosaic
        return
    ordered = sorted(rasters, key=lambda one: -one[0])
    for least in priorities:
        first, *others = (raster for priority, raster in ordered if priority >= least)
        level = Mosaic(first, cache)
        for raster in others:
            level.add(raster)
        yield least, level
