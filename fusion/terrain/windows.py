"""The terrain under one road segment: triangulated, or a plane through a window of posts around it.

The windows of Al Assaad 2020, 3.2.1 (figure 3.1). Their size follows the posting: each is made of the cells
of the grid, and one window serves the whole segment, so that heights along it are consistent.

- ``adjacent``: the corners of the cells that the segment passes through (the thesis's choice, FGA);
- ``full``: the smallest rectangle of cells that holds the segment, one cell wider on each side;
- ``hollow``: the border of that rectangle only.

The bridge from terrain to roads: no other file of this room knows a segment, and roads know no heights.
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
from fusion.terrain.local_grid import LocalGrid, polynomial, tin_height
from fusion.terrain.mosaic import DemPatch
from fusion.terrain.plane import PlaneModel, plane_through
from fusion.types import Floats, Ints

TIN_MARGIN_M = 150.0
"""How far from its segment a ``TinModel`` knows heights, at least; an estimate farther off is not on it."""

Mask = NDArray[np.bool_]
Select = Callable[[tuple[int, ...], Floats, Floats], Mask]


class HeightModel(Protocol):
    """The terrain near one segment."""

    def height_at(self, x_m: float, y_m: float) -> float:
        """The height in metres at a place in local metres; NaN where unknown."""
        ...


@dataclass(frozen=True, eq=False)
class TinModel:
    """The triangulated surface around one segment, over the posts of a patch."""

    patch: DemPatch
    grid: LocalGrid

    def height_at(self, x_m: float, y_m: float) -> float:
        """The height at a place in local metres; NaN beyond the patch and at voids."""
        patch, grid = self.patch, self.grid
        posts = patch.u0, patch.v0, patch.step
        return float(_tin_height(patch.z, posts, grid.plane_box, grid.to_grid, x_m, y_m))


@compiled
def _tin_height(
    z: Floats,
    posts: tuple[float, float, float],
    box: tuple[float, float, float],
    to_grid: Floats,
    x_m: float,
    y_m: float,
) -> float:
    u, v = polynomial(to_grid, (x_m - box[0]) / box[2], (y_m - box[1]) / box[2])
    return tin_height(z, (u - posts[0]) / posts[2], (v - posts[1]) / posts[2])


@dataclass(frozen=True)
class DemWindow:
    """A way to look at the terrain under a segment; called once per segment, it serves every epoch.

    A least-squares plane through the posts that ``select`` takes; triangles where they make no plane, or it is None.
    ``select``, compiled, gets the shape of a patch and the segment's ends in its grid coordinates, and marks posts.
    """

    name: str
    description: str
    select: Select | None = None

    def model(self, dem: Dem, network: RoadNetwork, segment: int) -> HeightModel | None:
        """The heights near a segment of the network, or None where the elevation model has none there."""
        ends = _ends_deg(network.table, segment)
        if self.select is not None:
            patch = dem.posts(*ends, margin_posts=2)
            plane = None if patch is None else _plane(self.select, patch, network)
            if plane is not None:
                return plane
        patch = dem.posts(*ends, margin_posts=2, margin_m=TIN_MARGIN_M)
        return None if patch is None else TinModel(patch, patch.local_grid(network.projection))


def _plane(select: Select, patch: DemPatch, network: RoadNetwork) -> PlaneModel | None:
    """The plane, or None for fewer than 3 posts or collinear ones."""
    u0, v0, step = patch.u0, patch.v0, patch.step
    marked = select(patch.z.shape, (patch.u - u0) / step, (patch.v - v0) / step)
    grid = patch.local_grid(network.projection)
    plane: PlaneModel = _plane_of_marked(patch.z, marked, (u0, v0, step), grid.grid_box, grid.to_plane)
    return plane if plane.posts else None


@compiled
def _plane_of_marked(
    z: Floats,
    marked: Mask,
    posts: tuple[float, float, float],
    box: tuple[float, float, float, float],
    to_plane: Floats,
) -> PlaneModel:
    """The plane through the marked posts that have a height; ``posts`` is their grid (u0, v0, step)."""
    rows, columns = np.nonzero(marked & np.isfinite(z))
    n = len(rows)
    x_m, y_m, height = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        s = (posts[0] + columns[k] * posts[2] - box[0]) / box[2]
        t = (posts[1] + rows[k] * posts[2] - box[1]) / box[3]
        x_m[k], y_m[k] = polynomial(to_plane, s, t)
        height[k] = z[rows[k], columns[k]]
    # Posts of one grid line are judged on the grid: in the plane, meridians and parallels bend a little.
    if _on_one_line(rows, columns):
        n = 0
    return plane_through(x_m[:n], y_m[:n], height[:n])


@compiled
def _on_one_line(rows: Ints, columns: Ints) -> bool:
    """Whether posts, ordered along rows, lie on one line: no triangle with the first and the last has an area."""
    for k in range(1, len(rows) - 1):
        across = (rows[k] - rows[0]) * (columns[-1] - columns[0])
        if across != (columns[k] - columns[0]) * (rows[-1] - rows[0]):
            return False
    return True


def _ends_deg(table: RoadTable, segment: int) -> tuple[Floats, Floats]:
    """Longitudes and latitudes of a segment's ends."""
    return (
        np.array([table.lon0_deg[segment], table.lon1_deg[segment]]),
        np.array([table.lat0_deg[segment], table.lat1_deg[segment]]),
    )


@compiled
def _adjacent(shape: tuple[int, ...], u: Floats, v: Floats) -> Mask:
    """The corners of every cell that the segment (u[0], v[0]) - (u[1], v[1]) passes through."""
    marked = np.zeros(shape, np.bool_)
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
    return marked


@compiled
def _full(shape: tuple[int, ...], u: Floats, v: Floats) -> Mask:
    """The posts of the cells that hold both ends, and one more on each side."""
    marked = np.zeros(shape, np.bool_)
    top, bottom = int(np.floor(v.min())) - 1, int(np.floor(v.max())) + 2
    left, right = int(np.floor(u.min())) - 1, int(np.floor(u.max())) + 2
    marked[max(top, 0) : bottom + 1, max(left, 0) : right + 1] = True
    return marked


@compiled
def _hollow(shape: tuple[int, ...], u: Floats, v: Floats) -> Mask:
    """The border of ``_full``."""
    marked = _full(shape, u, v)
    top, bottom = int(np.floor(v.min())) - 1, int(np.floor(v.max())) + 2
    left, right = int(np.floor(u.min())) - 1, int(np.floor(u.max())) + 2
    marked[max(top, 0) + 1 : bottom, max(left, 0) + 1 : right] = False
    return marked


WINDOWS: Registry[DemWindow] = Registry("DEM window")
"""The windows by name; ``adjacent`` is the default of every method that fits planes."""
for _window in (
    DemWindow("tin", "the two triangles of each cell (chapter 2): follows the ground, no smoothing"),
    DemWindow("adjacent", "plane through the corners of the cells that the segment crosses (FGA)", _adjacent),
    DemWindow("full", "plane through the rectangle around the segment, one cell wider", _full),
    DemWindow("hollow", "plane through the border of the rectangle around the segment", _hollow),
):
    WINDOWS.add(_window.name, _window)


def dem_slopes(dem: Dem, table: RoadTable) -> Floats:
    """Slopes from the triangulated heights at both ends, percent from from_node to to_node, shape (n,).

    The simplest look at the terrain under roads, without a window: two heights and a length for every segment of
    a table. NaN where a height is unknown or the segment has no length. Both heights are of one raster's grid where
    one knows both (``Dem.heights_along``).
    """
    ends = np.concatenate([table.lon0_deg, table.lon1_deg]), np.concatenate([table.lat0_deg, table.lat1_deg])
    heights = dem.heights_along(*ends, np.tile(np.arange(len(table)), 2))
    rise = heights[len(table) :] - heights[: len(table)]
    return 100 * rise / np.where(table.length_m > 0, table.length_m, np.nan)
