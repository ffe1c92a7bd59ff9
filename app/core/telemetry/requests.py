"""Each request's number, its line in the log, its span, and its part of the metrics.

The line holds the template of the route, the path unless that is a place (a tile), and the names of the query's
parameters without their values: a box or a list of places tells where somebody lives, or looks.
"""

from __future__ import annotations

import logging
import re
import time
import uuid
from collections.abc import Callable
from urllib.parse import parse_qsl

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.telemetry import tracing
from app.core.telemetry.logs import about, tell

REQUEST_ID = "X-Request-ID"
QUIET = frozenset({"/healthz", "/readyz", "/metrics"})
"""Machines ask for these every few seconds: logged at DEBUG."""
NO_ROUTE = "(no route)"
LONGEST_PATH = 200

_NAME = re.compile(r"[A-Za-z_][A-Za-z_-]{0,40}")
_ACCEPTED_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_PLACES = frozenset({"x", "y", "z", "bbox"})
"""Parts of a path that say where."""
_SECRET = re.compile(r"vsk_[^/]*")
"""A key in an address (``/v1/live``), whatever else is wrong with that."""

logger = logging.getLogger(__name__)


class RequestLog:
    """Numbers every request, answers with that number, and logs the request when its answer has ended.

    A number that the client or a proxy sends as ``X-Request-ID`` is kept, if it can be one.
    """

    def __init__(self, app: ASGIApp, observe: Callable[[str, str, int, float], None]) -> None:
        """``observe`` counts a request: method, template of the route (a series per drive would never end), status,
        seconds."""
        self.app = app
        self._observe = observe

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on; the time ends with the last byte of the answer."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        number = request_id(headers.get(REQUEST_ID))
        status, sent, started = 500, 0, time.perf_counter()

        async def watched(message: Message) -> None:
            nonlocal status, sent
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[REQUEST_ID] = number
            sent += len(message.get("body", b""))
            await send(message)

        with (
            about(request=number),
            tracing.span("request", server=True, parent=headers.get("traceparent")) as span,
        ):
            try:
                await self.app(scope, receive, watched)
            finally:
                took_s = time.perf_counter() - started
                facts = self._facts(scope, status)
                self._observe(scope["method"], str(facts["route"]), status, took_s)
                span.name(f"{scope['method']} {facts['route']}")
                span.note(**facts, request=number)
                span.failed(status >= 500)
                level = _level(scope["path"], status)
                tell(logger, "request", level=level, **facts, seconds=took_s, bytes=sent)

    @staticmethod
    def _facts(scope: Scope, status: int) -> dict[str, object]:
        route = getattr(scope.get("route"), "path", NO_ROUTE)
        parts = scope.get("path_params") or {}
        path = None if _PLACES & parts.keys() else _SECRET.sub("vsk_...", scope["path"])[:LONGEST_PATH]
        return {
            "method": scope["method"],
            "route": route,
            "path": path,
            "query": names_of(scope["query_string"]),
            "status": status,
            "drive": parts.get("drive_id"),
        }


def request_id(sent: str | None) -> str:
    """The number that was sent, or a new one where none was that could be one."""
    return sent if sent and _ACCEPTED_ID.fullmatch(sent) else uuid.uuid4().hex


def names_of(query: bytes) -> str | None:
    """The names of a query's parameters, without their values; None: there are none."""
    pairs = parse_qsl(query.decode("latin-1"), keep_blank_values=True)
    names = {name if _NAME.fullmatch(name) else "?" for name, _ in pairs}  # a place may be written as a name
    return ",".join(sorted(names))[:LONGEST_PATH] or None


def _level(path: str, status: int) -> int:
    if path in QUIET:
        return logging.DEBUG
    return logging.WARNING if status >= 500 else logging.INFO
