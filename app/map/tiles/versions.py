"""The versions of all squares in memory, summed up for every tile: whether a tile is new costs no look at a table.

A tile is as new as the squares that it shows (``app.network.cells``). Of those it knows the sum of their versions and
the sum of the times of their last changes: equal sums are equal data, in every process and after every start, since a
change raises a version. Zooms further out than ``WIDE`` squares have sums that are kept up to date, square by square;
nearer ones add up the few squares below them when they are asked for.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

from app.network.cells import ZOOM, span

WIDE = 12
"""Tiles of lower zooms meet a hundred squares and more."""

Square = tuple[int, int, int, int]
"""Number, version, version of what is drawn from afar, time of the last change (microseconds)."""

_SIDE = (1 << ZOOM) - 1
_NOTHING = (0, 0, 0)


@dataclass(frozen=True)
class Sums:
    """Of the squares that a tile shows."""

    version: int
    drawn: int
    changed_us: int

    @property
    def near(self) -> str:
        """What tells any change of segments."""
        return f"{self.version}.{self.changed_us:x}"

    @property
    def far(self) -> str:
        """What tells any change of what is drawn from afar."""
        return f"{self.drawn}d"


@dataclass
class Versions:
    """Of all squares, as one look at the database found them."""

    epoch: str = ""
    _squares: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    _wide: list[dict[int, list[int]]] = field(default_factory=lambda: [{} for _ in range(WIDE)])
    """By zoom and tile (x << zoom | y): the three sums."""

    def put(self, squares: Iterable[Square]) -> bool:
        """These are so now, the others as before; whether anything is otherwise."""
        changed = False
        for number, *now in squares:
            before = self._squares.get(number, _NOTHING)
            version, drawn, changed_us = now
            if before == (version, drawn, changed_us):
                continue
            changed = True
            self._squares[number] = (version, drawn, changed_us)
            more = (version - before[0], drawn - before[1], changed_us - before[2])
            columns, rows = _reach(number >> ZOOM), _reach(number & _SIDE)
            for z, sums_of in enumerate(self._wide):
                for column in columns[z]:
                    for row in rows[z]:
                        sums = sums_of.setdefault(column << z | row, [0, 0, 0])
                        sums[0] += more[0]
                        sums[1] += more[1]
                        sums[2] += more[2]
        return changed

    def of(self, z: int, x: int, y: int) -> Sums:
        """The sums of the squares that a tile shows, its margin included."""
        if z < WIDE:
            return Sums(*self._wide[z].get(x << z | y, _NOTHING))
        version = drawn = changed_us = 0
        x0, x1 = span(z, x)
        y0, y1 = span(z, y)
        for column in range(x0 << ZOOM, (x1 << ZOOM) + 1, 1 << ZOOM):
            for row in range(y0, y1 + 1):
                found = self._squares.get(column | row)
                if found is not None:
                    version += found[0]
                    drawn += found[1]
                    changed_us += found[2]
        return Sums(version, drawn, changed_us)

    def __len__(self) -> int:
        return len(self._squares)


@lru_cache(maxsize=20_000)
def _reach(square: int) -> tuple[tuple[int, ...], ...]:
    """By zoom, the columns, or rows, of tiles that show a column, or row, of squares."""
    found = []
    for z in range(WIDE):
        middle = square >> (ZOOM - z)
        near = range(max(0, middle - 1), min((1 << z) - 1, middle + 1) + 1)
        found.append(tuple(one for one in near if span(z, one)[0] <= square <= span(z, one)[1]))
    return tuple(found)
