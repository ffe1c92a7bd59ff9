"""Connections: how many there may be, how long each may take over the head of a request, and how slowly it may read.

uvicorn bounds none of it: a socket that sends nothing, or a head without an end, would stay for ever, and a thousand of
them take all descriptors of the process, ``/healthz`` with them. Here is what holds before there is a request; what
requests have to share is for ``app.core.admission``.
"""

from __future__ import annotations

import asyncio
import logging
import resource
import time
from typing import Any

from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app.core.errors import KINDS, BusyError, HeadTooLargeError, ServiceError, SlowClientError
from app.core.middleware import FOR_PROBES
from app.core.problems import PROBLEM_JSON, problem_document, refuse
from app.core.receiving.clients import Shares, client_of, is_within
from app.core.receiving.sse import end_streams
from app.core.settings import Settings

HEAD_BYTES = 32 * 1024
"""Of a request's address and headers; browsers and proxies stay below 16 KiB."""
MOST_HEADERS = 200
MOST_PIPELINED = 16
"""Requests that a connection may send before its first is answered: thousands fit into one packet, each of them an
object that is kept."""
UNREAD_S = 60.0
"""An answer of which a client takes nothing for this time is given up, and its memory freed."""
OWN_FILES = 200
"""Descriptors that are for no client: connections to the database, files, pipes."""
SPARE = 50
"""Connections above the limit, for probes."""
PROXY = "proxy"
"""As whom the connections of trusted proxies are counted."""
TELL_EVERY_S = 60.0

log = logging.getLogger(__name__)


def server_options(settings: Settings) -> dict[str, Any]:
    """How uvicorn serves: options of ``uvicorn.run`` and ``uvicorn.Config``.

    Raises the process's limit of open files as far as its connections need it.
    """
    connections = Connections(settings)

    class Bounded(BoundedProtocol):
        held_by = connections

    # Proxy headers are for ``app.core.receiving.clients`` alone: uvicorn would believe every client on loopback.
    return {"http": Bounded, "ws": "none", "proxy_headers": False, "access_log": False}


class Connections:
    """Counts the connections of a process by client. Lives in its event loop.

    When a client reaches its limit, its oldest idle connection is closed; when all connections are taken, the oldest
    idle one of the client that has most. So silent sockets harm only the client that holds them, and probes always get
    in. Connections with a request stay. Beyond its limit a client's further requests are turned away, except probes.
    """

    def __init__(self, settings: Settings) -> None:
        self.head_timeout_s = settings.head_timeout_s
        self.open = 0
        self._proxies = settings.proxies
        self._busy = Shares(_as_files_allow(settings.connections_max), settings.connections_per_client)
        self._idle: dict[str, dict[BoundedProtocol, None]] = {}
        self._told_s = -TELL_EVERY_S

    def client_at(self, address: str) -> str:
        """The client that limits count."""
        return PROXY if is_within(address, self._proxies) else client_of(address)

    def opened(self, connection: BoundedProtocol, client: str) -> bool:
        """Count a new connection; False if there is no room for it."""
        self.open += 1
        idle = self._idle.setdefault(client, {})
        if client != PROXY and len(idle) + self._busy.held[client] >= self._busy.per_client:
            self._evict(client)
        elif self.open > self._busy.most:
            self._evict(max(self._idle, key=lambda one: len(self._idle[one])))
        self._idle.setdefault(client, {})[connection] = None
        return self.open <= self._busy.most + SPARE

    def closed(self, connection: BoundedProtocol, client: str, *, counted: bool) -> None:
        """Count a closed connection no longer."""
        self.open -= 1
        self._awake(connection, client)
        if counted:
            self._busy.give_back(client)

    def begins(self, connection: BoundedProtocol, client: str) -> bool:
        """A request begins on the connection; False if the client has too many."""
        self._awake(connection, client)
        busy = self._busy
        if busy.total < busy.most if client == PROXY else busy.allows(client):
            busy.take(client)
            return True
        self._tell()
        return False

    def rests(self, connection: BoundedProtocol, client: str, *, counted: bool) -> None:
        """The connection waits for its next request."""
        self._idle.setdefault(client, {})[connection] = None
        if counted:
            self._busy.give_back(client)

    def _awake(self, connection: BoundedProtocol, client: str) -> None:
        idle = self._idle.get(client, {})
        idle.pop(connection, None)
        if not idle:
            self._idle.pop(client, None)

    def _evict(self, client: str) -> None:
        oldest = next(iter(self._idle[client]), None)
        if oldest is not None:
            self._awake(oldest, client)
            oldest.transport.abort()

    def _tell(self) -> None:
        if time.monotonic() - self._told_s >= TELL_EVERY_S:
            self._told_s = time.monotonic()
            log.warning(
                "requests are turned away: a client has as many connections as it may have "
                "(VERSANT_CONNECTIONS_PER_CLIENT, VERSANT_CONNECTIONS_MAX)"
            )


class BoundedProtocol(HttpToolsProtocol):
    """uvicorn's protocol with bounds on what comes before a request, and on answers that nobody takes."""

    held_by: Connections

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count it, and begin to wait for the head of a request."""
        super().connection_made(transport)
        self._holder = self.held_by.client_at(self.client[0] if self.client else "")
        self._busy = self._counted = False
        self._overhead_bytes = 0  # since the last head that was whole, or the last byte of a body
        self._head_timer: asyncio.TimerHandle | None = None
        self._unread_timer: asyncio.TimerHandle | None = None
        if self.held_by.opened(self, self._holder):
            self._await_head()
        else:
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it no more."""
        for timer in (self._head_timer, self._unread_timer):
            if timer is not None:
                timer.cancel()
        self.held_by.closed(self, self._holder, counted=self._counted)
        self._counted = False
        super().connection_lost(exc)

    def shutdown(self) -> None:
        """The server stops."""
        end_streams()
        super().shutdown()

    def data_received(self, data: bytes) -> None:
        """Parse it, unless the bytes to be held grow too large: a head, a field of it, trailers."""
        self._overhead_bytes += len(data)
        super().data_received(data)
        if self._overhead_bytes > HEAD_BYTES and not self.transport.is_closing():
            self._refuse(HeadTooLargeError)

    def on_headers_complete(self) -> None:
        """Begin the request, or refuse it."""
        self._overhead_bytes = 0
        if len(self.pipeline) >= MOST_PIPELINED:
            self.transport.abort()
            raise _RefusedError
        size = len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        if size > HEAD_BYTES or len(self.headers) > MOST_HEADERS:
            self._refuse(HeadTooLargeError)
            raise _RefusedError
        if self._head_timer is not None:
            self._head_timer.cancel()
        if not self._busy:
            self._busy = True
            self._counted = self.held_by.begins(self, self._holder)
            self.app = self.config.loaded_app if self._counted else self._turned_away
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """The bytes of a body are counted elsewhere."""
        self._overhead_bytes = 0
        super().on_body(body)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        if self._busy and self.cycle.response_complete and not self.transport.is_closing():
            self._busy = False
            self.held_by.rests(self, self._holder, counted=self._counted)
            self._counted = False
            self._await_head()

    def send_400_response(self, msg: str) -> None:
        """Answer what cannot be parsed, unless it was refused already."""
        if not self.transport.is_closing():
            super().send_400_response(msg)

    def pause_writing(self) -> None:
        """The client reads its answer slowly; it must not stop reading."""
        super().pause_writing()
        self._watch_answer(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """The client has read most of the answer."""
        super().resume_writing()
        if self._unread_timer is not None:
            self._unread_timer.cancel()

    def _watch_answer(self, size: int) -> None:
        def look() -> None:
            unread = self.transport.get_write_buffer_size()
            if unread >= size:
                self.transport.abort()
            else:
                self._watch_answer(unread)

        self._unread_timer = self.loop.call_later(UNREAD_S, look)

    def _await_head(self) -> None:
        self._head_timer = self.loop.call_later(self.held_by.head_timeout_s, self._give_up)

    def _give_up(self) -> None:
        if self.transport.is_closing():
            return
        if self._overhead_bytes:
            within_s = self.held_by.head_timeout_s
            self._refuse(SlowClientError, f"The head of the request was not whole within {within_s:g} s.")
        else:
            self.transport.close()

    def _refuse(self, error: type[ServiceError], detail: str = "") -> None:
        kind = KINDS[error]
        body = problem_document(kind, detail or kind.meaning, instance="").model_dump_json().encode()
        head = f"HTTP/1.1 {kind.status} {kind.title}\r\ncontent-type: {PROBLEM_JSON}\r\nconnection: close\r\n"
        self.transport.write(f"{head}content-length: {len(body)}\r\n\r\n".encode() + body)
        self.transport.close()

    async def _turned_away(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] in FOR_PROBES:
            await self.config.loaded_app(scope, receive, send)
            return
        message = "As many connections as one client may have are at work already. Try again in a moment."
        await refuse(BusyError(message), scope, receive, send, Connection="close")


class _RefusedError(Exception):
    """Ends the parsing of what was refused."""


def _as_files_allow(wanted: int) -> int:
    """The connections wanted, or as many as the process may open files; its limit is raised to the system's first."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    beside = OWN_FILES + SPARE
    if soft != resource.RLIM_INFINITY and soft < wanted + beside:
        within = wanted + beside if hard == resource.RLIM_INFINITY else min(hard, wanted + beside)
        resource.setrlimit(resource.RLIMIT_NOFILE, (within, hard))
        soft = within
    return wanted if soft == resource.RLIM_INFINITY else max(1, min(wanted, soft - beside))
