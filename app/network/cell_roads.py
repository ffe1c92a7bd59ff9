"""The stored roads, square by square, kept in memory from one solution to the next: until an import changes those of a
square they are the same (``road_states``), and reading them takes longer than solving.

A square's roads are all that meet it, so one that reaches into another is in both. What stands beside roads, drives
and slopes, is not kept.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from sqlalchemy import Engine, text
from sqlalchemy.orm import Session

from app.network.cells import ZOOM
from app.network.extracts import ROAD_COLUMNS, ROAD_ORDER, road_table
from app.network.road_states import road_states
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

MOST_KEPT = 200_000
"""Segments that a process keeps, about 100 bytes each: those of a large town."""

READ_TOGETHER = 64
"""Squares; of what is read for a long drive only what lies along it stays."""

_SIDE = 1 << ZOOM

_OF_SQUARES = text(
    f"""
    SELECT square.id AS square, s.cell, {ROAD_COLUMNS}
    FROM unnest(:squares, :west, :south, :east, :north) AS square (id, west, south, east, north)
    JOIN segments AS s ON s.geom && ST_MakeEnvelope(square.west, square.south, square.east, square.north, 4326)
    ORDER BY square.id, {ROAD_ORDER}
    """  # noqa: S608 - constants
)


@dataclass(frozen=True, eq=False)
class Roads:
    """Segments in the order of ``RoadTable``, with their ids and squares, shape (n,) each."""

    table: RoadTable
    ids: Ints
    cell: Ints
    states: Mapping[int, int] = field(default_factory=dict)
    """What stood in the squares that they were taken from (``app.network.road_states``)"""

    def along(self, boxes_deg: Floats) -> Roads:
        """Those whose bounding box meets one of the boxes (m, 4: west, south, east, north)."""
        kept = np.flatnonzero(self.table.meets(boxes_deg))
        return Roads(self.table.subset(kept), self.ids[kept], self.cell[kept], self.states)


@dataclass(eq=False)
class _Kept:
    """What a process has read of one database: squares, each in one state, the last used at the end."""

    squares: OrderedDict[int, tuple[int, Roads]] = field(default_factory=OrderedDict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def of(self, states: Mapping[int, int]) -> dict[int, Roads]:
        """Those of these squares that are there as they are now."""
        with self.lock:
            found = {
                square: self.squares[square][1]
                for square, state in states.items()
                if self.squares.get(square, (-1, None))[0] == state
            }
            for square in found:
                self.squares.move_to_end(square)
            return found

    def keep(self, states: Mapping[int, int], read: Mapping[int, Roads]) -> None:
        """Add what was read, and let go what was not used for the longest."""
        with self.lock:
            for square, roads in read.items():
                if states[square] >= self.squares.get(square, (-1, None))[0]:
                    self.squares[square] = (states[square], roads)
            count = sum(len(roads.ids) for _, roads in self.squares.values())
            while count > MOST_KEPT:
                count -= len(self.squares.popitem(last=False)[1][1].ids)


_KEPT: WeakKeyDictionary[Engine, _Kept] = WeakKeyDictionary()
_KEPT_LOCK = threading.Lock()


def roads_in(session: Session, boxes_deg: Floats) -> Roads:
    """The segments that ``RoadTable.along`` would select from the whole network.

    ``boxes_deg`` (m, 4): west, south, east, north. Coordinates are bit for bit those that were imported, rows sorted as
    in every ``RoadTable``, so that the same log on the same roads gives the same numbers with and without a database.
    """
    boxes = _boxes_by_square(boxes_deg)
    kept = _kept(session.get_bind().engine)
    every, parts = sorted(boxes), list[Roads]()
    states = road_states(session, every)
    for squares in (every[k : k + READ_TOGETHER] for k in range(0, len(every), READ_TOGETHER)):
        found = kept.of({square: states[square] for square in squares})
        found |= (read := _read(session, [square for square in squares if square not in found]))
        parts += [found[square].along(boxes[square]) for square in squares]
        if read:
            # Outside of a snapshot an import may have come between.
            now = road_states(session, list(read))
            kept.keep(
                states, {square: roads for square, roads in read.items() if now[square] == states[square]}
            )
    return replace(_joined(parts), states=states)


def _kept(engine: Engine) -> _Kept:
    with _KEPT_LOCK:
        return _KEPT.setdefault(engine, _Kept())


def _read(session: Session, squares: Sequence[int]) -> dict[int, Roads]:
    if not squares:
        return {}
    number = np.array(squares, np.int64)
    west, south, east, north = _bounds(number)
    values = {"squares": number, "west": west, "south": south, "east": east, "north": north}
    rows = session.execute(_OF_SQUARES, values).all()
    first = np.searchsorted([row.square for row in rows], np.append(number, number[-1] + 1)).tolist()
    return {
        square: Roads(*road_table(rows[a:b]), np.array([row.cell for row in rows[a:b]], np.int64))
        for square, a, b in zip(squares, first[:-1], first[1:], strict=True)
    }


def _joined(parts: Sequence[Roads]) -> Roads:
    """The roads of all, each once."""
    if not parts:
        return Roads(RoadTable.empty(), np.empty(0, np.int64), np.empty(0, np.int64))
    ids, first = np.unique(np.concatenate([part.ids for part in parts]), return_index=True)
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part.table, name) for part in parts])[first]
        for name in RoadTable.columns()
    }
    order = np.lexsort((columns["to_node"], columns["from_node"], columns["osm_way_id"]))
    cell = np.concatenate([part.cell for part in parts])[first]
    return Roads(RoadTable(**{name: v[order] for name, v in columns.items()}), ids[order], cell[order])


def _boxes_by_square(boxes_deg: Floats) -> dict[int, Floats]:
    """The squares that the boxes meet, each with those boxes."""
    west, south, east, north = boxes_deg.T
    x0, y1 = _column(west), _row(south)
    x1, y0 = _column(east), _row(north)
    met: dict[int, list[int]] = {}
    for k, (left, right, top, bottom) in enumerate(zip(*(v.tolist() for v in (x0, x1, y0, y1)), strict=True)):
        for x in range(left, right + 1):
            for y in range(top, bottom + 1):
                met.setdefault(x << ZOOM | y, []).append(k)
    return {square: boxes_deg[rows] for square, rows in met.items()}


def _column(lon_deg: Floats) -> Ints:
    return np.clip(np.floor((lon_deg + 180) / 360 * _SIDE), 0, _SIDE - 1).astype(np.int64)


def _row(lat_deg: Floats) -> Ints:
    lat = np.radians(np.clip(lat_deg, -_LAST_DEG, _LAST_DEG))
    return np.clip(np.floor((1 - np.arcsinh(np.tan(lat)) / np.pi) / 2 * _SIDE), 0, _SIDE - 1).astype(np.int64)


_LAST_DEG = float(np.degrees(np.arctan(np.sinh(np.pi))))
"""The latitude at which the last rows of squares end; what lies beyond is theirs."""


def _bounds(squares: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """West, south, east, north of squares, degrees; those at the edge of the map reach to the edge of the world."""
    x, y = squares >> ZOOM, squares & (_SIDE - 1)
    north, south = (
        np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * row / _SIDE)))) for row in (y.astype(float), y + 1.0)
    )
    north, south = np.where(y == 0, 90.0, north), np.where(y == _SIDE - 1, -90.0, south)
    return x / _SIDE * 360 - 180, south, (x + 1) / _SIDE * 360 - 180, north
