"""Middleware around every route, in the order in which ``app.main`` wraps it.

CORS and compression are Starlette's own. It has no middleware for HEAD, for changes from other sites and for early
answers. Its ``TrustedHostMiddleware`` answers in plain text and knows neither the address that a request came to nor
paths that are open to everybody, so it is not used. Knows no subject beyond a few paths.
"""

from __future__ import annotations

import asyncio
import gc
import re
import sys
import time
from collections.abc import Sequence
from ipaddress import ip_address
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.disconnects import has_body
from app.core.errors import CrossOriginWriteError, UnknownHostError
from app.core.messages import say
from app.core.problems import refuse
from app.core.settings import Settings

LINGER_BYTES = 4 * 1024 * 1024
LINGER_S = 2.0
"""How much, and how long, of a body is still read after an answer that did not wait for it."""

COLLECTING_THRESHOLDS = (700, 10, 1_000_000)
"""Garbage collection of an API process. Python's collector runs by how many objects are made. In an API it therefore
looks every few seconds through half a million objects that stay for good, and through all open event streams. That
takes a quarter of a second in which nothing is answered (``benchmarks/service/load.py``). What exists at the start is
frozen (``stay_loaded``), only young objects are collected by their number, some milliseconds each time, and a full
collection runs after so many requests as may have left some 20 MB of cycles (``CollectAfterRequests``)."""
COLLECT_AFTER = 20_000
"""Requests. Each leaves some ten objects."""
LASTING_S, LASTING_WEIGHT = 1.0, 20
"""A request that lasts longer (an event stream) outlives the young generations, leaves some 30 kB and counts as 20."""

UPLOAD_PATHS = frozenset({"/v1/drives", "/v1/operations"})
RESUMED_PATH = "/v1/uploads/"
"""Before the ids of uploads that come in parts."""
LIVE_PATH = "/v1/live/"
"""Before the names of programs that send points of a drive under way."""
CHANGING = frozenset({"POST", "PUT", "PATCH", "DELETE"})
FOR_PROBES = frozenset({"/healthz", "/readyz"})
"""Balancers ask for these under whatever name they know the machine by; the answers tell nothing about anybody."""
ANY_HOST = "*"
_AS_THEY_ARE = re.compile(
    r"/v1/exports/[^/]+/file|/v1/editions/[^/]+/[^/]+|/v1/drives/[^/]+/log|/v1/owners?(/[^/]+)?/archive"
)
_HOST = re.compile(r"(\[(?P<literal>[0-9A-Fa-f:.]+)\]|(?P<name>[^:\[\]/@\s]+))(:\d*)?")
PUBLISHED = (
    "/collections",
    "/conformance",
    "/glyphs",
    "/height",
    "/names",
    "/openapi.json",
    "/problems",
    "/sprites",
    "/style.json",
    "/tileMatrixSets",
    "/tiles",
    "/v1/changes",
    "/v1/elevation",
    "/v1/segments",
)
"""What pages of the origins in VERSANT_CORS_ORIGINS may read: the map, and no drives."""


TURN_S = 0.0005
"""Seconds after which a thread that computes hands Python's lock to the event loop (by default 5 ms). The loop waits
for the lock each time it returns from the network, several times in one request."""


def stay_loaded() -> None:
    """Freeze all objects that exist now, and let the event loop wait for no thread longer than ``TURN_S``.

    Call it when everything is imported and made.
    """
    sys.setswitchinterval(TURN_S)
    gc.collect()
    gc.freeze()
    gc.set_threshold(*COLLECTING_THRESHOLDS)


def is_upload(path: str) -> bool:
    """Whether requests to that path bring a file, at the pace of their client."""
    return path in UPLOAD_PATHS or path.startswith(RESUMED_PATH)


class CollectAfterRequests:
    """Runs a full garbage collection after every ``COLLECT_AFTER`` requests (see ``COLLECTING_THRESHOLDS``)."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._ended = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and count it."""
        started = time.monotonic()
        try:
            await self.app(scope, receive, send)
        finally:
            self._ended += LASTING_WEIGHT if time.monotonic() - started > LASTING_S else 1
            if self._ended >= COLLECT_AFTER:
                self._ended = 0
                gc.collect()


class Compressed(GZipMiddleware):
    """Compresses answers, but for files that are fetched in parts, whose ranges and digests are those of their own
    bytes, and for archives, which are compressed."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Compress the answer where that is wanted."""
        if _AS_THEY_ARE.fullmatch(scope.get("path", "")):
            await self.app(scope, receive, send)
        else:
            await super().__call__(scope, receive, send)


class HeadMiddleware:
    """Answers HEAD like GET, without the body (RFC 9110, section 9.3.2)."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on as a GET and drop what it answers."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self.app(scope, receive, send)
            return
        ended = False

        async def headers_only(message: Message) -> None:
            nonlocal ended
            if message["type"] == "http.response.start":
                await send(message)
            elif not ended:  # the first piece ends the answer: an endless one (events) must not go on
                ended = True
                await send({"type": "http.response.body", "body": b"", "more_body": False})

        await self.app({**scope, "method": "GET"}, receive, headers_only)


class EarlyAnswers:
    """Lets a client read an answer that is given before its body was read to the end.

    Closing at once would make the system reset the connection, and a client that is still sending may then
    lose the answer, such as a 413. So a bounded part of what it still sends is read and dropped first.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Watch how far the body is read, and linger after an answer that came before its end."""
        # A client that sends "Expect: 100-continue" waits for permission, and reading would give it.
        if scope["type"] != "http" or not has_body(scope) or "expect" in Headers(scope=scope):
            await self.app(scope, receive, send)
            return
        unread, early = True, False

        async def watched() -> Message:
            nonlocal unread
            message = await receive()
            unread = unread and message["type"] == "http.request" and bool(message.get("more_body"))
            return message

        async def lingering(message: Message) -> None:
            nonlocal early
            if message["type"] == "http.response.start" and unread:
                early = True
                MutableHeaders(scope=message)["Connection"] = "close"
            if message["type"] == "http.response.body" and early and not message.get("more_body"):
                await send({**message, "more_body": True})
                await _drop(receive)
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            await send(message)

        await self.app(scope, watched, lingering)


async def _drop(receive: Receive) -> None:
    dropped = 0
    try:
        async with asyncio.timeout(LINGER_S):
            while dropped < LINGER_BYTES:
                message = await receive()
                dropped += len(message.get("body", b""))
                if message["type"] != "http.request" or not message.get("more_body"):
                    return
    except TimeoutError:
        return


class KnownHosts:
    """Refuses requests under a name that is not the service's.

    A browser lets a page read from the host that it came from. After loading, that host's name can be made to lead to
    this machine (DNS rebinding): the page could then read and delete drives of a service that listens on loopback
    alone. But its requests still name that host. Known are loopback, the address that the connection came to, and what
    the settings name.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app = app
        public = urlsplit(settings.public_url or "").hostname
        self.names = {settings.host.lower(), *settings.host_names, *([public] if public else [])}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 421 to such a request, pass on any other."""
        if scope["type"] == "http" and scope["path"] not in FOR_PROBES:
            for host in Headers(scope=scope).getlist("host"):
                if not self._is_known(host, scope):
                    name = host if host.isprintable() else repr(host)
                    error = UnknownHostError(say("service.unknown_host", name=name[:100]))
                    await refuse(error, scope, receive, send)
                    return
        await self.app(scope, receive, send)

    def _is_known(self, host: str, scope: Scope) -> bool:
        parts = _HOST.fullmatch(host)
        if parts is None:
            return ANY_HOST in self.names
        name = (parts["literal"] or parts["name"]).lower().rstrip(".")
        if name in self.names or ANY_HOST in self.names or name == "localhost":
            return True
        try:
            address = ip_address(name)
            return address.is_loopback or address == ip_address((scope.get("server") or ("",))[0])
        except ValueError:
            return False


class PublishedCors:
    """CORS for pages of the origins that the settings name: they may read what is published.

    It surrounds everything that answers, also tiles and errors. Without such origins it is left out.
    """

    def __init__(self, app: ASGIApp, origins: Sequence[str]) -> None:
        self.app = app
        self.cors = CORSMiddleware(
            app,
            allow_origins=origins,
            allow_methods=["GET", "HEAD"],
            expose_headers=["ETag", "Link", "Content-Crs"],
            max_age=3600,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Through the CORS middleware where the path is published, past it elsewhere."""
        path = scope.get("path", "")
        published = path == "/" or path.startswith(PUBLISHED)
        # Observations of a segment name drives.
        app = self.cors if published and not path.endswith("/observations") else self.app
        await app(scope, receive, send)


class SameOriginWrites:
    """Refuses changes that a page of another site asks a visitor's browser for.

    The origin that browsers state keeps a page of another site from using a visitor's session, and from uploading to a
    service on the visitor's own machine that asks for no keys. Programs that are no browsers send none.
    """

    def __init__(self, app: ASGIApp, public_url: str | None) -> None:
        self.app = app
        self.own_host = urlsplit(public_url).netloc if public_url else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 403 to such a request, pass on any other."""
        if scope["type"] == "http" and scope["method"] in CHANGING and self._foreign(Headers(scope=scope)):
            message = "A page of another site asked for this change. Do it from this site, or with a program."
            await refuse(CrossOriginWriteError(message), scope, receive, send)
        else:
            await self.app(scope, receive, send)

    def _foreign(self, headers: Headers) -> bool:
        origin = headers.get("origin")
        if origin is None:
            return headers.get("sec-fetch-site") == "cross-site"
        return urlsplit(origin).netloc not in {headers.get("host"), self.own_host} - {None}
