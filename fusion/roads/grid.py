"""A grid over road segments in a plane: which of them are near a place; compiled.

Knows lines and their ``oneway``, no names, no degrees and no rule of matching.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled, inlined
from fusion.types import Floats, Ints

_MIN_CELL_M = 50.0  # no cell is smaller
_CELLS_PER_SEGMENT = (
    4.0  # there are no more, about: cells grow with the extent, memory with the segments only
)
_SLACK_M = 1e-6  # far above the rounding of coordinates, far below anything that matters


class SegmentGrid(NamedTuple):
    """n segments and their grid, as plain arrays for compiled loops.

    ``x0 y0 x1 y1`` are metres, ``oneway`` as in ``RoadTable``. Cell (column, row) has the number
    ``row * columns + column``; ``items[start[cell]:start[cell + 1]]`` are the segments that pass through it.
    """

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats
    oneway: NDArray[np.int8]
    west: float
    south: float
    cell_m: float
    columns: int
    rows: int
    start: Ints
    items: Ints


def build_grid(x0: Floats, y0: Floats, x1: Floats, y1: Floats, oneway: NDArray[np.int8]) -> SegmentGrid:
    """Index n finite segments (shape (n,), metres). Cells grow with the extent: memory is linear in n."""
    n, items = len(x0), np.empty(0, np.int64)
    if n == 0:
        return SegmentGrid(x0, y0, x1, y1, oneway, 0.0, 0.0, _MIN_CELL_M, 1, 1, np.zeros(2, np.int64), items)
    west, south = float(min(x0.min(), x1.min())), float(min(y0.min(), y1.min()))
    width, height = float(max(x0.max(), x1.max())) - west, float(max(y0.max(), y1.max())) - south
    cell = max(
        _MIN_CELL_M,
        float(np.sqrt(width * height / (_CELLS_PER_SEGMENT * n))),
        max(width, height) / (_CELLS_PER_SEGMENT * n),
    )
    columns, rows = int(width / cell) + 1, int(height / cell) + 1
    start = np.zeros(columns * rows + 1, np.int64)
    grid = SegmentGrid(x0, y0, x1, y1, oneway, west, south, cell, columns, rows, start, items)
    _fill_cells(grid, start, items, True)
    np.cumsum(start, out=start)
    items = np.empty(start[-1], np.int64)
    _fill_cells(grid, start[:-1].copy(), items, False)
    return grid._replace(items=items)


@compiled
def segments_within(grid: SegmentGrid, x: float, y: float, radius: float) -> Ints:
    """Indices, ascending, of the segments no farther than ``radius`` from (x, y)."""
    first, last, low, high = cells_around(grid, x, y, radius + _SLACK_M)
    rows = np.empty(items_in(grid.start, grid.columns, first, last, low, high), np.int64)
    count = 0
    for row in range(low, high + 1):
        begin, end = grid.start[row * grid.columns + first], grid.start[row * grid.columns + last + 1]
        for k in range(begin, end):
            s = grid.items[k]
            _, px, py = project_point(grid.x0[s], grid.y0[s], grid.x1[s], grid.y1[s], x, y)
            if (px - x) ** 2 + (py - y) ** 2 <= radius * radius:
                rows[count] = s
                count += 1
    return np.unique(rows[:count])


@inlined
def cells_around(grid: SegmentGrid, x: float, y: float, reach: float) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the cells that meet the square around a point."""
    return (
        clamp_cell(x - reach - grid.west, grid.cell_m, grid.columns),
        clamp_cell(x + reach - grid.west, grid.cell_m, grid.columns),
        clamp_cell(y - reach - grid.south, grid.cell_m, grid.rows),
        clamp_cell(y + reach - grid.south, grid.cell_m, grid.rows),
    )


@inlined
def items_in(start: Ints, columns: int, low: int, high: int, bottom: int, top: int) -> int:
    """How many segments the cells list, some of them more than once."""
    total = 0
    for row in range(bottom, top + 1):
        total += start[row * columns + high + 1] - start[row * columns + low]
    return total


@compiled
def project_point(
    x0: float, y0: float, x1: float, y1: float, x: float, y: float
) -> tuple[float, float, float]:
    """Share along the segment (0..1) and position of the point of the segment nearest to (x, y)."""
    dx, dy = x1 - x0, y1 - y0
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(max(((x - x0) * dx + (y - y0) * dy) / square, 0.0), 1.0)
    return share, x0 + share * dx, y0 + share * dy


@compiled
def clamp_cell(offset_m: float, cell_m: float, count: int) -> int:
    """The cell of an offset from the grid's edge, clamped to 0 .. count - 1."""
    return int(min(max(np.floor(offset_m / cell_m), 0.0), count - 1.0))


@compiled
def _fill_cells(grid: SegmentGrid, cursor: Ints, items: Ints, counting: bool) -> None:
    """Visit every cell that each segment touches: count into cursor[cell + 1], or write at cursor[cell]."""
    west, south, cell, columns, rows = grid.west, grid.south, grid.cell_m, grid.columns, grid.rows
    for s in range(len(grid.x0)):
        xa, ya, xb, yb = grid.x0[s] - west, grid.y0[s] - south, grid.x1[s] - west, grid.y1[s] - south
        if xa > xb:
            xa, ya, xb, yb = xb, yb, xa, ya
        first, last = clamp_cell(xa - _SLACK_M, cell, columns), clamp_cell(xb + _SLACK_M, cell, columns)
        for column in range(first, last + 1):
            ta, tb = 0.0, 1.0
            if xb > xa:
                ta = min(max((column * cell - _SLACK_M - xa) / (xb - xa), 0.0), 1.0)
                tb = min(max(((column + 1) * cell + _SLACK_M - xa) / (xb - xa), 0.0), 1.0)
            yl, yh = ya + ta * (yb - ya), ya + tb * (yb - ya)
            low = clamp_cell(min(yl, yh) - _SLACK_M, cell, rows)
            high = clamp_cell(max(yl, yh) + _SLACK_M, cell, rows)
            for row in range(low, high + 1):
                at = row * columns + column
                if counting:
                    cursor[at + 1] += 1
                else:
                    items[cursor[at]] = s
                    cursor[at] += 1
