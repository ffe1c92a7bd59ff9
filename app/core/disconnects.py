"""Clients that disconnect: their request ends, with its place in a queue and its statement in the database.

Only requests that read and have no body end so: a change that has begun is completed. Routes need not know of it: a
session of ``Service.reading`` belongs to the request that it was opened for.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from threading import Lock
from typing import Any

import anyio
import psycopg
from anyio import CancelScope, CapacityLimiter, to_thread
from psycopg import Connection
from sqlalchemy import event
from sqlalchemy.orm import Session
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

CLIENT_GONE = 499
"""nginx's status. No client sees it; the metrics count it."""
AGAIN_S = 0.2
"""Seconds between two cancellations: a request that is between two statements begins the next one."""
CANCEL_TIMEOUT_S = 5.0
"""How long cancelling a statement on the server may take."""


class _Request:
    """One request: the connections that work for it, and its answer, whose messages pass through here."""

    def __init__(self, send: Send) -> None:
        self.gone = False
        """Whether the client left before the end."""
        self.running = CancelScope()
        self.disconnected = asyncio.Event()
        self.started = self.finished = False
        self._asked = False
        self._send = send
        self._connections: set[Connection[Any]] = set()
        self._lock = Lock()

    def begin(self, connection: Connection[Any]) -> None:
        with self._lock:
            self._connections.add(connection)

    def end(self, connection: Connection[Any]) -> None:
        """Forget the connection; waits while it is being cancelled, which must not hit who gets it next."""
        with self._lock:
            self._connections.discard(connection)

    def cancel(self) -> None:
        """Cancel on the server what runs for this request."""
        with self._lock:
            for connection in self._connections:
                with suppress(psycopg.Error):  # a server that is away runs no statement either
                    connection.cancel_safe(timeout=CANCEL_TIMEOUT_S)

    async def receive(self) -> Message:
        """What the server would say: the request, which has no body, then that the client is gone."""
        if not self._asked:
            self._asked = True
            return {"type": "http.request", "body": b"", "more_body": False}
        await self.disconnected.wait()
        return {"type": "http.disconnect"}

    async def send(self, message: Message) -> None:
        """Pass the message on."""
        self.started = True
        if self.gone and message["type"] == "http.response.start":
            message = {**message, "status": CLIENT_GONE}
        self.finished = message["type"] == "http.response.body" and not message.get("more_body")
        await self._send(message)


_current: ContextVar[_Request | None] = ContextVar("request that is answered", default=None)


def client_left() -> bool:
    """Whether the client of the request that is being answered went away."""
    request = _current.get()
    return request is not None and request.gone


@contextmanager
def ending_with_client(session: Session) -> Iterator[None]:
    """Within the block the session's statements are cancelled when the client of the present request leaves."""
    request = _current.get()
    if request is None:
        yield
        return
    connections: list[Connection[Any]] = []

    def begin(_session: object, _transaction: object, connection: Any) -> None:
        connections.append(connection.connection.driver_connection)
        request.begin(connections[-1])

    event.listen(session, "after_begin", begin)
    try:
        yield
    finally:
        for connection in connections:
            request.end(connection)
        if request.gone:  # a cancellation that arrives late must hit nobody
            session.invalidate()


class EndWithClient:
    """Watches whether the client of a request that reads is still there, and ends the request when it is not."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._threads = CapacityLimiter(4)  # cancelling waits for no other work

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer the request, or end it."""
        if scope["type"] != "http" or scope["method"] not in {"GET", "HEAD"} or has_body(scope):
            await self.app(scope, receive, send)
            return
        request = _Request(send)
        watching = asyncio.create_task(self._watch(receive, request))
        token = _current.set(request)
        try:
            with request.running:
                await self.app(scope, request.receive, request.send)
        finally:
            _current.reset(token)
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching
        if not request.started:
            await answer_nobody(request.send)

    async def _watch(self, receive: Receive, request: _Request) -> None:
        while (await receive())["type"] != "http.disconnect":
            pass
        request.disconnected.set()
        if request.finished:  # the server sends the same message after the last byte of an answer
            return
        request.gone = True
        request.running.cancel()
        while True:
            await to_thread.run_sync(request.cancel, limiter=self._threads)
            await anyio.sleep(AGAIN_S)


async def answer_nobody(send: Send) -> None:
    """End a request whose client is gone."""
    await send({"type": "http.response.start", "status": CLIENT_GONE, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def has_body(scope: Scope) -> bool:
    """Whether a request announces a body."""
    headers = Headers(scope=scope)
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers
