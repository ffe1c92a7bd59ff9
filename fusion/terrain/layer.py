"""Rasters that share one grid of posts, as one grid."""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import Any

import numpy as np
from pyproj import CRS, Transformer

from fusion.terrain.raster import Raster, apply, open_raster, read_posts
from fusion.terrain.tin import tin_heights
from fusion.types import Floats, Ints

BLOCK_POSTS = 256
_MAX_BLOCKS = 128  # of 0.5 MB each
_MAX_OPEN_FILES = 32
_ALIGNED = 0.01  # posts by which a raster may be off the grid of its layer
_SNAP = 1e-7  # posts; below every position's accuracy, above the rounding of a projection
_WGS84 = CRS.from_epsg(4326)
_METRES_PER_DEGREE = 111_132.0


class Store:
    """What the layers of one mosaic share: open files and blocks read, both bounded, behind one lock."""

    def __init__(self) -> None:
        self.lock = Lock()  # rasterio's datasets must not be used by two threads at once
        self._files: OrderedDict[int, Any] = OrderedDict()
        self._blocks: OrderedDict[tuple[int, int, int], Floats | None] = OrderedDict()
        self.closed = False

    def dataset(self, raster: Raster) -> Any:
        """The open dataset of a raster; closes the one that was not used for longest."""
        key = id(raster)
        if key not in self._files:
            self._files[key] = open_raster(raster.path)[1]
            if len(self._files) > _MAX_OPEN_FILES:
                self._files.popitem(last=False)[1].close()
        self._files.move_to_end(key)
        return self._files[key]

    def block(self, layer: Layer, row: int, column: int) -> Floats | None:
        """One block of a layer, from memory or from its files."""
        with self.lock:
            if self.closed:
                raise ValueError("the elevation model is closed")
            key = (id(layer), row, column)
            if key not in self._blocks:
                self._blocks[key] = layer.read_block(self, row, column)
                if len(self._blocks) > _MAX_BLOCKS:
                    self._blocks.popitem(last=False)
            self._blocks.move_to_end(key)
            return self._blocks[key]

    def close(self) -> None:
        """Close every file and forget every block."""
        with self.lock:
            self.closed = True
            for dataset in self._files.values():
                dataset.close()
            self._files.clear()
            self._blocks.clear()


class Layer:
    """Rasters of one CRS and posting whose posts fall on one grid: neighbours join without a seam.

    Grid coordinates (u, v) count columns and rows of posts from the first raster's first post; they may be
    negative. Where rasters overlap the first one counts, and later ones fill its voids.
    """

    def __init__(self, first: Raster) -> None:
        self.posts = first.posts
        self.crs = first.crs
        self.rasters: list[Raster] = []
        self._inverse = ~first.posts
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
        if drift > _ALIGNED or raster.crs != self.crs:
            return False
        u, v = self._origin_of(raster)
        return bool(abs(u - round(u)) <= _ALIGNED and abs(v - round(v)) <= _ALIGNED)

    def add(self, raster: Raster) -> None:
        """Take a raster in; the caller asks ``takes`` first."""
        u, v = (round(w) for w in self._origin_of(raster))
        box = [v, u, v + raster.rows, u + raster.columns]
        self._boxes = np.vstack([self._boxes, np.array(box, np.int64)])
        self.rasters.append(raster)

    def _origin_of(self, raster: Raster) -> tuple[float, float]:
        """Grid coordinates of a raster's first post."""
        u, v = apply(self._inverse, np.array([raster.posts.c]), np.array([raster.posts.f]))
        return float(u[0]), float(v[0])

    def grid_coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """WGS 84 degrees to (u, v), shapes kept; not finite where the CRS does not reach."""
        x, y = lon_deg, lat_deg
        if self._transformer is not None:
            x, y = self._transformer.transform(lon_deg, lat_deg)
        u, v = apply(self._inverse, np.asarray(x, np.float64), np.asarray(y, np.float64))
        return _snapped(u), _snapped(v)

    def lonlat(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """(u, v) to WGS 84 degrees."""
        x, y = apply(self.posts, np.asarray(u, np.float64), np.asarray(v, np.float64))
        if self._transformer is None:
            return x, y
        lon, lat = self._transformer.transform(x, y, direction="INVERSE")
        return np.asarray(lon), np.asarray(lat)

    def heights(self, store: Store, u: Floats, v: Floats) -> Floats:
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
            z = store.block(self, row, column)
            if z is not None:
                at = inside[run]
                heights[at] = tin_heights(z, u[at] - column * BLOCK_POSTS, v[at] - row * BLOCK_POSTS)
        return heights

    def read_block(self, store: Store, row: int, column: int) -> Floats | None:
        """A block's posts and the first of the next, so that no cell straddles blocks; None for no posts."""
        size = BLOCK_POSTS + 1
        top, left = row * BLOCK_POSTS, column * BLOCK_POSTS
        first = np.maximum(self._boxes[:, :2], [top, left])
        end = np.minimum(self._boxes[:, 2:], [top + size, left + size])
        z: Floats | None = None
        for k in np.flatnonzero(np.all(end > first, axis=1)):
            raster, (r0, c0), (r1, c1) = self.rasters[k], first[k], end[k]
            z = np.full((size, size), np.nan) if z is None else z
            part = z[r0 - top : r1 - top, c0 - left : c1 - left]
            void = np.isnan(part)
            if void.any():
                r, c = int(r0 - self._boxes[k, 0]), int(c0 - self._boxes[k, 1])
                read = read_posts(raster, store.dataset(raster), r, c, int(r1 - r0), int(c1 - c0))
                part[void] = read[void]
        return z


def _snapped(w: Floats) -> Floats:
    """Coordinates within rounding of a post are the post's, so that a tile's edge still belongs to it."""
    nearest = np.round(w)
    return np.where(np.abs(w - nearest) < _SNAP, nearest, w)


def _posting_m(raster: Raster) -> tuple[float, float]:
    """Distances between neighbouring posts along a row and along a column, metres."""
    a, b, _, d, e, f = raster.posts[:6]
    if raster.crs.is_geographic:
        lat = d * raster.columns / 2 + e * raster.rows / 2 + f
        kx, ky = _METRES_PER_DEGREE * float(np.cos(np.radians(lat))), _METRES_PER_DEGREE
    else:
        kx = ky = float(raster.crs.axis_info[0].unit_conversion_factor)
    return float(np.hypot(a * kx, d * ky)), float(np.hypot(b * kx, e * ky))
