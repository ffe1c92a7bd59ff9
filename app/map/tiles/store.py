"""Vector tiles: what low zooms and ways are made of, and where all are kept. Single segments: ``road_store``.

Psycopg's own placeholders: the statements are prepared, and most are executed by the event loop. Only what a map draws
is in a tile: each further property costs a tenth of the whole query.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from psycopg.pq.abc import PGconn, PGresult
from sqlalchemy.orm import Session

from app.core.db import Bounds, fetch_binary, send_binary
from app.map.store import FULL_ZOOM
from app.map.tiles.connections import Connection
from app.map.tiles.encoding import BUFFER, EXTENT, SHORT
from app.map.tiles.road_store import KnownRoads, Place, state_question, tile_now, tile_of

SEGMENTS, WAYS = "segments", "ways"
"""The layers. A tile has one."""
NO_LIMIT = 2_000_000_000
DEEPEST_KEPT = 30
"""No zoom is below."""
EDGE_DEG = 85.0511287798066
"""Latitude at which the plane of tiles ends."""
LOCK_SPACE = 1413
"""The first half of the numbers of the locks of tiles that are being built."""

_BOX = f"""
    box AS (
        SELECT ST_TileEnvelope(%(z)s, %(x)s, %(y)s) AS tile,
               ST_TileEnvelope(%(z)s, %(x)s, %(y)s, margin => CAST({BUFFER / EXTENT} AS float8)) AS wide
    )"""
_AS_GEOM = f"ST_AsMVTGeom({{line}}, box.tile, {EXTENT}, {BUFFER}, true)"
_GEOM = f"{_AS_GEOM} AS geom"
_AS_MVT = f"ST_AsMVT(feature, '{{layer}}', {EXTENT}, 'geom', 'id')"

# The box for the index is wider than the tile by the buffer, else lines just outside it would end at its edge.
_PIECE_FEATURES = f"""
    SELECT p.segment_id AS id, p.slope_percent, p.slope_sigma_percent, p.drives, p.highway, p.oneway,
           {_GEOM.format(line="p.geom_3857")}
    FROM box JOIN drawn_pieces AS p ON p.level = {{level}} AND p.geom_3857 && box.wide"""  # noqa: S608 - constants
_PIECES_BY_IMPORTANCE = " ORDER BY p.rank, (p.drives = 0), p.length_m DESC, p.segment_id LIMIT %(most)s"
_WAY_FEATURES = f"""
    SELECT w.id, w.slope_percent, w.slope_sigma_percent, w.drives, w.highway, w.oneway, w.steepest_percent,
           {_GEOM.format(line="w.geom_3857")}
    FROM box JOIN ways AS w ON w.geom_3857 && box.wide"""  # noqa: S608 - constants
_WAYS_BY_IMPORTANCE = " ORDER BY (w.drives = 0), w.length_m DESC, w.id LIMIT %(most)s"
_ONCE = "OFFSET 0"
"""Else each geometry would be computed twice, once to be looked at: a fifth of the whole."""
_TILE = f"""
    SELECT {_AS_MVT} FROM (SELECT * FROM ({{features}} {_ONCE}) AS every WHERE geom IS NOT NULL{{order}}) AS feature
"""  # noqa: S608 - constants
_COUNTED = f"""
    SELECT {_AS_MVT}, count(*) FROM (SELECT * FROM ({{features}} {_ONCE}) AS every WHERE geom IS NOT NULL) AS feature
"""  # noqa: S608 - constants

# Where every road is shorter than the grid is fine, the most important ones are a unit long each.
_SPECKS = f"""
    WITH {_BOX}, specks AS (
        SELECT p.*, ST_StartPoint(p.geom_3857) AS at, (ST_XMax(box.tile) - ST_XMin(box.tile)) / {EXTENT} AS unit_m
        FROM box JOIN drawn_pieces AS p ON p.level = {{level}} AND p.geom_3857 && box.tile
        ORDER BY p.rank, (p.drives = 0), p.length_m DESC, p.segment_id LIMIT 100
    ), feature AS (
        SELECT p.segment_id AS id, p.slope_percent, p.slope_sigma_percent, p.drives, p.highway, p.oneway,
               ST_AsMVTGeom(ST_MakeLine(p.at, ST_Translate(p.at, {SHORT} * p.unit_m, 0)), box.tile, {EXTENT}, {BUFFER},
                            true) AS geom
        FROM box, specks AS p
    )
    SELECT {_AS_MVT.format(layer=SEGMENTS)} FROM feature WHERE geom IS NOT NULL
"""  # noqa: S608 - constants

_KEPT = """
    SELECT body FROM stored_tiles WHERE layer = %(layer)s AND z = %(z)s AND x = %(x)s AND y = %(y)s AND tag = %(tag)s
"""
# One way to the server: what is kept, or the tile made now, which is not begun where it is kept.
_KEPT_OR_MADE = f"""
    WITH {_BOX}, kept AS ({_KEPT})
    SELECT (SELECT body FROM kept), CASE WHEN NOT EXISTS (SELECT FROM kept) THEN ({{tile}}) END
"""  # noqa: S608 - constants
_KEPT_OR_STATE = f"SELECT ({_KEPT}), ({{state}})"
_MADE_AGAIN = f"WITH {_BOX} {{tile}}"
_LOCK = "SELECT pg_advisory_xact_lock(%s + CASE current_schema() WHEN 'edition' THEN 1 ELSE 0 END, %s)"
_KEEP = """
    INSERT INTO stored_tiles AS t (layer, z, x, y, tag, size_bytes, body)
    VALUES (%(layer)s, %(z)s, %(x)s, %(y)s, %(tag)s, %(size_bytes)s, %(body)b)
    ON CONFLICT (layer, z, x, y) DO UPDATE SET tag = excluded.tag, size_bytes = excluded.size_bytes,
        body = excluded.body, asked_at = excluded.asked_at
"""
_ASKED = """
    UPDATE stored_tiles AS t SET asked = t.asked + told.asked, asked_at = now()
    FROM unnest(CAST(%s AS text[]), CAST(%s AS integer[]), CAST(%s AS integer[]), CAST(%s AS integer[]),
        CAST(%s AS bigint[])) AS told (layer, z, x, y, asked)
    WHERE (t.layer, t.z, t.x, t.y) = (told.layer, told.z, told.x, told.y)
"""
# One process at a time; what nobody has asked for longest goes, until a tenth of the room is free.
_CLEAN = f"""
    WITH mine AS (SELECT pg_try_advisory_xact_lock({LOCK_SPACE}) AS turn),
    size AS (SELECT sum(size_bytes) AS bytes FROM mine, stored_tiles WHERE mine.turn),
    ranked AS (
        SELECT t.layer, t.z, t.x, t.y, sum(t.size_bytes) OVER (ORDER BY t.asked_at DESC, t.layer, t.z, t.x, t.y) AS upto
        FROM size, stored_tiles AS t WHERE size.bytes > %(most)s
    )
    DELETE FROM stored_tiles AS t USING ranked AS r
    WHERE r.upto > %(most)s * 0.9 AND (t.layer, t.z, t.x, t.y) = (r.layer, r.z, r.x, r.y)
"""  # noqa: S608 - a constant

# What somebody else is writing just now is of now.
_DROP = """
    DELETE FROM stored_tiles AS t USING (
        SELECT t.layer, t.z, t.x, t.y FROM stored_tiles AS t
        JOIN unnest(%(z)s::integer[], %(x0)s::integer[], %(x1)s::integer[], %(y0)s::integer[], %(y1)s::integer[])
            AS b (z, x0, x1, y0, y1) ON t.z = b.z AND t.x BETWEEN b.x0 AND b.x1 AND t.y BETWEEN b.y0 AND b.y1
        WHERE t.layer = ANY(%(layers)s::text[]) FOR UPDATE OF t SKIP LOCKED) AS old
    WHERE (t.layer, t.z, t.x, t.y) = (old.layer, old.z, old.x, old.y)
"""

# Who wrote the row is part of the epoch: what a dump brings back was written by another transaction.
_EPOCH = "(SELECT epoch || CAST(xmin AS text) FROM tile_epoch)"
_CELL = "c.id, c.version, c.drawn_version, CAST(extract(epoch FROM c.changed_at) * 1000000 AS bigint)"
# A standby's snapshot does not list what runs: of what began since its lowest number anything may still come.
_NOW = """
    CASE WHEN pg_is_in_recovery()
         THEN (SELECT concat(x, ':', x, ':') FROM pg_snapshot_xmin(pg_current_snapshot()) AS x)
         ELSE CAST(pg_current_snapshot() AS text) END
"""
_REPLAYED = "coalesce(CAST(pg_last_wal_replay_lsn() AS text), '')"
# Exact in whatever order transactions end: what the former look has not seen has a number that its snapshot does not
# hold. Numbers that this server has not given out yet come from another one; all was read when that was noticed.
_LOOK = f"""
    SELECT {_EPOCH}, {_NOW}, {_REPLAYED},
           (SELECT array_agg(ARRAY[{_CELL}]) FROM cells AS c
            WHERE c.changed_xid >= {{lowest}}
                AND NOT pg_visible_in_snapshot(CAST(CAST(c.changed_xid AS text) AS xid8), {{seen}})
                AND c.changed_xid < CAST(CAST(pg_snapshot_xmax(pg_current_snapshot()) AS text) AS bigint))
"""  # noqa: S608 - constants
_PREPARED = b"versant_look"
_PREPARE = f"PREPARE {_PREPARED.decode()} (bigint, pg_snapshot) AS {_LOOK.format(lowest='$1', seen='$2')}"
_ALL = f"""
    SELECT {_EPOCH}, {_NOW}, {_REPLAYED}, {_CELL} FROM (SELECT 1) AS always LEFT JOIN cells AS c ON true
"""  # noqa: S608 - constants


_HAS_REPLAYED = "SELECT pg_last_wal_replay_lsn() >= CAST(%s AS pg_lsn)"

_NUMBER = re.compile(rb"-?\d+")
_SNAPSHOT = re.compile(r"\d+:\d+:[\d,]*")


CellVersion = tuple[int, int, int, int]
"""Number, version, version of what is drawn from afar, time of the last change (microseconds)."""


class Address(NamedTuple):
    """Of a tile: a layer, and where. 0 <= x, y < 2**z is for whoever makes one to check."""

    layer: str
    z: int
    x: int
    y: int


class Look(NamedTuple):
    """What is new since a former look: in which epoch, the snapshot, how far a standby was, and cells as they are."""

    epoch: str
    snapshot: str
    replayed: str
    cells: list[CellVersion]


def send_look(server: PGconn, seen: str) -> None:
    """Ask what changed since the snapshot ``seen`` on a connection with ``prepare_looks``: one look into an index."""
    server.send_query_prepared(_PREPARED, [seen.partition(":")[0].encode(), seen.encode()])


def send_whole_look(begin: bytes, server: PGconn, seen: str) -> None:
    """The same on any connection, as one transaction that begins with a statement: read and planned each time."""
    if not _SNAPSHOT.fullmatch(seen):
        raise ValueError(f"{seen!r} is no snapshot")
    look = _LOOK.format(lowest=seen.partition(":")[0], seen=f"CAST('{seen}' AS pg_snapshot)")
    server.send_query(begin + b"; " + look.encode())


def look_answer(result: PGresult) -> Look:
    """What a look found."""
    *when, cells = (result.get_value(0, k) or b"" for k in range(4))
    epoch, snapshot, replayed = (value.decode() for value in when)
    if not cells:
        return Look(epoch, snapshot, replayed, [])
    numbers = [int(number) for number in _NUMBER.findall(cells)]
    return Look(epoch, snapshot, replayed, list(zip(*(numbers[k::4] for k in range(4)), strict=True)))


async def prepare_looks(connection: Connection) -> None:
    """Once for each connection that is not a pooler's: it is good for looks (``send_look``) from here on."""
    await connection.execute(_PREPARE)


async def look_at_all(connection: Connection) -> Look:
    """All cells."""
    cursor = await connection.execute(_ALL)
    rows: list[Any] = await cursor.fetchall()
    epoch, snapshot, replayed = rows[0][:3]
    return Look(epoch, snapshot, replayed, [row[3:] for row in rows if row[3] is not None])


async def lock_tile(connection: Connection, at: Address) -> None:
    """Within a transaction: whoever builds the same tile, in whatever process, does so before or after."""
    number = hash(at[1:]) & 0x3FFFFFFF | (at.layer == WAYS) << 30
    await connection.execute(_LOCK, (LOCK_SPACE, number))


async def kept_or_made(
    connection: Connection, at: Address, tag: str, full_zoom: int, known: KnownRoads
) -> tuple[bytes | None, bytes]:
    """The kept tile, compressed, that was built for this tag; else None, and the tile as it is now, not compressed.

    ``known``: the roads that this process knows, among which those of the tile are from here on.
    """
    if not _is_of_segments(at, full_zoom):
        row = await _row(connection, _KEPT_OR_MADE.format(tile=_tile(at)), at, tag=tag, most=NO_LIMIT)
        return row[0], row[1] or b""
    place = Place(*at[1:])
    state, values = state_question(place)
    kept, present = await _row(connection, _KEPT_OR_STATE.format(state=state), at, tag=tag, **values)
    return kept, b"" if kept is not None else await tile_of(connection, at.layer, place, present, known)


async def has_replayed(connection: Connection, lsn: str) -> bool:
    """Whether a standby shows all that one had replayed by then."""
    cursor = await connection.execute(_HAS_REPLAYED, (lsn,))
    return bool((await cursor.fetchall())[0][0])


async def made(connection: Connection, at: Address, full_zoom: int, known: KnownRoads) -> bytes:
    """The tile as it is now, not compressed, without a look at what is kept; ``known`` as in ``kept_or_made``."""
    if not _is_of_segments(at, full_zoom):
        return (await _row(connection, _MADE_AGAIN.format(tile=_tile(at)), at, most=NO_LIMIT))[0] or b""
    state, values = state_question(Place(*at[1:]))
    (present,) = await _row(connection, f"SELECT ({state})", at, **values)
    return await tile_of(connection, at.layer, Place(*at[1:]), present, known)


async def most_important(connection: Connection, at: Address, most: int | None) -> tuple[bytes, int]:
    """A tile of the most important roads at most (None: of all), and how many there are in it."""
    features = _features(at)
    if most is not None:
        features += _WAYS_BY_IMPORTANCE if at.layer == WAYS else _PIECES_BY_IMPORTANCE
    statement = _MADE_AGAIN.format(tile=_COUNTED.format(layer=at.layer, features=features))
    row = await _row(connection, statement, at, most=most)
    return row[0] or b"", row[1]


async def specks(connection: Connection, at: Address) -> bytes:
    """The tile of a low zoom in which no road is long enough to be seen; empty where there are none."""
    row = await _row(connection, _SPECKS.format(level=drawn_level(at.z)), at)
    return row[0] or b""


async def _row(connection: Connection, statement: str, at: Address, **values: Any) -> Any:
    cursor = connection.cursor(binary=True)
    await cursor.execute(statement, {**at._asdict(), **values})
    return await cursor.fetchone()


async def keep(connection: Connection, at: Address, tag: str, body: bytes) -> None:
    """Keep a compressed tile in place of a former one."""
    await connection.execute(_KEEP, {**at._asdict(), "tag": tag, "size_bytes": len(body), "body": body})


async def note_asked(connection: Connection, asked: dict[Address, int]) -> None:
    """Add to how often kept tiles were asked for."""
    columns = [list(column) for column in zip(*(sorted((*at, n) for at, n in asked.items())), strict=True)]
    await connection.execute(_ASKED, columns)


async def clean(connection: Connection, most_bytes: int) -> int:
    """Take tiles away where they need more room than this; how many went."""
    cursor = await connection.execute(_CLEAN, {"most": most_bytes})
    return cursor.rowcount


def mvt(
    session: Session, z: int, x: int, y: int, *, full_zoom: int = FULL_ZOOM, layer: str = SEGMENTS
) -> bytes:
    """The Mapbox vector tile as the database makes it now, not compressed; empty without any road.

    0 <= x, y < 2**z is the caller's to check. Properties: ``slope_percent``, ``slope_sigma_percent`` (both
    absent where unknown), ``drives``, ``highway``, ``oneway``, and of segments ``bridge`` and ``tunnel`` where they are
    such, ``dem_slope_percent``; a segment's id is its feature's id. From ``full_zoom`` on its features are the
    segments, below what is drawn from afar (``drawn_pieces``). Extent 4096, buffer 64.
    """
    if _is_of_segments(at := Address(layer, z, x, y), full_zoom):
        return tile_now(session, layer, Place(z, x, y))
    values = {**at._asdict(), "most": NO_LIMIT}
    # In an order, so that equal data make equal bytes.
    tile = _tile(at, order=" ORDER BY id")
    ((tile_bytes,),) = fetch_binary(session, _MADE_AGAIN.format(tile=tile), values)
    if not tile_bytes and layer == SEGMENTS:
        ((tile_bytes,),) = fetch_binary(session, _SPECKS.format(level=drawn_level(z)), values)
    return bytes(tile_bytes or b"")


def drop_tiles(session: Session, boxes: Sequence[Bounds]) -> None:
    """Keep no tile any more that meets one of these boxes, degrees: whoever asks for it has it built anew."""
    ranges = [
        (z, *sorted((column_of(z, west), column_of(z, east))), *sorted((row_of(z, north), row_of(z, south))))
        for west, south, east, north in boxes
        for z in range(DEEPEST_KEPT + 1)
    ]
    named = zip(("z", "x0", "x1", "y0", "y1"), map(list, zip(*ranges, strict=True)), strict=True)
    send_binary(session, _DROP, {**dict(named), "layers": [SEGMENTS, WAYS]})


def column_of(z: int, lon_deg: float) -> int:
    """The column of a zoom that a longitude lies in."""
    return min(max(int((lon_deg + 180) / 360 * (1 << z)), 0), (1 << z) - 1)


def row_of(z: int, lat_deg: float) -> int:
    """The row of a zoom that a latitude lies in; the first or last one beyond the map's edge."""
    bounded = math.radians(min(max(lat_deg, -EDGE_DEG), EDGE_DEG))
    return min(max(int((1 - math.asinh(math.tan(bounded)) / math.pi) / 2 * (1 << z)), 0), (1 << z) - 1)


def drawn_level(z: int) -> int:
    """The level of pieces that a low zoom shows: each is for its own zoom and the one below."""
    return min(12, max(6, z + z % 2))


def _is_of_segments(at: Address, full_zoom: int) -> bool:
    """Whether its features are the segments, rather than ways or what is drawn from afar."""
    return at.layer == SEGMENTS and at.z >= full_zoom


def _tile(at: Address, order: str = "") -> str:
    return _TILE.format(layer=at.layer, features=_features(at), order=order)


def _features(at: Address) -> str:
    """The features of a tile of ways or of a low zoom."""
    return _WAY_FEATURES if at.layer == WAYS else _PIECE_FEATURES.format(level=drawn_level(at.z))
