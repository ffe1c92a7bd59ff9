"""The posts around places, and how they lie in a local plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.frames import LocalProjection
from fusion.terrain.layer import Layer
from fusion.terrain.local_grid import LocalGrid
from fusion.types import Floats


@dataclass(frozen=True, eq=False)
class DemPatch:
    """A rectangle of posts of one layer of a mosaic.

    ``z`` has shape (rows, columns), metres, NaN where no raster has a height; post [r, c] has the layer's
    grid coordinates (u0 + c * step, v0 + r * step). ``u`` and ``v`` are the layer's grid coordinates of the places
    that were asked for.
    """

    z: Floats
    u0: int
    v0: int
    step: int
    u: Floats
    v: Floats
    layer: Layer

    @property
    def posting_m(self) -> tuple[float, float]:
        """Distances between neighbouring posts along a row and along a column, metres."""
        along_row, along_column = self.layer.posting_m
        return along_row * self.step, along_column * self.step

    def lonlat(self) -> tuple[Floats, Floats]:
        """Longitudes and latitudes of all posts, degrees, both of ``z``'s shape."""
        rows, columns = np.indices(self.z.shape, float)
        return self.layer.lonlat(self.u0 + columns * self.step, self.v0 + rows * self.step)

    def xy(self, projection: LocalProjection) -> tuple[Floats, Floats]:
        """Local metres of all posts, both of ``z``'s shape."""
        return projection.to_xy(*self.lonlat())

    def local_grid(self, projection: LocalProjection) -> LocalGrid:
        """The map between a local plane and the layer's grid around this patch (``LocalGrid`` says how good)."""
        rows, columns = self.z.shape
        return self.layer.local_grid(
            self.u0 + columns * self.step / 2, self.v0 + rows * self.step / 2, projection
        )
