"""Answers to requests for vector tiles, past the framework and all that it wraps around a route.

What a route costs before its first line (its middlewares, a task, a thread, the checks of its parameters) is several
times what a warm tile or a 304 does: a warm tile is one indexed look of some thirty microseconds, and
``benchmarks/serving.py`` measures it. So ``TileFront`` answers what is the address of a tile beyond doubt. Everything
else goes on to the routes, which end in ``answer`` as well: what cannot be an address, with the reasons, and what is
seldom asked for. What has to hold for every request lies before both: its number, its line in the log, its count,
HEAD, known hosts.

The path of a tile: ``TileFront`` reads the address; ``Watch`` (``watch``) looks once for what changed, which gives the
ETag; ``Tiles`` (``tiles``) has the tile in memory or fetches it from ``store``; the answer is written here.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import psycopg
from fastapi import Request
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from app.core.caller import present_caller
from app.core.disconnects import CLIENT_GONE
from app.core.errors import NotFoundError, ServiceError
from app.core.http import REVALIDATE, is_named
from app.core.messages import say
from app.core.problems import database_error, service_error
from app.core.settings import Settings
from app.map.tiles.servers import MapTiles
from app.map.tiles.store import SEGMENTS, WAYS, Address
from app.map.tiles.tiles import Tile, Tiles, plain

MVT = "application/vnd.mapbox-vector-tile"
QUAD = "WebMercatorQuad"
SUFFIXES = ("mvt", "pbf")
LAYERS = (SEGMENTS, WAYS)
DEEPEST_ZOOM = 30

_OF_SEGMENTS = "/tiles/{z}/{x}/{y}."
_OF_ALL = f"/tiles/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}"
_OF_COLLECTION = f"/collections/{{collection}}/tiles/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}"

_NUMBER = r"(0|[1-9]\d{0,9})"
_PATH = re.compile(
    rf"/tiles/{_NUMBER}/{_NUMBER}/{_NUMBER}\.(mvt|pbf)"
    rf"|(?:/collections/({'|'.join(LAYERS)}))?/tiles/{QUAD}/{_NUMBER}/{_NUMBER}/{_NUMBER}(\.mvt|\.pbf)?",
    re.ASCII,
)
_QUERIES = frozenset({b"", b"f=mvt", b"f=pbf"})
_OF_A_BODY = frozenset({b"content-length", b"transfer-encoding"})
_WEIGHTLESS = re.compile(r"\s*;\s*q=0(\.0*)?\s*")

Headers = list[tuple[bytes, bytes]]
Wait = Callable[[Coroutine[Any, Any, Tile]], Awaitable[Tile]]


def tiles_of(state: Any) -> MapTiles:
    """The tiles of the map that the present caller sees."""
    tiles: MapTiles = state.edition_tiles if present_caller().sees == "edition" else state.tiles
    return tiles


class TilePath(NamedTuple):
    """The path of a tile that there may be."""

    at: Address
    route: str
    """The template of its route, as the log and the metrics name it."""


class Answer(NamedTuple):
    """Status, headers and body of an answer."""

    status: int
    headers: Headers
    body: bytes


class TileFront:
    """Answers requests for vector tiles and passes on all others."""

    def __init__(self, app: ASGIApp, max_zoom: int) -> None:
        self.app = app
        self._max_zoom = max_zoom

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass on."""
        path = self._tile_path(scope)
        if path is None:
            await self.app(scope, receive, send)
            return
        scope["route"] = SimpleNamespace(path=path.route)  # log and metrics name a request by it
        scope["path_params"] = {"z": path.at.z, "x": path.at.x, "y": path.at.y}
        tiles, wait = tiles_of(scope["app"].state), _unless_client_leaves(receive)
        try:
            reply = await tiles.first(lambda: answer(tiles.now, path.at, scope["headers"], wait))
        except ClientDisconnect:
            reply = Answer(CLIENT_GONE, [], b"")
        except ServiceError as error:
            await (await service_error(Request(scope), error))(scope, receive, send)
            return
        except psycopg.OperationalError as error:
            await (await database_error(Request(scope), error))(scope, receive, send)
            return
        await send({"type": "http.response.start", "status": reply.status, "headers": reply.headers})
        await send({"type": "http.response.body", "body": reply.body})

    def _tile_path(self, scope: Scope) -> TilePath | None:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["query_string"] not in _QUERIES:
            return None
        path = parse_path(scope["path"], self._max_zoom)
        if path is None or any(name in _OF_A_BODY for name, _ in scope["headers"]):
            return None
        return path


@lru_cache(maxsize=10_000)
def parse_path(path: str, max_zoom: int) -> TilePath | None:
    """The tile of a path; None where it is no address of a vector tile, or of one outside of what there is."""
    match = _PATH.fullmatch(path)
    if match is None:
        return None
    z, x, y, suffix, layer, matrix, row, column, alternative = match.groups()
    if z is not None:
        at, route = Address(SEGMENTS, int(z), int(x), int(y)), _OF_SEGMENTS + suffix
    else:
        at = Address(layer or SEGMENTS, int(matrix), int(column), int(row))
        route = (_OF_ALL if layer is None else _OF_COLLECTION) + (alternative or "")
    return TilePath(at, route) if at.z <= max_zoom and at.x < 2**at.z and at.y < 2**at.z else None


def check_tile(at: Address, max_zoom: int, names: tuple[str, str, str] = ("z", "x", "y")) -> None:
    """Raise ``NotFoundError`` for a tile that cannot be; ``names``: of zoom, column and row in the request."""
    zoom, column, row = names
    if at.z > max_zoom:
        raise NotFoundError(say("tiles.too_deep", most=max_zoom, z=at.z), field=zoom)
    for name, number in ((column, at.x), (row, at.y)):
        if number >= 2**at.z:
            raise NotFoundError(
                say("tiles.outside", z=at.z, name=name, most=2**at.z - 1, n=number), field=name
            )


async def to_its_end(building: Coroutine[Any, Any, Tile]) -> Tile:
    """Wait for a tile as long as it takes."""
    return await building


async def answer(
    tiles: Tiles,
    at: Address,
    headers: Iterable[tuple[bytes, bytes]],
    wait: Wait = to_its_end,
    *,
    is_admitted: bool = False,
) -> Answer:
    """The tile, 204 where it holds nothing, or 304 where the client has it.

    ``headers``: of the request; ``wait``: how to wait for a tile that is not in memory; ``is_admitted``: the
    request has a place in its class already.
    """
    tiles.count(at)
    if_none_match, accept_encoding = _read(headers)
    etag, tile = await tiles.etag(at), None
    if etag is None:
        tile = await wait(tiles.made(at, is_admitted=is_admitted))
        etag = tile.etag
    own = [(b"etag", etag.encode()), *policy(tiles.settings)]
    if if_none_match is not None and is_named(etag, if_none_match):
        return Answer(304, own, b"")
    if tile is None:
        tile = tiles.at_hand(at, etag) or await wait(tiles.get(at, etag, is_admitted=is_admitted))
    if not tile.body:
        return Answer(204, own, b"")
    own.append((b"content-type", MVT.encode()))
    body = tile.body
    if takes_gzip(accept_encoding):
        own.append((b"content-encoding", b"gzip"))
    else:
        body = await plain(body)
    own.append((b"content-length", str(len(body)).encode()))
    return Answer(200, own, body)


@lru_cache(maxsize=2)
def policy(settings: Settings) -> Headers:
    """What caches are told: to ask each time, or how long a tile is good."""
    caching = REVALIDATE
    if settings.tile_max_age_s:
        caching = f"public, max-age={settings.tile_max_age_s}, stale-while-revalidate={settings.tile_stale_s}"
    return [(b"cache-control", caching.encode()), (b"vary", b"Accept-Encoding")]


def _read(headers: Iterable[tuple[bytes, bytes]]) -> tuple[str | None, str]:
    """If-None-Match and Accept-Encoding."""
    if_none_match, encodings = None, ""
    for name, value in headers:
        if name == b"if-none-match":
            text = value.decode("latin-1")
            if_none_match = text if if_none_match is None else f"{if_none_match},{text}"
        elif name == b"accept-encoding":
            encodings = f"{encodings},{value.decode('latin-1')}"
    return if_none_match, encodings


@lru_cache(maxsize=200)
def takes_gzip(accept_encoding: str) -> bool:
    """Whether the header allows gzip (RFC 9110, section 12.5.3)."""
    allowed = {"gzip": False, "*": False}
    named = set()
    for item in accept_encoding.lower().split(","):
        name, _, weight = item.partition(";")
        if name.strip() in allowed:
            named.add(name.strip())
            allowed[name.strip()] = not _WEIGHTLESS.fullmatch(f";{weight}")
    return allowed["gzip"] if "gzip" in named else allowed["*"]


def _unless_client_leaves(receive: Receive) -> Wait:
    """Waits for a tile that is being built; when the client goes away first, what was begun for it ends."""

    async def wait(building: Coroutine[Any, Any, Tile]) -> Tile:
        tile, leaving = asyncio.create_task(building), asyncio.create_task(_left(receive))
        try:
            await asyncio.wait({tile, leaving}, return_when=asyncio.FIRST_COMPLETED)
            if not tile.done():
                raise ClientDisconnect
            return tile.result()
        finally:
            for task in (tile, leaving):
                task.cancel()

    return wait


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
