"""The quick way to a vector tile: past the framework and all that it wraps around a route.

What a route costs before its first line (its middlewares, a task, a thread, the checks of its parameters) is several
times what a warm tile or a 304 does. So what is the address of a tile beyond doubt is answered here. Everything else
goes on to the routes: what cannot be the address of one, with the reasons, and what nobody asks for often. What has
to hold for every request lies before it: its number, its line in the log, its count, HEAD, known hosts.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass
from typing import Any

import psycopg
from fastapi import Request
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from app.core.disconnects import CLIENT_GONE
from app.core.errors import ServiceError
from app.core.problems import database_error, service_error
from app.map.tiles.answers import Asked, Waiting, answer, asked_by
from app.map.tiles.tiles import Tile, Tiles

QUERIES = frozenset({b"", b"f=mvt", b"f=pbf"})
_BODY = frozenset({b"content-length", b"transfer-encoding"})


@dataclass(frozen=True)
class _Route:
    """What log and metrics call the way that a request took."""

    path: str


class TileFront:
    """Answers requests for vector tiles and passes on all others."""

    def __init__(self, app: ASGIApp, max_zoom: int) -> None:
        self.app = app
        self._max_zoom = max_zoom

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass on."""
        asked = self._asked(scope)
        if asked is None:
            await self.app(scope, receive, send)
            return
        scope["route"] = _Route(asked.route)
        scope["path_params"] = {"z": asked.at.z, "x": asked.at.x, "y": asked.at.y}
        tiles: Tiles = scope["app"].state.tiles
        try:
            found = await answer(tiles, asked.at, scope["headers"], _unless_client_leaves(receive))
        except ClientDisconnect:
            await send({"type": "http.response.start", "status": CLIENT_GONE, "headers": []})
            await send({"type": "http.response.body", "body": b""})
        except ServiceError as error:
            await (await service_error(Request(scope), error))(scope, receive, send)
        except psycopg.OperationalError as error:
            await (await database_error(Request(scope), error))(scope, receive, send)
        else:
            await send({"type": "http.response.start", "status": found.status, "headers": found.headers})
            await send({"type": "http.response.body", "body": found.body})

    def _asked(self, scope: Scope) -> Asked | None:
        if scope["type"] != "http" or scope["method"] != "GET" or scope["query_string"] not in QUERIES:
            return None
        asked = asked_by(scope["path"], self._max_zoom)
        if asked is None or any(name in _BODY for name, _ in scope["headers"]):
            return None
        return asked


def _unless_client_leaves(receive: Receive) -> Waiting:
    """Waits for a tile that is being built; when the client goes away first, what was begun for it ends."""

    async def wait(building: Coroutine[Any, Any, Tile]) -> Tile:
        tile, leaving = asyncio.create_task(building), asyncio.create_task(_left(receive))
        try:
            await asyncio.wait({tile, leaving}, return_when=asyncio.FIRST_COMPLETED)
            if not tile.done():
                raise ClientDisconnect
            return tile.result()
        finally:
            for one in (tile, leaving):
                one.cancel()

    return wait


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
