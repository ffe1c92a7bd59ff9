"""What tests of a service under load share: statements that last, clients that come and go, and waiting for a state."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import Any
from urllib.parse import urlsplit

import httpx
from sqlalchemy import text

from web_fixtures import TLS

WAIT_S = 30.0
"""Far longer than anything that is waited for takes."""

_RUNNING = text(
    """
    SELECT count(*) FROM pg_stat_activity
    WHERE state = 'active' AND query LIKE '%pg_sleep%' AND pid <> pg_backend_pid() AND datname = current_database()
    """
)


def sleep(session: Any, *_: object, **__: object) -> Any:
    """In place of a function of a store: a statement that lasts longer than a test."""
    session.execute(text("SELECT pg_sleep(120)"))


async def sleep_in_loop(connection: Any, *_: object, **__: object) -> Any:
    """The same in place of a function that the event loop runs."""
    await connection.execute("SELECT pg_sleep(120)")


def sleeping(web: Any) -> int:
    """How many of those statements run."""
    with web.sessions() as session:
        return int(session.execute(_RUNNING).scalar_one())


def wait_until(holds: Callable[[], bool], within_s: float = WAIT_S) -> None:
    pause = threading.Event()
    for _ in range(int(within_s / 0.02)):
        if holds():
            return
        pause.wait(0.02)
    raise AssertionError("it did not come about")


@contextmanager
def connected(web: Any, path: str) -> Iterator[socket.socket]:
    """A client that asked and reads nothing; it is gone at the end of the block."""
    place = urlsplit(web.base)
    with socket.create_connection((place.hostname, place.port)) as client:
        client.sendall(f"GET {path} HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
        yield client


@contextmanager
def asked_at_once(web: Any, paths: list[str]) -> Iterator[list[Future[int]]]:
    """Ask for all of these at once, beside what the block does; the statuses of the answers to come."""

    def ask(path: str) -> int:
        return httpx.get(web.base + path, timeout=WAIT_S * 2, trust_env=False, verify=TLS).status_code

    with ThreadPoolExecutor(len(paths)) as clients:
        yield [clients.submit(ask, path) for path in paths]


class Gate:
    """A function of a store that waits until the gate is opened, and how many wait there."""

    def __init__(self, answer: Callable[..., Any]) -> None:
        self.open = threading.Event()
        self.inside = 0
        self.most = 0
        self._answer = answer
        self._lock = threading.Lock()

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        self._enter()
        assert self.open.wait(WAIT_S)
        with self._lock:
            self.inside -= 1
        return self._answer(*arguments, **options)

    async def waited_for(self, *arguments: Any, **options: Any) -> Any:
        """The same in place of a function that the event loop runs."""
        self._enter()
        async with asyncio.timeout(WAIT_S):
            while not self.open.is_set():
                await asyncio.sleep(0.01)
        with self._lock:
            self.inside -= 1
        return self._answer(*arguments, **options)

    def _enter(self) -> None:
        with self._lock:
            self.inside += 1
            self.most = max(self.most, self.inside)


@contextmanager
def holding(
    web: Any, sent: bytes, number: int = 1, client: str = "127.0.0.1"
) -> Iterator[list[socket.socket]]:
    """So many connections from an address of this machine that have sent this and no more; closed after the block."""
    place = urlsplit(web.base)
    with ExitStack() as held:
        sockets = []
        for _ in range(number):
            address = (str(place.hostname), int(place.port or 80))
            one = held.enter_context(socket.create_connection(address, WAIT_S, (client, 0)))
            with suppress(OSError):  # it may have been turned away
                one.sendall(sent)
            sockets.append(one)
        yield sockets


def answered(client: socket.socket) -> bytes:
    """All that comes until the service closes the connection."""
    pieces = []
    with suppress(ConnectionError):
        while piece := client.recv(65536):
            pieces.append(piece)
    return b"".join(pieces)


@contextmanager
def asking_from(web: Any, client: str) -> Iterator[httpx.Client]:
    """A client with this address of the machine."""
    transport = httpx.HTTPTransport(local_address=client, verify=TLS)
    with httpx.Client(base_url=web.base, transport=transport, timeout=WAIT_S, trust_env=False) as asking:
        yield asking
