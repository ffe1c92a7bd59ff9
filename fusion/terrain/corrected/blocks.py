"""Any rectangle of a corrected model's posts, put together from blocks whose places are fixed on earth.

So a post has one height, whichever file asks for it: neighbouring tiles share the posts of their edges.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fusion.terrain.corrected.fit import Block, CorrectedTerrain
from fusion.terrain.corrected.grids import PostGrid

SIDE_POSTS = 256
KEPT = 40
"""Blocks in memory, a megabyte each: more than a tile has along an edge."""


class Blocks:
    """The posts of one grid."""

    def __init__(
        self, terrain: CorrectedTerrain, grid: PostGrid, look: Callable[[], object] = lambda: None
    ) -> None:
        """``look`` is called before each block that is solved, and may raise what ends the work."""
        self.grid = grid
        self._terrain = terrain
        self._look = look
        self._kept: dict[tuple[int, int], Block] = {}

    def window(self, columns: range, rows: range) -> Block:
        """The posts of these columns and rows, whose steps are 1."""
        height = np.empty((len(rows), len(columns)), np.float32)
        change = np.empty(height.shape, np.uint8)
        for j in range(rows.start // SIDE_POSTS, (rows.stop - 1) // SIDE_POSTS + 1):
            for i in range(columns.start // SIDE_POSTS, (columns.stop - 1) // SIDE_POSTS + 1):
                down, from_rows = _overlap(j, rows)
                across, from_columns = _overlap(i, columns)
                block = self._block(i, j)
                height[down, across] = block.height_m[from_rows, from_columns]
                change[down, across] = block.change[from_rows, from_columns]
        return Block(height, change)

    def _block(self, i: int, j: int) -> Block:
        if (known := self._kept.pop((i, j), None)) is None:
            self._look()
            columns, rows = (range(k * SIDE_POSTS, (k + 1) * SIDE_POSTS) for k in (i, j))
            solved = self._terrain.block(self.grid, columns, rows)
            known = Block(solved.height_m.astype(np.float32), solved.change.astype(np.uint8))
        self._kept[i, j] = known  # the last one asked for is the last to go
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
        return known


def _overlap(block: int, wanted: range) -> tuple[slice, slice]:
    """Where a block's rows or columns lie among those wanted, and which of its own they are."""
    begin, end = max(block * SIDE_POSTS, wanted.start), min((block + 1) * SIDE_POSTS, wanted.stop)
    return slice(begin - wanted.start, end - wanted.start), slice(
        begin - block * SIDE_POSTS, end - block * SIDE_POSTS
    )


def filled(height_m: NDArray[np.floating], void: int) -> NDArray[np.floating]:
    """Heights with a number for voids."""
    return np.where(np.isnan(height_m), np.float32(void), height_m)
