"""Extracts of the stored roads as the library's tables: whole, around a place, or cell by cell and kept in memory.

``app.roads`` writes the roads; what was measured on them is not known here. The roads of a cell are all that meet it; a
road that reaches into two cells is in both. They stay the same until an import changes them (``cells.road_states``),
and reading them takes longer than solving.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from sqlalchemy import Engine, Row, TextClause, text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.tables import WITHOUT_HEIGHTS
from app.network import ZOOM
from app.network.cells import road_states
from fusion.roads.table import DTYPE_OF, RoadTable
from fusion.types import Floats, Ints

_LINE_HEADER_BYTES = 9  # WKB: byte order, type, number of points

# What ``road_table`` reads, of the table that is called s (segments), and the order of its rows.
ROAD_COLUMNS = """s.id, s.osm_way_id, s.from_node, s.to_node, ST_AsBinary(s.geom, 'NDR') AS line,
           s.oneway, s.bridge, s.tunnel, s.layer, s.highway, s.name"""
ROAD_ORDER = "s.osm_way_id, s.from_node, s.to_node"
_CORNERS = ("west", "south", "east", "north")

_BOXES = """
    unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]), CAST(:north AS float8[]))
        AS box (west, south, east, north)
    JOIN segments AS i ON i.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326)
"""


def _roads_where(condition: str) -> TextClause:
    return text(f"SELECT {ROAD_COLUMNS} FROM segments AS s WHERE {condition} ORDER BY {ROAD_ORDER}")  # noqa: S608


_ALL = _roads_where("true")
_IN_BOX = _roads_where("s.geom && ST_MakeEnvelope(:west, :south, :east, :north, 4326)")
_BY_IDS = _roads_where("s.id = ANY(CAST(:ids AS bigint[]))")
_WITHOUT_HEIGHTS = _roads_where(f"""
    s.id IN (SELECT id FROM segments WHERE id > :after AND {WITHOUT_HEIGHTS} ORDER BY id LIMIT :limit)
""")  # noqa: S608 - constants
_WITHOUT_HEIGHTS_IN = _roads_where(f"""
    EXISTS (SELECT FROM segments WHERE {WITHOUT_HEIGHTS})
    AND s.id IN (SELECT i.id FROM {_BOXES} WHERE {WITHOUT_HEIGHTS})
""")  # noqa: S608 - constants
_IDS_IN = text(f"SELECT DISTINCT i.id FROM {_BOXES} WHERE i.id > :after ORDER BY i.id")  # noqa: S608 - constants


def roads_within(session: Session, bounds_deg: Bounds) -> tuple[RoadTable, Ints]:
    """At least the segments whose bounding box meets ``bounds_deg``, and their ids, shape (n,).

    The index compares boxes in single precision, rounded outwards, so a few more may come along.
    """
    return road_table(session.execute(_IN_BOX, dict(zip(_CORNERS, bounds_deg, strict=True))).all())


def segment_ids_in(session: Session, boxes_deg: Floats, after_id: int = 0) -> Ints:
    """The ids above one of the segments that meet one of the boxes (m, 4: west, south, east, north), ascending."""
    values = {**dict(zip(_CORNERS, boxes_deg.T.tolist(), strict=True)), "after": after_id}
    return np.array(session.execute(_IDS_IN, values).scalars().all(), np.int64)


def roads_of(session: Session, ids: Ints) -> tuple[RoadTable, Ints]:
    """Those of the segments that are there, and their ids."""
    return road_table(session.execute(_BY_IDS, {"ids": ids}).all())


def all_roads(session: Session) -> tuple[RoadTable, Ints]:
    """The whole network and the segments' ids, shape (n,)."""
    return road_table(session.execute(_ALL).all())


def roads_without_heights(session: Session, after_id: int, limit: int) -> tuple[RoadTable, Ints]:
    """The next segments after an id that have a slope by the elevation model but no heights, and their ids."""
    return road_table(session.execute(_WITHOUT_HEIGHTS, {"after": after_id, "limit": limit}).all())


def roads_without_heights_in(session: Session, boxes_deg: Floats) -> tuple[RoadTable, Ints]:
    """Those of all that meet one of the boxes (m, 4: west, south, east, north)."""
    box = dict(zip(_CORNERS, boxes_deg.T.tolist(), strict=True))
    return road_table(session.execute(_WITHOUT_HEIGHTS_IN, box).all())


def road_table(rows: Sequence[Row[Any]]) -> tuple[RoadTable, Ints]:
    """Rows of ``ROAD_COLUMNS`` in ``ROAD_ORDER`` as a table, and their ids, shape (n,)."""
    values = dict(zip(rows[0]._fields, zip(*rows, strict=True), strict=True)) if rows else {}
    lines = b"".join(bytes(line)[_LINE_HEADER_BYTES:] for line in values.get("line", ()))
    lon0, lat0, lon1, lat1 = np.frombuffer(lines, "<f8").reshape(-1, 4).astype(np.float64).T.copy()
    columns: dict[str, Any] = {"lon0_deg": lon0, "lat0_deg": lat0, "lon1_deg": lon1, "lat1_deg": lat1}
    for name in set(RoadTable.columns()) - columns.keys():
        columns[name] = np.array(values.get(name, ()), DTYPE_OF[name])
    return RoadTable(**columns), np.array(values.get("id", ()), np.int64)


MOST_CACHED = 200_000
"""Segments that a process keeps, about 100 bytes each: those of a large town."""

CELLS_AT_ONCE = 64
"""Cells that one query reads. A long drive needs only the roads along it; the rest is dropped after each query."""

_SIDE = 1 << ZOOM

_OF_CELLS = text(f"""
    SELECT box.id AS read_for, s.cell, {ROAD_COLUMNS}
    FROM unnest(:cells, :west, :south, :east, :north) AS box (id, west, south, east, north)
    JOIN segments AS s ON s.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326)
    ORDER BY box.id, {ROAD_ORDER}
""")  # noqa: S608 - constants


@dataclass(frozen=True, eq=False)
class Roads:
    """Segments in the order of ``RoadTable``, with their ids and cells, shape (n,) each."""

    table: RoadTable
    ids: Ints
    cell: Ints
    states: Mapping[int, int] = field(default_factory=dict)
    """The state of the roads of each cell that was read (``app.network.cells``)"""

    def along(self, boxes_deg: Floats) -> Roads:
        """Those whose bounding box meets one of the boxes (m, 4: west, south, east, north)."""
        rows = np.flatnonzero(self.table.meets(boxes_deg))
        return Roads(self.table.subset(rows), self.ids[rows], self.cell[rows], self.states)


@dataclass(eq=False)
class _Cache:
    """The cells that a process has read of one database, each in one state; the most recently used is the last."""

    cells: OrderedDict[int, tuple[int, Roads]] = field(default_factory=OrderedDict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, states: Mapping[int, int]) -> dict[int, Roads]:
        """The roads of those of these cells that are cached in their present state."""
        with self.lock:
            cached = {
                cell: self.cells[cell][1]
                for cell, state in states.items()
                if self.cells.get(cell, (-1, None))[0] == state
            }
            for cell in cached:
                self.cells.move_to_end(cell)
            return cached

    def add(self, states: Mapping[int, int], read: Mapping[int, Roads]) -> None:
        """Add cells that were read, and drop the least recently used ones."""
        with self.lock:
            for cell, roads in read.items():
                if states[cell] >= self.cells.get(cell, (-1, None))[0]:
                    self.cells[cell] = (states[cell], roads)
            count = sum(len(roads.ids) for _, roads in self.cells.values())
            while count > MOST_CACHED:
                count -= len(self.cells.popitem(last=False)[1][1].ids)


_CACHES: WeakKeyDictionary[Engine, _Cache] = WeakKeyDictionary()
_CACHES_LOCK = threading.Lock()


def roads_in(session: Session, boxes_deg: Floats) -> Roads:
    """The segments that ``RoadTable.along`` would select from the whole network.

    ``boxes_deg`` (m, 4): west, south, east, north. Coordinates are bit for bit those that were imported, rows sorted as
    in every ``RoadTable``, so that the same log on the same roads gives the same numbers with and without a database.
    """
    boxes = _boxes_by_cell(boxes_deg)
    with _CACHES_LOCK:
        cache = _CACHES.setdefault(session.get_bind().engine, _Cache())
    ids, parts = sorted(boxes), list[Roads]()
    states = road_states(session, ids)
    for cells in (ids[k : k + CELLS_AT_ONCE] for k in range(0, len(ids), CELLS_AT_ONCE)):
        roads = cache.get({cell: states[cell] for cell in cells})
        roads |= (read := _read(session, [cell for cell in cells if cell not in roads]))
        parts += [roads[cell].along(boxes[cell]) for cell in cells]
        if read:
            # Outside of a snapshot an import may have changed the roads meanwhile.
            now = road_states(session, list(read))
            cache.add(states, {cell: read[cell] for cell in read if now[cell] == states[cell]})
    return replace(_joined(parts), states=states)


def _read(session: Session, cells: Sequence[int]) -> dict[int, Roads]:
    if not cells:
        return {}
    number = np.array(cells, np.int64)
    west, south, east, north = _bounds(number)
    values = {"cells": number, "west": west, "south": south, "east": east, "north": north}
    rows = session.execute(_OF_CELLS, values).all()
    first = np.searchsorted([row.read_for for row in rows], np.append(number, number[-1] + 1)).tolist()
    return {
        cell: Roads(*road_table(rows[a:b]), np.array([row.cell for row in rows[a:b]], np.int64))
        for cell, a, b in zip(cells, first[:-1], first[1:], strict=True)
    }


def _joined(parts: Sequence[Roads]) -> Roads:
    """The roads of all parts, each road once."""
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


def _boxes_by_cell(boxes_deg: Floats) -> dict[int, Floats]:
    """The cells that the boxes meet, each with those boxes."""
    west, south, east, north = boxes_deg.T
    x0, y1 = _column(west), _row(south)
    x1, y0 = _column(east), _row(north)
    met: dict[int, list[int]] = {}
    for k, (left, right, top, bottom) in enumerate(zip(*(v.tolist() for v in (x0, x1, y0, y1)), strict=True)):
        for x in range(left, right + 1):
            for y in range(top, bottom + 1):
                met.setdefault(x << ZOOM | y, []).append(k)
    return {cell: boxes_deg[rows] for cell, rows in met.items()}


def _column(lon_deg: Floats) -> Ints:
    return np.clip(np.floor((lon_deg + 180) / 360 * _SIDE), 0, _SIDE - 1).astype(np.int64)


def _row(lat_deg: Floats) -> Ints:
    lat = np.radians(np.clip(lat_deg, -_LAST_DEG, _LAST_DEG))
    return np.clip(np.floor((1 - np.arcsinh(np.tan(lat)) / np.pi) / 2 * _SIDE), 0, _SIDE - 1).astype(np.int64)


_LAST_DEG = float(np.degrees(np.arctan(np.sinh(np.pi))))
"""The latitude at which the first and last rows of cells end; places beyond belong to them."""


def _bounds(cells: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """West, south, east, north of cells, degrees; those at the edge of the map reach to the poles."""
    x, y = cells >> ZOOM, cells & (_SIDE - 1)
    north, south = (
        np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * row / _SIDE)))) for row in (y.astype(float), y + 1.0)
    )
    north, south = np.where(y == 0, 90.0, north), np.where(y == _SIDE - 1, -90.0, south)
    return x / _SIDE * 360 - 180, south, (x + 1) / _SIDE * 360 - 180, north
