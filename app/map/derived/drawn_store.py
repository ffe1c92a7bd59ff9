"""The pieces of whole tiles: a block with the cells inside it from segments, one of a higher level from pieces.

What pieces are made of comes out of the database here, and pieces go into it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from app.map.derived import drawing
from app.map.derived.chains import Course, chains_of, courses, places, together_m
from app.map.derived.lines import HALF_WORLD, lines
from app.network import ZOOM
from app.network.cells import TILE_MARGIN
from fusion.types import Bools, Floats, Ints

# A gap's slope is measured by nobody. What is not followed yet is not drawn yet, or nobody would know of it when it
# goes (``app.map.derived``).
_SEGMENTS = """
    SELECT s.id, s.highway, s.oneway, s.length_m, a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0),
           s.geom_3857, s.osm_way_id, s.from_node, s.to_node, s.cell
    FROM segments AS s
    JOIN derived_segments AS d ON d.segment_id = s.id AND d.cell = s.cell
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
    WHERE s.cell = ANY(%(cells)s::bigint[])
        AND (s.cell = ANY(%(all_of)s::bigint[]) OR s.highway = ANY(%(classes)s::text[]) OR a.drives > 0)
    ORDER BY s.id
"""
_CLASSES = text("""
    SELECT DISTINCT s.highway FROM segments AS s
    JOIN derived_segments AS d ON d.segment_id = s.id AND d.cell = s.cell
    WHERE s.cell = ANY(CAST(:cells AS integer[]))
""")
_COLUMNS = ", ".join(drawing.Piece._fields)
_PIECES = f"""
    SELECT cell, {_COLUMNS} FROM drawn_pieces
    WHERE level = %(level)s AND cell = ANY(%(tiles)s::bigint[]) ORDER BY segment_id
"""  # noqa: S608 - constants
_DELETE = """
    DELETE FROM drawn_pieces AS p USING unnest(%(cell)s::bigint[], %(id)s::bigint[]) AS gone (cell, id)
    WHERE p.level = %(level)s AND p.cell = gone.cell AND p.segment_id = gone.id
"""
_INSERT = f"""
    INSERT INTO drawn_pieces (level, cell, {_COLUMNS})
    SELECT %(level)s, cell, segment_id, rank, highway, oneway, slope, sigma, drives, length, ST_GeomFromEWKB(geom)
    FROM unnest(%(cell)b::bigint[], %(segment_id)b::bigint[], %(rank)b::bigint[], %(highway)b::text[],
                %(oneway)b::bigint[], %(slope_percent)b::float8[], %(slope_sigma_percent)b::float8[],
                %(drives)b::bigint[], %(length_m)b::float8[], %(geom_3857)b::bytea[])
        AS row (cell, segment_id, rank, highway, oneway, slope, sigma, drives, length, geom)
"""  # noqa: S608 - constants

# Any cell that nobody is at: solvers and imports hold some for milliseconds.
_FREE_CELL = text("""
    SELECT id FROM cells WHERE id BETWEEN :first AND :last AND (id & 16383) BETWEEN :top AND :bottom
    ORDER BY id LIMIT 1 FOR UPDATE SKIP LOCKED
""")
_MAKE = text(
    "INSERT INTO cells (id) SELECT unnest(CAST(:ids AS integer[])) ORDER BY 1 ON CONFLICT (id) DO NOTHING"
)
_TAKE = text(
    "SELECT id FROM cells WHERE id = ANY(CAST(:ids AS integer[])) ORDER BY id FOR UPDATE SKIP LOCKED"
)
_RAISE = text("UPDATE cells SET drawn_version = drawn_version + 1 WHERE id = ANY(CAST(:ids AS integer[]))")

_BEYOND = 8 * TILE_MARGIN / 2
"""Of the side of a level's tile: how far a vector tile, at most eight of them wide, draws beyond its edge."""

Drawn = dict[int, dict[int, drawing.Piece]]
"""Pieces by tile and segment."""


class Ends(NamedTuple):
    """Beside stretches that are segments: the way of each, its nodes, and its cell; shape (n,)."""

    osm_way_id: Ints
    from_node: Ints
    to_node: Ints
    cell: Ints


def segments_in(
    session: Session,
    cells: Collection[int],
    all_of: Collection[int],
    classes: Collection[str] = drawing.CHOSEN,
) -> tuple[drawing.Stretches, Ends]:
    """Followed segments in cells: all of ``all_of``, of others driven ones and those of the classes."""
    values = {"cells": np.array(sorted(cells), np.int64), "all_of": np.array(sorted(all_of), np.int64)}
    rows = fetch_binary(session, _SEGMENTS, {**values, "classes": sorted(classes)})
    columns = list(zip(*rows, strict=True)) or [()] * 12
    points = lines(columns[7]).reshape(-1, 2)
    return (
        _stretches(columns[:7], points, 2 * np.arange(len(rows) + 1)),
        Ends(*(np.array(column, np.int64) for column in columns[8:])),
    )


def most_important_in(session: Session, cells: Collection[int]) -> list[str]:
    """Of the classes in these tiles those of the lowest rank."""
    classes = session.execute(_CLASSES, {"cells": sorted(cells)}).scalars().all()
    lowest = min(map(drawing.rank, classes), default=0)
    return [highway for highway in classes if drawing.rank(highway) == lowest]


def drawn(session: Session, level: int, tiles: Collection[int]) -> Drawn:
    """The pieces that are there."""
    pieces: Drawn = {tile: {} for tile in tiles}
    for tile, *row in fetch_binary(
        session, _PIECES, {"level": level, "tiles": np.array(sorted(tiles), np.int64)}
    ):
        piece = drawing.Piece(*row)
        pieces[tile][piece.segment_id] = piece
    return pieces


def stretches_of(pieces: Iterable[drawing.Piece]) -> drawing.Stretches:
    """Pieces as what those of the level above are made of, by ascending id."""
    ordered = sorted(pieces)
    columns = list(zip(*(p[:1] + p[2:4] + (p.length_m, *p[4:7]) for p in ordered), strict=True)) or [()] * 7
    geometry = shapely.from_wkb(np.array([p.geom_3857 for p in ordered], object))
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(geometry))]).astype(np.int64)
    return _stretches(columns, shapely.get_coordinates(geometry), first)


def _stretches(columns: Any, points: Floats, first: Ints) -> drawing.Stretches:
    """The columns before the points as arrays, in the order of ``Stretches``."""
    names = ("ids", "highway", "oneway", "length_m", "slope_percent", "sigma_percent", "drives")
    types = (np.int64, object, np.int64, float, float, float, np.int64)
    arrays: dict[str, Any] = {name: np.array(*one) for name, *one in zip(names, columns, types, strict=True)}
    return drawing.Stretches(**arrays, points=points, first=first)


def replace_pieces(session: Session, level: int, before: Drawn, after: Drawn) -> None:
    """Write what differs."""
    gone = [(tile, k) for tile in before for k, p in before[tile].items() if after[tile].get(k) != p]
    new = [(tile, p) for tile in after for k, p in after[tile].items() if before[tile].get(k) != p]
    if gone:
        tile, ids = (np.array(column, np.int64) for column in zip(*gone, strict=True))
        send_binary(session, _DELETE, {"level": level, "cell": tile, "id": ids})
    if new:
        columns = dict(
            zip(drawing.Piece._fields, map(list, zip(*(p for _, p in new), strict=True)), strict=True)
        )
        for name in ("slope_percent", "slope_sigma_percent"):
            columns[name] = np.ma.masked_invalid(np.array(columns[name], float))  # type: ignore[assignment]
        send_binary(session, _INSERT, {"level": level, "cell": [tile for tile, _ in new], **columns})


def changed_tiles(level: int, before: Drawn, after: Drawn) -> set[int]:
    """The tiles of the level in which what is drawn differs, those that pieces reach into from others included."""
    differing = [
        pieces[k]
        for these, those in ((before, after), (after, before))
        for tile, pieces in these.items()
        for k in pieces
        if those[tile].get(k) != pieces[k]
    ]
    own = {tile for tile in after if before[tile] != after[tile]}
    if not differing:
        return own
    zoom = drawing.LEVELS[level].tile_zoom
    side = 2 * HALF_WORLD / 2**zoom
    lines = shapely.from_wkb(np.array([p.geom_3857 for p in differing], object))
    along = shapely.get_coordinates(shapely.segmentize(lines, side / 8))
    at = np.column_stack([along[:, 0] + HALF_WORLD, HALF_WORLD - along[:, 1]]) / side
    near = np.concatenate(
        [at + np.array([dx, dy]) for dx in (-_BEYOND, _BEYOND) for dy in (-_BEYOND, _BEYOND)]
    )
    met = np.unique(np.clip(np.floor(near), 0, 2**zoom - 1).astype(np.int64), axis=0)
    return own | {x << zoom | y for x, y in met.tolist()}


def raise_drawn(session: Session, exact: Collection[int], any_of: Mapping[int, Collection[int]]) -> bool:
    """Say of these cells, and of one in each of these tiles by level, that low zooms draw them anew.

    The last of a transaction, since solvers want the same rows. False: others have them, and nothing was said.
    """
    cells = sorted(exact)
    session.execute(_MAKE, {"ids": cells})
    taken = set(session.execute(_TAKE, {"ids": cells}).scalars())
    if len(taken) < len(cells):
        return False
    for level, tiles in any_of.items():
        for tile in sorted(tiles):
            if not any(drawing.tile_of(cell, level) == tile for cell in taken):
                taken.add(_free_cell(session, level, tile))
    session.execute(_RAISE, {"ids": sorted(taken)})
    return True


def _free_cell(session: Session, level: int, tile: int) -> int:
    zoom = drawing.LEVELS[level].tile_zoom
    by = ZOOM - zoom
    x, y = tile >> zoom, tile & ((1 << zoom) - 1)
    left, top, last = x << by, y << by, (1 << by) - 1
    right, bottom = left + last, top + last
    values = {"first": left << ZOOM | top, "last": right << ZOOM | bottom, "top": top, "bottom": bottom}
    cell = session.execute(_FREE_CELL, values).scalar()
    if cell is None:
        cell = left << ZOOM | top
        session.execute(_MAKE, {"ids": [cell]})
    return int(cell)


@dataclass
class Redrawn:
    """Of each level the pieces of some tiles, as they are and as they ought to be."""

    before: dict[int, Drawn] = field(default_factory=dict)
    after: dict[int, Drawn] = field(default_factory=dict)

    def add(self, session: Session, level: int, tile: int, pieces: Collection[drawing.Piece]) -> None:
        """What a tile ought to have."""
        self.before.setdefault(level, {}).update(drawn(session, level, [tile]))
        self.after.setdefault(level, {})[tile] = {piece.segment_id: piece for piece in pieces}

    def changed(self, level: int) -> set[int]:
        """The tiles of which that differs."""
        before, after = self.before.get(level, {}), self.after.get(level, {})
        return {tile for tile in after if after[tile] != before[tile]}


def draw_block(session: Session, block: int, tiles: Collection[int]) -> Redrawn:
    """A tile of the level ``BLOCK``, and those of ``FINEST`` inside it that are named."""
    cells = drawing.children(drawing.BLOCK, block)
    stretches, ends = segments_in(session, cells, tiles)
    redrawn = Redrawn()
    for tile in tiles:
        rows = np.flatnonzero(ends.cell == tile)
        one = stretches.subset(rows)
        redrawn.add(session, drawing.FINEST, tile, all_roads(one, Ends(*(column[rows] for column in ends))))
    level = drawing.LEVELS[drawing.BLOCK]
    # Of tiles that are drawn as a whole, all is there; of the others what the level shows.
    if not any(level.chosen(highway) for highway in set(stretches.highway.tolist())):
        classes = most_important_in(session, cells)
        stretches, _ = segments_in(session, cells, (), classes)
    redrawn.add(session, drawing.BLOCK, block, greater_roads(level, stretches))
    return redrawn


def draw_above(session: Session, level: int, tile: int) -> Redrawn:
    """A tile of a level that is made of the pieces of the level below."""
    below = drawn(session, drawing.BELOW[level], drawing.children(level, tile))
    stretches = stretches_of(piece for pieces in below.values() for piece in pieces.values())
    redrawn = Redrawn()
    redrawn.add(session, level, tile, greater_roads(drawing.LEVELS[level], stretches))
    return redrawn


def all_roads(stretches: drawing.Stretches, ends: Ends) -> list[drawing.Piece]:
    """The pieces of the finest level: all roads of a tile, each way for itself, in its direction."""
    key = _numbers(ends.osm_way_id, stretches.oneway, _kinds(stretches))
    n = len(stretches)
    nodes = np.concatenate([ends.from_node, ends.to_node])
    place = places(np.tile(key, 2), nodes, stretches.end_points)
    chains = chains_of(key, stretches.ids, place[:n], place[n:])
    rows, first = chains.rows.tolist(), chains.first.tolist()
    lines = [Course(rows[a:b], [False] * (b - a)) for a, b in pairwise(first)]
    return drawing.pieces_of(drawing.LEVELS[drawing.FINEST], lines, stretches)


def greater_roads(level: drawing.Level, stretches: drawing.Stretches) -> list[drawing.Piece]:
    """The pieces of another level: its classes, or the most important that there is, and what of others was driven."""
    chosen = _chosen(level, stretches)
    driven = np.flatnonzero(~chosen & stretches.measured)
    start, end = _ends(stretches)
    far = together_m(start[driven], end[driven], stretches.length_m[driven]) >= level.driven_m
    chosen_rows = np.sort(np.concatenate([np.flatnonzero(chosen), driven[far]]))
    roads = stretches.subset(chosen_rows).one_way_forward()
    start, end = _ends(roads)
    return drawing.pieces_of(level, courses(roads.ids, start, end, _kinds(roads), roads.oneway > 0), roads)


def _chosen(level: drawing.Level, stretches: drawing.Stretches) -> Bools:
    of_class = {highway: level.chosen(highway) for highway in set(stretches.highway.tolist())}
    if of_class and not any(of_class.values()):
        importance = {highway: (drawing.is_link(highway), drawing.rank(highway)) for highway in of_class}
        best = min(importance.values())
        of_class = {highway: one == best for highway, one in importance.items()}
    return np.array([of_class[highway] for highway in stretches.highway.tolist()], bool)


def _kinds(stretches: drawing.Stretches) -> Ints:
    return np.asarray(np.unique(stretches.highway, return_inverse=True)[1], np.int64)


def _numbers(*columns: Ints) -> Ints:
    """A number for each combination that there is."""
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _ends(stretches: drawing.Stretches) -> tuple[Ints, Ints]:
    """Numbers of the places where stretches begin and end; those that meet share coordinates to the last digit."""
    n, ends = len(stretches), stretches.end_points
    place = np.unique(ends[:, 0] + 1j * ends[:, 1], return_inverse=True)[1].astype(np.int64)
    return place[:n], place[n:]
