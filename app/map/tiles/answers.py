"""Answers to requests for vector tiles, from the request's headers to its last byte, without a framework around them.

Both ways to a tile end here: the quick one (``app.map.tiles.front``), and the routes, which take what that leaves.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from app.core.errors import NotFoundError
from app.core.http import REVALIDATE
from app.core.settings import Settings
from app.map.tiles.store import SEGMENTS, WAYS, Address
from app.map.tiles.tiles import Tile, Tiles, plain

MVT = "application/vnd.mapbox-vector-tile"
QUAD = "WebMercatorQuad"
SUFFIXES = ("mvt", "pbf")
LAYERS = (SEGMENTS, WAYS)
DEEPEST_ZOOM = 30

XYZ = "/tiles/{z}/{x}/{y}."
OF_ALL = f"/tiles/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}"
OF_COLLECTION = f"/collections/{{collection}}/tiles/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}"

_NUMBER = r"(0|[1-9]\d{0,9})"
_PATH = re.compile(
    rf"/tiles/{_NUMBER}/{_NUMBER}/{_NUMBER}\.(mvt|pbf)"
    rf"|(?:/collections/({'|'.join(LAYERS)}))?/tiles/{QUAD}/{_NUMBER}/{_NUMBER}/{_NUMBER}(\.mvt|\.pbf)?",
    re.ASCII,
)
_WEIGHTLESS = re.compile(r"\s*;\s*q=0(\.0*)?\s*")

Headers = list[tuple[bytes, bytes]]
Waiting = Callable[[Coroutine[Any, Any, Tile]], Awaitable[Tile]]


@dataclass(frozen=True)
class Asked:
    """A request for a tile that there may be."""

    at: Address
    route: str
    """Its template, as the log and the metrics name it."""


@dataclass(frozen=True)
class Answer:
    """Status, headers and body of an answer."""

    status: int
    headers: Headers
    body: bytes


@lru_cache(maxsize=10_000)
def asked_by(path: str, max_zoom: int) -> Asked | None:
    """What a path asks for; None where it is no address of a vector tile, or of one outside of what there is."""
    found = _PATH.fullmatch(path)
    if found is None:
        return None
    z, x, y, suffix, layer, matrix, row, column, alternative = found.groups()
    if z is not None:
        asked = Asked(Address(SEGMENTS, int(z), int(x), int(y)), XYZ + suffix)
    else:
        template = OF_ALL if layer is None else OF_COLLECTION
        asked = Asked(
            Address(layer or SEGMENTS, int(matrix), int(column), int(row)), template + (alternative or "")
        )
    at = asked.at
    return asked if at.z <= max_zoom and at.x < 2**at.z and at.y < 2**at.z else None


def check_tile(at: Address, max_zoom: int, names: tuple[str, str, str] = ("z", "x", "y")) -> None:
    """Raise ``NotFoundError`` for a tile that cannot be; ``names``: of zoom, column and row in the request."""
    zoom, column, row = names
    if at.z > max_zoom:
        raise NotFoundError(f"Tiles end at zoom {max_zoom}; enlarge those for zoom {at.z}.", field=zoom)
    for name, number in ((column, at.x), (row, at.y)):
        if number >= 2**at.z:
            raise NotFoundError(
                f"At zoom {at.z}, {name} goes from 0 to {2**at.z - 1}; {number} is outside.", field=name
            )


async def to_its_end(building: Coroutine[Any, Any, Tile]) -> Tile:
    """Wait for a tile as long as it takes."""
    return await building


async def answer(
    tiles: Tiles,
    at: Address,
    asked: Iterable[tuple[bytes, bytes]],
    wait: Waiting = to_its_end,
    *,
    is_admitted: bool = False,
) -> Answer:
    """The tile, 204 where it holds nothing, or 304 where the client has it.

    ``asked``: the request's headers; ``wait``: how to wait for a tile that is not in memory;
    ``is_admitted``: the request has a place in its class already.
    """
    tiles.count(at)
    known, takes_gzip = _wishes(asked)
    etag, tile = await tiles.etag(at), None
    if etag is None:
        tile = await wait(tiles.made(at, is_admitted=is_admitted))
        etag = tile.etag
    headers = [(b"etag", etag.encode()), *_policy(tiles.settings)]
    if known is not None and _is_known(etag, known):
        return Answer(304, headers, b"")
    if tile is None:
        tile = tiles.at_hand(at, etag) or await wait(tiles.get(at, etag, is_admitted=is_admitted))
    if not tile.body:
        return Answer(204, headers, b"")
    headers.append((b"content-type", MVT.encode()))
    body = tile.body
    if takes_gzip:
        headers.append((b"content-encoding", b"gzip"))
    else:
        body = await plain(body)
    headers.append((b"content-length", str(len(body)).encode()))
    return Answer(200, headers, body)


def cache_control(settings: Settings) -> str:
    """What caches are told: to ask each time, or how long a tile is good."""
    if not settings.tile_max_age_s:
        return REVALIDATE
    return f"public, max-age={settings.tile_max_age_s}, stale-while-revalidate={settings.tile_stale_s}"


@lru_cache(maxsize=2)
def _policy(settings: Settings) -> Headers:
    return [
        (b"cache-control", cache_control(settings).encode()),
        (b"vary", b"Accept-Encoding"),
    ]


def _wishes(headers: Iterable[tuple[bytes, bytes]]) -> tuple[str | None, bool]:
    """If-None-Match, and whether gzip is taken."""
    known, encodings = None, ""
    for name, value in headers:
        if name == b"if-none-match":
            known = value.decode("latin-1") if known is None else f"{known},{value.decode('latin-1')}"
        elif name == b"accept-encoding":
            encodings = f"{encodings},{value.decode('latin-1')}"
    return known, takes_gzip(encodings)


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


def _is_known(etag: str, asked: str) -> bool:
    """Weak comparison (RFC 9110, section 13.1.2)."""
    own = etag.removeprefix("W/")
    return any(one in {"*", own} for one in (name.strip().removeprefix("W/") for name in asked.split(",")))
