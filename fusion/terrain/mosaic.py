"""Rasters that share one grid of posts as one grid, and rectangles of its posts.

Knows one CRS and one posting; which mosaic counts where several lie over each other is for ``fusion.terrain.dem``.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pyproj import CRS, Transformer

from fusion.compiled import compiled
from fusion.frames import METRES_PER_DEGREE, LocalProjection
from fusion.terrain.cache import DemCache
from fusion.terrain.local_grid import LocalGrid, tin_heights
from fusion.terrain.quality import read_scenes
from fusion.terrain.raster import ALIGNED_POSTS, Raster, apply, read_posts
from fusion.types import Floats, Ints

BLOCK_POSTS = 256  # a side; what is read from files and kept at once, 0.5 MB
_LOCAL_POSTS = 64  # a side; places so near each other share one map to the local plane
_NOBODY = -1
_SNAP = 1e-7  # posts; below every position's accuracy, above the rounding of a projection
_WGS84 = CRS.from_epsg(4326)


class Mosaic:
    """Rasters of one CRS and posting whose posts fall on one grid: neighbours join without a seam.

    Grid coordinates (u, v) count columns and rows of posts from the first raster's first post; they may be
    negative. Where rasters overlap the first one counts, and later ones fill its voids. ``min_quality`` is the
    number of scenes below which a post of a raster with a quality layer is a void.
    """

    def __init__(self, first: Raster, cache: DemCache) -> None:
        self.posts = first.posts
        self.crs = first.crs
        self.rasters: list[Raster] = []
        self.min_quality = 0
        self._cache = cache
        self._to_grid = tuple((~first.posts)[:6])
        self._boxes: Ints = np.empty((0, 4), np.int64)  # first row, first column, end row, end column
        geographic = first.crs.equals(_WGS84, ignore_axis_order=True)
        self._transformer = None if geographic else Transformer.from_crs(_WGS84, first.crs, always_xy=True)
        self.posting_m = _posting_m(first)
        self.add(first)

    def takes(self, raster: Raster) -> bool:
        """Whether the raster's posts fall on this grid."""
        mine, its = np.array(self.posts[:6]), np.array(raster.posts[:6])
        size = np.abs(mine[[0, 1, 3, 4]]).max()
        # over its own width the raster may not drift from the grid
        drift = np.abs(mine - its)[[0, 1, 3, 4]].max() * max(raster.rows, raster.columns) / size
        if drift > ALIGNED_POSTS or raster.crs != self.crs:
            return False
        u, v = self._origin_of(raster)
        return bool(abs(u - round(u)) <= ALIGNED_POSTS and abs(v - round(v)) <= ALIGNED_POSTS)

    def add(self, raster: Raster) -> None:
        """Take a raster in; the caller asks ``takes`` first."""
        u, v = (round(w) for w in self._origin_of(raster))
        box = [v, u, v + raster.rows, u + raster.columns]
        self._boxes = np.vstack([self._boxes, np.array(box, np.int64)])
        self.rasters.append(raster)

    def filtered(self, min_quality: int) -> Mosaic:
        """The same posts, those with fewer scenes as voids; this mosaic itself where that changes nothing."""
        if min_quality == self.min_quality or not any(raster.quality for raster in self.rasters):
            return self
        view = copy.copy(self)
        view.min_quality = min_quality
        return view

    def _origin_of(self, raster: Raster) -> tuple[float, float]:
        """Grid coordinates of a raster's first post."""
        u, v = ~self.posts @ (raster.posts.c, raster.posts.f)
        return u, v

    def grid_coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """WGS 84 degrees, shape (n,), to (u, v); not finite where the CRS does not reach."""
        x, y = lon_deg, lat_deg
        if self._transformer is not None:
            x, y = self._transformer.transform(lon_deg, lat_deg)
        return _grid_coordinates(self._to_grid, np.asarray(x, np.float64), np.asarray(y, np.float64))

    def lonlat(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """(u, v) to WGS 84 degrees."""
        x, y = apply(self.posts, np.asarray(u, np.float64), np.asarray(v, np.float64))
        if self._transformer is None:
            return x, y
        lon, lat = self._transformer.transform(x, y, direction="INVERSE")
        return np.asarray(lon), np.asarray(lat)

    def local_grid(self, u: float, v: float, projection: LocalProjection) -> LocalGrid:
        """Where the posts around a place lie in a plane; the places of 64 x 64 posts share one map."""
        half = _LOCAL_POSTS // 2
        tile = int(u) // _LOCAL_POSTS, int(v) // _LOCAL_POSTS
        key = (id(self.rasters), projection, tile)  # views share the list of rasters

        def make() -> LocalGrid:
            columns, rows = (((2 * t - 1) * half, (2 * t + 3) * half) for t in tile)
            return LocalGrid.over(columns, rows, lambda u, v: projection.to_xy(*self.lonlat(u, v)))

        return self._cache.local_grid(key, make)

    def heights(self, u: Floats, v: Floats) -> Floats:
        """Triangulated heights at grid coordinates, shape (n,); NaN off the posts and at voids."""
        heights = np.full(len(u), np.nan)
        top, left = self._boxes[:, :2].min(axis=0)
        bottom, right = self._boxes[:, 2:].max(axis=0) - 1
        inside = np.flatnonzero((u >= left) & (u <= right) & (v >= top) & (v <= bottom))
        if not len(inside):
            return heights
        block = np.column_stack([np.floor(w[inside] / BLOCK_POSTS).astype(np.int64) for w in (v, u)])
        key = (block[:, 0] - block[:, 0].min()) * (np.ptp(block[:, 1]) + 1) + block[:, 1]
        order = np.argsort(key, kind="stable")
        for run in np.split(order, np.flatnonzero(np.diff(key[order])) + 1):
            row, column = (int(k) for k in block[run[0]])
            z = self._block(row, column)
            if z is not None:
                at = inside[run]
                heights[at] = tin_heights(z, u[at] - column * BLOCK_POSTS, v[at] - row * BLOCK_POSTS)
        return heights

    def sources(self, u: Floats, v: Floats) -> list[Raster]:
        """The rasters whose posts the heights at grid coordinates are made of; ask for places with a height only."""
        left, top = np.floor(u), np.floor(v)
        fu, fv = u - left, v - top
        low = fu + fv <= 1
        # The corners of the triangles as in ``tin_height``: A, B, C or D, B, C; one without weight is not looked at.
        corners = [
            (left + ~low, top + ~low, np.where(low, 1 - fu - fv, fu + fv - 1)),
            (left + 1, top, np.where(low, fu, 1 - fv)),
            (left, top + 1, np.where(low, fv, 1 - fu)),
        ]
        posts = np.concatenate([np.column_stack([y[w > 0], x[w > 0]]) for x, y, w in corners]).astype(
            np.int64
        )
        blocks, block_of = np.unique(posts // BLOCK_POSTS, axis=0, return_inverse=True)
        tiles: set[int] = set()
        for k, (row, column) in enumerate(blocks.tolist()):
            r, c = (posts[block_of.ravel() == k] - np.array([row, column]) * BLOCK_POSTS).T
            tiles.update(self._owners(row, column)[r, c].tolist())
        return [self.rasters[k] for k in sorted(tiles - {_NOBODY})]

    def window(self, columns: range, rows: range) -> Floats:
        """The posts of these columns and rows, shape (rows, columns); NaN off the rasters and at voids."""
        z = np.full((len(rows), len(columns)), np.nan)
        for block_row, to_rows, from_rows in _runs(rows):
            for block_column, to_columns, from_columns in _runs(columns):
                block = self._block(block_row, block_column)
                if block is not None:
                    z[to_rows, to_columns] = block[from_rows, from_columns]
        return z

    def _block(self, row: int, column: int) -> Floats | None:
        key = (id(self.rasters), self.min_quality, row, column)
        return self._cache.block(key, lambda: self._read_block(row, column))

    def _read_block(self, row: int, column: int) -> Floats | None:
        """A block's posts and the first of the next, so that no cell straddles blocks; None for no posts."""
        z: Floats | None = None
        for k, place, window in self._pieces(row, column):
            z = np.full((BLOCK_POSTS + 1, BLOCK_POSTS + 1), np.nan) if z is None else z
            part = z[place]
            void = np.isnan(part)
            if void.any():
                part[void] = self._read(self.rasters[k], *window)[void]
        return z

    def _owners(self, row: int, column: int) -> Ints:
        """The number of the raster that gives each post of a block, ``_NOBODY`` at voids."""

        def make() -> Ints:
            owner = np.full((BLOCK_POSTS + 1, BLOCK_POSTS + 1), _NOBODY)
            for k, place, window in self._pieces(row, column):
                part = owner[place]
                part[(part == _NOBODY) & np.isfinite(self._read(self.rasters[k], *window))] = k
            return owner

        return self._cache.block(("owners", id(self.rasters), self.min_quality, row, column), make)

    def _pieces(
        self, row: int, column: int
    ) -> Iterator[tuple[int, tuple[slice, slice], tuple[int, int, int, int]]]:
        """The rasters in a block: number, place in the block, and window of the raster (row, column, rows, columns)."""
        size = BLOCK_POSTS + 1
        top, left = row * BLOCK_POSTS, column * BLOCK_POSTS
        first = np.maximum(self._boxes[:, :2], [top, left])
        end = np.minimum(self._boxes[:, 2:], [top + size, left + size])
        for k in np.flatnonzero(np.all(end > first, axis=1)).tolist():
            (r0, c0), (r1, c1) = first[k].tolist(), end[k].tolist()
            r, c = (r0, c0) - self._boxes[k, :2]
            place = slice(r0 - top, r1 - top), slice(c0 - left, c1 - left)
            yield k, place, (int(r), int(c), r1 - r0, c1 - c0)

    def _read(self, raster: Raster, row: int, column: int, rows: int, columns: int) -> Floats:
        """Posts of one raster, without those that too few scenes saw."""
        z = read_posts(raster, self._cache.dataset(raster), row, column, rows, columns)
        if raster.quality is not None and self.min_quality > 0:
            dataset = self._cache.dataset(raster.quality)
            z[read_scenes(raster.quality, dataset, row, column, rows, columns) < self.min_quality] = np.nan
        return z


@dataclass(frozen=True, eq=False)
class DemPatch:
    """A rectangle of posts of one mosaic.

    ``z`` has shape (rows, columns), metres, NaN where no raster has a height; post [r, c] has the mosaic's
    grid coordinates (u0 + c * step, v0 + r * step). ``u`` and ``v`` are the mosaic's grid coordinates of the places
    that were asked for.
    """

    z: Floats
    u0: int
    v0: int
    step: int
    u: Floats
    v: Floats
    mosaic: Mosaic

    def local_grid(self, projection: LocalProjection) -> LocalGrid:
        """The map between a local plane and the mosaic's grid around this patch (``LocalGrid`` says how good)."""
        rows, columns = self.z.shape
        return self.mosaic.local_grid(
            self.u0 + columns * self.step / 2, self.v0 + rows * self.step / 2, projection
        )


def _runs(posts: range) -> Iterator[tuple[int, slice, slice]]:
    """Splits ascending ``posts`` by block: the block, their places among ``posts``, and their places in the block."""
    done = 0
    while done < len(posts):
        block = posts[done] // BLOCK_POSTS
        start = posts[done] - block * BLOCK_POSTS
        count = min(
            len(posts) - done, (BLOCK_POSTS - start) // posts.step + 1
        )  # the next block's first belongs
        end = start + (count - 1) * posts.step + 1
        yield block, slice(done, done + count), slice(start, end, posts.step)
        done += count


@compiled
def _grid_coordinates(affine: tuple[float, ...], x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """The affine map; coordinates within rounding of a post are the post's, so that edges still belong."""
    a, b, c, d, e, f = affine
    u, v = np.empty(x.shape), np.empty(x.shape)
    for k in range(len(x)):
        u[k], v[k] = a * x[k] + b * y[k] + c, d * x[k] + e * y[k] + f
        if abs(u[k] - np.round(u[k])) < _SNAP:
            u[k] = np.round(u[k])
        if abs(v[k] - np.round(v[k])) < _SNAP:
            v[k] = np.round(v[k])
    return u, v


def _posting_m(raster: Raster) -> tuple[float, float]:
    """Distances between neighbouring posts along a row and along a column, metres."""
    a, b, _, d, e, f = raster.posts[:6]
    if raster.crs.is_geographic:
        lat = d * raster.columns / 2 + e * raster.rows / 2 + f
        kx, ky = METRES_PER_DEGREE * float(np.cos(np.radians(lat))), METRES_PER_DEGREE
    else:
        kx = ky = float(raster.crs.axis_info[0].unit_conversion_factor)
    return float(np.hypot(a * kx, d * ky)), float(np.hypot(b * kx, e * ky))
