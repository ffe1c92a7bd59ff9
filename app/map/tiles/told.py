"""What the tiles' watcher sees, for those who are told of it as it happens (``app.changes.live``)."""

from __future__ import annotations

import math

from app.core.db import Bounds
from app.map.tiles.watch import Watch
from app.network.cells import ZOOM

_SIDE = (1 << ZOOM) - 1
Squares = tuple[int, int, int, int]
"""First column and row, last column and row."""


class WatchedMap:
    """The map of a ``Watch``, as ``app.changes.live.WatchedMap`` says. The only one who listens to it."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._squares: Squares | None = None
        self._any = False
        watch.heard = self._hear

    async def version(self) -> str:
        """As of now; equal versions are equal tiles, in whatever process."""
        versions = await self._watch.look()
        sums = versions.of(0, 0, 0)
        return f"{versions.epoch}.{sums.near}.{sums.far}"

    def take_box(self) -> Bounds | None:
        """Where anything changed since this was asked last; None: it may be anywhere."""
        squares, anywhere = self._squares, self._any
        self._squares, self._any = None, False
        return None if anywhere or squares is None else box_of(squares)

    def _hear(self, squares: list[int] | None) -> None:
        if squares is None:
            self._any = True
            return
        columns = [square >> ZOOM for square in squares]
        rows = [square & _SIDE for square in squares]
        if self._squares is not None:
            columns += self._squares[::2]
            rows += self._squares[1::2]
        self._squares = (min(columns), min(rows), max(columns), max(rows))


def box_of(squares: Squares) -> Bounds:
    """West, south, east, north of squares, degrees."""
    left, top, right, bottom = squares

    def longitude(column: int) -> float:
        return float(column / (1 << ZOOM) * 360 - 180)

    def latitude(row: int) -> float:
        return math.degrees(math.atan(math.sinh(math.pi * (1 - 2 * row / (1 << ZOOM)))))

    return longitude(left), latitude(bottom + 1), longitude(right + 1), latitude(top)
