"""A uniform grid over segments in the plane: which segments come near a point, without visiting all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fusion.roads.kernels import SegmentGrid, fill_cells
from fusion.types import Floats

_MIN_CELL_M = 50.0
_CELLS_PER_SEGMENT = 4.0


def build_grid(x0: Floats, y0: Floats, x1: Floats, y1: Floats, oneway: NDArray[np.int8]) -> SegmentGrid:
    """Index n finite segments (shape (n,), metres). Cells grow with the extent: memory is linear in n."""
    n = len(x0)
    if n == 0:
        return SegmentGrid(
            x0, y0, x1, y1, oneway, 0.0, 0.0, _MIN_CELL_M, 1, 1, np.zeros(2, np.int64), np.empty(0, np.int64)
        )
    west, south = float(min(x0.min(), x1.min())), float(min(y0.min(), y1.min()))
    width, height = float(max(x0.max(), x1.max())) - west, float(max(y0.max(), y1.max())) - south
    cell = max(
        _MIN_CELL_M,
        float(np.sqrt(width * height / (_CELLS_PER_SEGMENT * n))),
        max(width, height) / (_CELLS_PER_SEGMENT * n),
    )
    columns, rows = int(width / cell) + 1, int(height / cell) + 1
    start = np.zeros(columns * rows + 1, np.int64)
    fill_cells(x0, y0, x1, y1, west, south, cell, columns, rows, start, np.empty(0, np.int64), True)
    np.cumsum(start, out=start)
    items = np.empty(start[-1], np.int64)
    fill_cells(x0, y0, x1, y1, west, south, cell, columns, rows, start[:-1].copy(), items, False)
    return SegmentGrid(x0, y0, x1, y1, oneway, west, south, cell, columns, rows, start, items)
