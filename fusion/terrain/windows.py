"""The terrain under one road segment: triangulated, or a plane through a window of posts around it.

The windows of Al Assaad 2020, 3.2.1 (figure 3.1). Their size follows the posting: each is made of the cells
of the grid, and one window serves the whole segment, so that heights along it are consistent.

- ``adjacent``: the corners of the cells that the segment passes through (the thesis's choice, FGA);
- ``full``: the smallest rectangle of cells that holds the segment, one cell wider on each side;
- ``hollow``: the border of that rectangle only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.registry import Registry
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.patch import DemPatch, LocalGrid
from fusion.terrain.plane import PlaneModel, fit_plane
from fusion.terrain.tin import tin_heights
from fusion.types import Floats

TIN_MARGIN_M = 150.0
"""How far from its segment a ``TinModel`` knows heights, at least; an estimate farther off is not on it."""

Mask = NDArray[np.bool_]


class HeightModel(Protocol):
    """The terrain near one segment."""

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights in metres at local metres, in the broadcast shape; NaN where unknown."""
        ...


class DemWindow(Protocol):
    """A way to look at the terrain under a segment; called once per segment, it serves every epoch."""

    @property
    def name(self) -> str:
        """The name in ``WINDOWS``."""
        ...

    @property
    def description(self) -> str:
        """One line for people."""
        ...

    def model(self, dem: Dem, network: RoadNetwork, segment: int) -> HeightModel | None:
        """The heights near a segment of the network, or None where the elevation model has none there."""
        ...


@dataclass(frozen=True, eq=False)
class TinModel:
    """The triangulated surface around one segment: ``z`` (rows, columns) over the grid, NaN at voids."""

    z: Floats
    grid: LocalGrid

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights at local metres, in the broadcast shape; NaN beyond the patch and at voids."""
        x, y = np.broadcast_arrays(np.asarray(x_m, float), np.asarray(y_m, float))
        u, v = self.grid.to_grid(x, y)
        return tin_heights(self.z, u.ravel(), v.ravel()).reshape(x.shape)


@dataclass(frozen=True)
class TinWindow:
    """The registered form of ``TinModel``."""

    name: str = "tin"
    description: str = "the two triangles of each cell (chapter 2): follows the ground, no smoothing"

    def model(self, dem: Dem, network: RoadNetwork, segment: int) -> TinModel | None:
        """See ``DemWindow``."""
        patch = dem.posts(_bounds_deg(network.table, segment), margin_posts=2, margin_m=TIN_MARGIN_M)
        return None if patch is None else TinModel(patch.z, patch.local_grid(network.projection))


@dataclass(frozen=True)
class PlaneWindow:
    """A least-squares plane through the posts that ``select`` takes; triangles where they make no plane.

    ``select`` gets the shape of the patch and the segment's ends in its grid coordinates, and marks posts.
    """

    name: str
    description: str
    select: Callable[[tuple[int, int], Floats, Floats], Mask]

    def model(self, dem: Dem, network: RoadNetwork, segment: int) -> HeightModel | None:
        """See ``DemWindow``."""
        patch = dem.posts(_bounds_deg(network.table, segment), margin_posts=2)
        plane = None if patch is None else self.plane(patch, network, segment)
        return plane or TinWindow().model(dem, network, segment)

    def plane(
        self, patch: DemPatch, network: RoadNetwork, segment: int, quality: Mask | None = None
    ) -> PlaneModel | None:
        """The plane, or None for fewer than 3 posts or collinear ones.

        ``quality`` (of the patch's shape) marks posts good enough to count: the seam for quality layers.
        """
        table = network.table
        u, v = patch.grid_coordinates(
            np.array([table.lon0_deg[segment], table.lon1_deg[segment]]),
            np.array([table.lat0_deg[segment], table.lat1_deg[segment]]),
        )
        shape = (patch.z.shape[0], patch.z.shape[1])
        chosen = self.select(shape, u, v) & np.isfinite(patch.z)
        if quality is not None:
            chosen &= quality
        rows, columns = np.nonzero(chosen)
        # Posts of one grid line are judged on the grid: in the plane, meridians and parallels bend a little.
        if len(rows) < 3 or _on_one_line(rows, columns):
            return None
        x, y = network.projection.to_xy(*patch.lonlat_of(rows, columns))
        return fit_plane(x, y, patch.z[rows, columns])


def _bounds_deg(table: RoadTable, segment: int) -> tuple[float, float, float, float]:
    lon0, lon1 = float(table.lon0_deg[segment]), float(table.lon1_deg[segment])
    lat0, lat1 = float(table.lat0_deg[segment]), float(table.lat1_deg[segment])
    return min(lon0, lon1), min(lat0, lat1), max(lon0, lon1), max(lat0, lat1)


def _on_one_line(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> bool:
    dr, dc = rows - rows[0], columns - columns[0]
    far = int(np.argmax(dr * dr + dc * dc))
    return not np.any(dr * dc[far] - dc * dr[far])


@compiled
def _mark_cells(u: Floats, v: Floats, marked: Mask) -> None:
    """Mark the corners of every cell that the segment (u[0], v[0]) - (u[1], v[1]) passes through."""
    ua, va, ub, vb = u[0], v[0], u[1], v[1]
    if ua > ub:
        ua, va, ub, vb = ub, vb, ua, va
    for column in range(int(np.floor(ua)), int(np.floor(ub)) + 1):
        ta, tb = 0.0, 1.0
        if ub > ua:
            ta = min(max((column - ua) / (ub - ua), 0.0), 1.0)
            tb = min(max((column + 1 - ua) / (ub - ua), 0.0), 1.0)
        one, other = va + ta * (vb - va), va + tb * (vb - va)
        for row in range(int(np.floor(min(one, other))), int(np.floor(max(one, other))) + 1):
            marked[max(row, 0) : row + 2, max(column, 0) : column + 2] = True


def _adjacent(shape: tuple[int, int], u: Floats, v: Floats) -> Mask:
    marked = np.zeros(shape, np.bool_)
    _mark_cells(u, v, marked)
    return marked


def _full(shape: tuple[int, int], u: Floats, v: Floats) -> Mask:
    marked = np.zeros(shape, np.bool_)
    marked[_around(v), _around(u)] = True
    return marked


def _hollow(shape: tuple[int, int], u: Floats, v: Floats) -> Mask:
    marked = _full(shape, u, v)
    rows, columns = _around(v), _around(u)
    marked[rows.start + 1 : rows.stop - 1, columns.start + 1 : columns.stop - 1] = False
    return marked


def _around(w: Floats) -> slice:
    """The posts of the cells that hold both ends, and one more on each side."""
    return slice(max(int(np.floor(w.min())) - 1, 0), int(np.floor(w.max())) + 3)


WINDOWS: Registry[DemWindow] = Registry("DEM window")
"""The windows by name; ``adjacent`` is the default of every method that fits planes."""
WINDOWS.add("tin", TinWindow())
for _window in (
    PlaneWindow(
        "adjacent", "plane through the corners of the cells that the segment crosses (FGA)", _adjacent
    ),
    PlaneWindow("full", "plane through the rectangle around the segment, one cell wider", _full),
    PlaneWindow("hollow", "plane through the border of the rectangle around the segment", _hollow),
):
    WINDOWS.add(_window.name, _window)


def dem_slopes(dem: Dem, table: RoadTable) -> Floats:
    """Slopes from the triangulated heights at both ends, percent from from_node to to_node, shape (n,).

    NaN where a height is unknown or the segment has no length.
    """
    heights = dem.heights(
        np.concatenate([table.lon0_deg, table.lon1_deg]), np.concatenate([table.lat0_deg, table.lat1_deg])
    )
    rise = heights[len(table) :] - heights[: len(table)]
    return 100 * rise / np.where(table.length_m > 0, table.length_m, np.nan)
