"""What pieces are made of out of the database, and pieces into it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import shapely
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from app.map.derived.levels import CHOSEN, HALF_WORLD, LEVELS, rank, tile_of
from app.map.derived.pieces import Piece, Stretches
from app.map.derived.way_store import lines
from app.network import ZOOM
from app.network.cells import TILE_MARGIN
from fusion.types import Floats, Ints

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
_CLASSES = text(
    """
    SELECT DISTINCT s.highway FROM segments AS s
    JOIN derived_segments AS d ON d.segment_id = s.id AND d.cell = s.cell
    WHERE s.cell = ANY(CAST(:cells AS integer[]))
    """
)
_COLUMNS = ", ".join(Piece._fields)
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
_FREE_CELL = text(
    """
    SELECT id FROM cells WHERE id BETWEEN :first AND :last AND (id & 16383) BETWEEN :top AND :bottom
    ORDER BY id LIMIT 1 FOR UPDATE SKIP LOCKED
    """
)
_MAKE = text(
    "INSERT INTO cells (id) SELECT unnest(CAST(:ids AS integer[])) ORDER BY 1 ON CONFLICT (id) DO NOTHING"
)
_TAKE = text(
    "SELECT id FROM cells WHERE id = ANY(CAST(:ids AS integer[])) ORDER BY id FOR UPDATE SKIP LOCKED"
)
_RAISE = text("UPDATE cells SET drawn_version = drawn_version + 1 WHERE id = ANY(CAST(:ids AS integer[]))")

_BEYOND = 8 * TILE_MARGIN / 2
"""Of the side of a level's tile: how far a vector tile, at most eight of them wide, draws beyond its edge."""

Drawn = dict[int, dict[int, Piece]]
"""Pieces by tile and segment."""


class Ends(NamedTuple):
    """Beside stretches that are segments: the way of each, its nodes, and its cell; shape (n,)."""

    osm_way_id: Ints
    from_node: Ints
    to_node: Ints
    cell: Ints


def segments_in(
    session: Session, cells: Collection[int], all_of: Collection[int], classes: Collection[str] = CHOSEN
) -> tuple[Stretches, Ends]:
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
    lowest = min(map(rank, classes), default=0)
    return [highway for highway in classes if rank(highway) == lowest]


def drawn(session: Session, level: int, tiles: Collection[int]) -> Drawn:
    """The pieces that are there."""
    pieces: Drawn = {tile: {} for tile in tiles}
    for tile, *row in fetch_binary(
        session, _PIECES, {"level": level, "tiles": np.array(sorted(tiles), np.int64)}
    ):
        piece = Piece(*row)
        pieces[tile][piece.segment_id] = piece
    return pieces


def stretches_of(pieces: Iterable[Piece]) -> Stretches:
    """Pieces as what those of the level above are made of, by ascending id."""
    ordered = sorted(pieces)
    columns = list(zip(*(p[:1] + p[2:4] + (p.length_m, *p[4:7]) for p in ordered), strict=True)) or [()] * 7
    geometry = shapely.from_wkb(np.array([p.geom_3857 for p in ordered], object))
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(geometry))]).astype(np.int64)
    return _stretches(columns, shapely.get_coordinates(geometry), first)


def _stretches(columns: Any, points: Floats, first: Ints) -> Stretches:
    ids, highway, oneway, length_m, slope, sigma, drives = columns
    return Stretches(
        ids=np.array(ids, np.int64),
        highway=np.array(highway, object),
        oneway=np.array(oneway, np.int64),
        length_m=np.array(length_m, float),
        slope_percent=np.array(slope, float),
        sigma_percent=np.array(sigma, float),
        drives=np.array(drives, np.int64),
        points=points,
        first=first,
    )


def replace_pieces(session: Session, level: int, before: Drawn, after: Drawn) -> None:
    """Write what differs."""
    gone = [(tile, k) for tile in before for k, p in before[tile].items() if after[tile].get(k) != p]
    new = [(tile, p) for tile in after for k, p in after[tile].items() if before[tile].get(k) != p]
    if gone:
        tile, ids = (np.array(column, np.int64) for column in zip(*gone, strict=True))
        send_binary(session, _DELETE, {"level": level, "cell": tile, "id": ids})
    if new:
        columns = dict(zip(Piece._fields, map(list, zip(*(p for _, p in new), strict=True)), strict=True))
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
    zoom = LEVELS[level].tile_zoom
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
            if not any(tile_of(cell, level) == tile for cell in taken):
                taken.add(_free_cell(session, level, tile))
    session.execute(_RAISE, {"ids": sorted(taken)})
    return True


def _free_cell(session: Session, level: int, tile: int) -> int:
    zoom = LEVELS[level].tile_zoom
    by = ZOOM - zoom
    x, y = tile >> zoom, tile & ((1 << zoom) - 1)
    left, top, last = x << by, y << by, (1 << by) - 1
    values = {
        "first": left << ZOOM | top,
        "last": left + last << ZOOM | top + last,
        "top": top,
        "bottom": top + last,
    }
    cell = session.execute(_FREE_CELL, values).scalar()
    if cell is None:
        cell = left << ZOOM | top
        session.execute(_MAKE, {"ids": [cell]})
    return int(cell)
