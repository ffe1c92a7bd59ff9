"""Tiles of single segments: their roads, which only an import changes, and their slopes, which every drive does.

Roads are read row by row once and kept encoded; a look at the states of their cells tells whether they are as they
were. Slopes are read for each tile anew. A feature says which of the tile's values are its slope, so that another slope
is another value, and the features stay as they are.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.map.derived.lines import HALF_WORLD, lines
from app.map.tiles import encoding
from app.map.tiles.connections import Connection
from app.map.tiles.encoding import BUFFER, EXTENT, Values
from app.map.tiles.memory import Memory
from app.network import ZOOM
from app.network.cells import WIDE, span
from fusion.types import Floats, Ints

DEM_DIGITS = 1
"""Of slopes by the elevation model in tiles: few differ after that, so that they cost a tile little."""
KEYS = (
    "drives",
    "slope_percent",
    "slope_sigma_percent",
    "highway",
    "oneway",
    "bridge",
    "tunnel",
    "dem_slope_percent",
)
_MOST_CELLS = 1024
"""Of which each is looked up for itself."""
_MANY = 1000
"""Roads. More are encoded in a thread."""
_FEATURE_BYTES = 36
"""Of one on average, encoded."""
_TOGETHER = 4
"""Segments whose numbers differ by no more are looked up together, with whatever is between."""

# The box for the index is wider than the tile by the buffer, else lines just outside it would end at its edge.
# On a bridge and in a tunnel the elevation model says nothing of the road.
_ROADS = f"""
    SELECT s.id, s.geom_3857, s.highway, s.oneway, s.bridge, s.tunnel,
           round(s.dem_slope_percent * {10**DEM_DIGITS}) / {10**DEM_DIGITS}
    FROM segments AS s
    WHERE s.geom_3857 && ST_TileEnvelope(%(z)s, %(x)s, %(y)s, margin => CAST({BUFFER / EXTENT} AS float8))
"""  # noqa: S608 - constants
# Equal states are equal roads: a step of an import raises the states of all cells that it changes anything in, and one
# of new heights writes the row of the elevation model. Editions show the live roads as well.
_STATE = """
    SELECT concat((SELECT epoch || CAST(xmin AS text) FROM public.tile_epoch), '.',
                  (SELECT sum(road_state) FROM public.cells WHERE {cells}), '.',
                  (SELECT id || '.' || CAST(xmin AS text) FROM public.dem_versions WHERE active))
"""
_STATE_OF_FEW = _STATE.format(cells="id = ANY(%(cells)s::bigint[])")
_STATE_OF_MANY = _STATE.format(
    cells=f"""id = {WIDE} OR (id BETWEEN (%(x0)s::integer << {ZOOM}) AND (%(x1)s::integer << {ZOOM} | {(1 << ZOOM) - 1})
                    AND (id & {(1 << ZOOM) - 1}) BETWEEN %(y0)s AND %(y1)s)"""
)
# A gap's slope is measured by nobody. Run by run: the planner would rather read all.
_SLOPES = """
    SELECT a.* FROM unnest(%(first)s::bigint[], %(last)s::bigint[]) AS run (first, last),
        LATERAL (SELECT segment_id, slope_percent, slope_sigma_percent, drives FROM segment_slopes
                 WHERE segment_id BETWEEN run.first AND run.last AND drives > 0 OFFSET 0) AS a
"""

Rows = Sequence[tuple[Any, ...]]


class Place(NamedTuple):
    """Zoom, column, row of a tile."""

    z: int
    x: int
    y: int


class _Driven(NamedTuple):
    """Which of a tile's segments have a slope, and all features as they are then."""

    rows: Ints
    features: bytes


@dataclass(eq=False)
class Roads:
    """The n segments that a tile shows, by ascending id, on its grid."""

    ids: Ints
    """(n,)"""
    ends: Ints
    """On the tile's grid, (n, 4)."""
    codes: Ints
    """Of each of ``KEYS`` which of ``values`` a segment without slope has, below 0 for none, (keys, n)."""
    values: Values
    _last: _Driven | None = None

    @property
    def size_bytes(self) -> int:
        """In memory, about, with its features."""
        arrays = sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))
        return arrays + len(self.values.written) + _FEATURE_BYTES * len(self.ids)

    def question(self) -> tuple[str, Mapping[str, Ints]]:
        """What the slopes are asked by, of some roads."""
        ids = self.ids
        begins = np.flatnonzero(np.diff(ids, prepend=ids[:1] - _TOGETHER - 1) > _TOGETHER)
        return _SLOPES, {"first": ids[begins], "last": ids[np.append(begins[1:], len(ids)) - 1]}

    def tile(self, name: str, slopes: Rows) -> bytes:
        """The vector tile with these slopes, as they were found in the database. For one thread."""
        columns: Any = list(zip(*slopes, strict=True)) or [()] * 4
        found = np.array(columns[0], np.int64)
        rows = np.searchsorted(self.ids, found)
        ours = np.flatnonzero(np.append(self.ids, -1)[rows] == found)
        ours = ours[np.argsort(rows[ours])]
        slope, sigma = (np.array(column, float)[ours] for column in columns[1:3])
        values = self.values + encoding.doubles(slope) + encoding.doubles(sigma)
        values += encoding.integers(np.array(columns[3], np.int64)[ours].tolist())
        return encoding.layer(name, self._features(rows[ours]), KEYS, values)

    def _features(self, rows: Ints) -> bytes:
        """All features: each with a slope has values of its own, the slopes of all first, then the sigmas, then the
        counts. So they are the same until another segment is driven for the first time."""
        if self._last is None or not np.array_equal(self._last.rows, rows):
            codes = self.codes.astype(np.int64)
            for key, block in ((KEYS.index("drives"), 2), (1, 0), (2, 1)):
                codes[key, rows] = self.values.count + block * len(rows) + np.arange(len(rows))
            features, _ = encoding.features(self.ids, self.ends, list(codes))
            self._last = _Driven(rows, features.tobytes())
        return self._last.features


KnownRoads = Memory[Place, Roads]
"""By tile, in the states that ``state_question`` tells."""


def state_question(at: Place) -> tuple[str, Mapping[str, Any]]:
    """What tells whether the roads of a tile are as they were: equal answers are equal roads."""
    (x0, x1), (y0, y1) = span(at.z, at.x), span(at.z, at.y)
    if (x1 - x0 + 1) * (y1 - y0 + 1) > _MOST_CELLS:
        return _STATE_OF_MANY, {"x0": x0, "x1": x1, "y0": y0, "y1": y1}
    cells = [column << ZOOM | row for column in range(x0, x1 + 1) for row in range(y0, y1 + 1)]
    return _STATE_OF_FEW, {"cells": np.array([WIDE, *cells], np.int64)}


def roads_of(at: Place, rows: Rows) -> Roads:
    """What the roads of a tile are encoded as; ``rows``: as the database has them."""
    columns: Any = list(zip(*sorted(rows, key=itemgetter(0)), strict=True)) or [()] * 7
    shown, ends = encoding.clipped(_units(at, lines(columns[1])))
    highways, highway = np.unique(np.array(columns[2], object).astype(str), return_inverse=True)
    dem = np.array(columns[6], float)  # None becomes NaN
    slopes, dem_code = np.unique(dem, return_inverse=True)
    known = np.isfinite(slopes)  # what is not comes last, or first
    values = encoding.integers((0, 1, -1)) + encoding.TRUE
    first_highway = values.count
    values += encoding.texts(highways.tolist())
    first_slope = values.count - int(np.argmax(known)) if known.any() else 0
    codes = np.full((len(KEYS), len(dem)), -1, np.int64)
    codes[KEYS.index("drives")] = 0
    codes[KEYS.index("highway")] = first_highway + highway
    codes[KEYS.index("oneway")] = np.array(columns[3], np.int64) % 3
    for flag, column in (("bridge", columns[4]), ("tunnel", columns[5])):
        codes[KEYS.index(flag)] = np.where(np.array(column, bool), 3, -1)
    codes[KEYS.index("dem_slope_percent")] = np.where(np.isfinite(dem), first_slope + dem_code, -1)
    values += encoding.doubles(slopes[known])
    ids, codes = np.array(columns[0], np.int64)[shown], codes[:, shown]
    narrow = np.int16 if values.count < np.iinfo(np.int16).max else np.int32
    return Roads(ids, ends.astype(np.int16), codes.astype(narrow), values)


def _units(at: Place, line_3857: Floats) -> Floats:
    """Ends of lines (n, 4) in units of a tile from its north-western corner."""
    scale = EXTENT * (1 << at.z) / (2 * HALF_WORLD)
    x, y = line_3857[..., 0], line_3857[..., 1]
    units = np.stack(
        [(x + HALF_WORLD) * scale - EXTENT * at.x, (HALF_WORLD - y) * scale - EXTENT * at.y], axis=-1
    )
    return units.reshape(-1, 4)


async def tile_of(connection: Connection, name: str, at: Place, state: str, known: KnownRoads) -> bytes:
    """The vector tile as it is now; of the roads only what is not ``known`` in this state is read."""
    roads = known.get(at, state)
    if roads is None:
        rows = await _fetch(connection, _ROADS, at._asdict())
        roads = await asyncio.to_thread(roads_of, at, rows) if len(rows) > _MANY else roads_of(at, rows)
        known.put(at, state, roads)
    return roads.tile(name, await _fetch(connection, *roads.question())) if len(roads.ids) else b""


async def _fetch(connection: Connection, statement: str, values: Mapping[str, Any]) -> Rows:
    cursor = connection.cursor(binary=True)
    await cursor.execute(statement, values)
    return await cursor.fetchall()


def tile_now(session: Session, name: str, at: Place) -> bytes:
    """The vector tile as the session's transaction sees it."""
    roads = roads_of(at, fetch_binary(session, _ROADS, at._asdict()))
    return roads.tile(name, fetch_binary(session, *roads.question())) if len(roads.ids) else b""
