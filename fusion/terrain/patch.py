"""The posts around a place, and how they lie in a local plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.terrain.layer import Layer
from fusion.types import Floats


@dataclass(frozen=True, eq=False)
class DemPatch:
    """A rectangle of posts of one layer of a mosaic.

    ``z`` has shape (rows, columns), metres, NaN where no raster has a height; post [r, c] has the layer's
    grid coordinates (u0 + c * step, v0 + r * step).
    """

    z: Floats
    u0: int
    v0: int
    step: int
    layer: Layer

    @property
    def posting_m(self) -> tuple[float, float]:
        """Distances between neighbouring posts along a row and along a column, metres."""
        along_row, along_column = self.layer.posting_m
        return along_row * self.step, along_column * self.step

    def lonlat(self) -> tuple[Floats, Floats]:
        """Longitudes and latitudes of all posts, degrees, both of ``z``'s shape."""
        return self.lonlat_of(*np.indices(self.z.shape))

    def lonlat_of(self, rows: ArrayLike, columns: ArrayLike) -> tuple[Floats, Floats]:
        """Longitudes and latitudes, degrees, of the posts ``z[rows, columns]`` (fractions allowed)."""
        u, v = np.asarray(columns, float), np.asarray(rows, float)
        return self.layer.lonlat(self.u0 + u * self.step, self.v0 + v * self.step)

    def xy(self, projection: LocalProjection) -> tuple[Floats, Floats]:
        """Local metres of all posts, both of ``z``'s shape."""
        return projection.to_xy(*self.lonlat())

    def grid_coordinates(self, lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
        """WGS 84 degrees to (u, v) of this patch: columns and rows from ``z[0, 0]``."""
        u, v = self.layer.grid_coordinates(np.asarray(lon_deg, float), np.asarray(lat_deg, float))
        return (u - self.u0) / self.step, (v - self.v0) / self.step

    def local_grid(self, projection: LocalProjection) -> LocalGrid:
        """The map from local metres to (u, v) of this patch."""
        rows, columns = self.z.shape
        u, v = np.meshgrid(np.linspace(0, max(columns - 1, 1), 5), np.linspace(0, max(rows - 1, 1), 5))
        x, y = projection.to_xy(*self.lonlat_of(v, u))
        return LocalGrid.fit(x.ravel(), y.ravel(), u.ravel(), v.ravel())


@dataclass(frozen=True, eq=False)
class LocalGrid:
    """Grid coordinates as quadratics of local metres: a projection per particle would take too long."""

    x0_m: float
    y0_m: float
    scale_m: float
    coefficients: Floats  # shape (6, 2): of 1, x, y, x2, xy, y2, for u and v

    @classmethod
    def fit(cls, x_m: Floats, y_m: Floats, u: Floats, v: Floats) -> LocalGrid:
        """Least squares over samples, each of shape (n,), n >= 6."""
        x0, y0 = float(x_m.mean()), float(y_m.mean())
        scale = float(max(np.ptp(x_m), np.ptp(y_m))) / 2
        terms = _quadratic((x_m - x0) / scale, (y_m - y0) / scale)
        coefficients = np.linalg.lstsq(terms, np.column_stack([u, v]), rcond=None)[0]
        return cls(x0, y0, scale, np.asarray(coefficients, np.float64))

    def to_grid(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
        """Local metres to (u, v), shapes kept."""
        x, y = (
            (np.asarray(x_m, float) - self.x0_m) / self.scale_m,
            (np.asarray(y_m, float) - self.y0_m) / self.scale_m,
        )
        uv = _quadratic(x, y) @ self.coefficients
        return uv[..., 0], uv[..., 1]


def _quadratic(x: Floats, y: Floats) -> Floats:
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
