"""Segments that are changed behind the service's back, and what is derived from them."""

from __future__ import annotations

import math
from typing import Any

from sqlalchemy import text

from app.core.db import Sessions
from app.map.derived import following
from app.network.cells import TILE_MARGIN

WEST_DEG, SOUTH_DEG, STEP_DEG = 8.49, 48.995, 0.004
"""Nodes lie on a grid of so many degrees; five steps are a cell of zoom 14."""

_ADD = text(
    """
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge, tunnel,
                          layer, road_version_id)
    SELECT :way, :a, :b, line, ST_Transform(line, 3857), ST_Length(CAST(line AS geography)), :highway, :oneway, false,
           false, 0, (SELECT max(id) FROM road_versions)
    FROM (SELECT ST_SetSRID(ST_MakeLine(ST_MakePoint(:x0, :y0), ST_MakePoint(:x1, :y1)), 4326) AS line) AS one
    ON CONFLICT DO NOTHING
    """
)
_MEASURE = text(
    """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations)
    SELECT id, :slope, 0.5, :drives, 5 FROM segments WHERE id = :id
    ON CONFLICT (segment_id) DO UPDATE SET slope_percent = excluded.slope_percent, drives = excluded.drives
    """
)
_WAYS = text("SELECT * FROM ways ORDER BY id")
_PIECES = text("SELECT * FROM drawn_pieces ORDER BY level, cell, segment_id")
_FORGET = (
    text("TRUNCATE ways, drawn_pieces, derived_segments, cells_to_draw"),
    text("UPDATE derived_upto SET xid = 0, segment_id = 0"),
)
_TILES = text(
    """
    SELECT level, z, x, y, md5(string_agg(CAST(p AS text), ',' ORDER BY cell, segment_id))
    FROM (SELECT p.*, ST_Expand(geom_3857, 2 * 20037508.342789244 / 2 ^ (level - k) / 64) AS near, level - k AS z
          FROM drawn_pieces AS p, generate_series(0, 1) AS k) AS p,
        LATERAL (SELECT 2 * 20037508.342789244 / 2 ^ z AS side) AS s,
        generate_series(CAST(floor((ST_XMin(near) + 20037508.342789244) / side) AS integer),
                        CAST(floor((ST_XMax(near) + 20037508.342789244) / side) AS integer)) AS x,
        generate_series(CAST(floor((20037508.342789244 - ST_YMax(near)) / side) AS integer),
                        CAST(floor((20037508.342789244 - ST_YMin(near)) / side) AS integer)) AS y
    WHERE geom_3857 && ST_Expand(ST_TileEnvelope(z, x, y), side / 64)
    GROUP BY level, z, x, y
    """
)
_VERSIONS = text("SELECT id, drawn_version FROM cells")

Tile = tuple[int, int, int]
Rows = list[tuple[Any, ...]]


def execute(sessions: Sessions, statement: str, **values: Any) -> None:
    """A transaction of its own."""
    with sessions.begin() as session:
        session.execute(text(statement), values)


def add_segment(
    sessions: Sessions, way: int, a: int, b: int, highway: str = "residential", oneway: int = 0
) -> None:
    """From node to node of a grid 16 wide; nothing where it is already."""
    x0, x1 = (WEST_DEG + STEP_DEG * (node % 16) for node in (a, b))
    y0, y1 = (SOUTH_DEG + STEP_DEG * (node // 16) for node in (a, b))
    values = {
        "way": way,
        "a": a,
        "b": b,
        "highway": highway,
        "oneway": oneway,
        "x0": x0,
        "y0": y0,
        "x1": x1,
        "y1": y1,
    }
    with sessions.begin() as session:
        session.execute(_ADD, values)


def measure(sessions: Sessions, segment_id: int, slope: float, drives: int = 1) -> None:
    """Let drives have measured it, or a gap have a slope (no drives)."""
    with sessions.begin() as session:
        session.execute(_MEASURE, {"id": segment_id, "slope": slope, "drives": drives})


def ids_of(sessions: Sessions) -> list[int]:
    """All segments, ascending."""
    with sessions() as session:
        return list(session.execute(text("SELECT id FROM segments ORDER BY id")).scalars())


def derived(sessions: Sessions) -> tuple[Rows, Rows]:
    """All ways, all pieces."""
    with sessions() as session:
        return [tuple(row) for row in session.execute(_WAYS)], [
            tuple(row) for row in session.execute(_PIECES)
        ]


def from_scratch(sessions: Sessions) -> tuple[Rows, Rows]:
    """The same, of all that is there now and nothing that was."""
    with sessions.begin() as session:
        for statement in _FORGET:
            session.execute(statement)
    following.follow_all(sessions)
    return derived(sessions)


def tiles_of(sessions: Sessions) -> dict[Tile, str]:
    """What each tile of the low zooms draws, by z, x, y."""
    with sessions() as session:
        return {(z, x, y): content for _, z, x, y, content in session.execute(_TILES)}


def versions_of_tiles(sessions: Sessions, tiles: set[Tile]) -> dict[Tile, int]:
    """The sum that tells whether low zooms draw a tile anew: over the cells below it and just beside it."""
    with sessions() as session:
        cells = {(row.id >> 14, row.id & 16383): row.drawn_version for row in session.execute(_VERSIONS)}
    found = {}
    for z, x, y in tiles:
        scale = 2 ** (14 - z)
        (x0, x1), (y0, y1) = (
            (math.floor((k - TILE_MARGIN) * scale), math.floor((k + 1 + TILE_MARGIN) * scale)) for k in (x, y)
        )
        found[z, x, y] = sum(v for (cx, cy), v in cells.items() if x0 <= cx <= x1 and y0 <= cy <= y1)
    return found
