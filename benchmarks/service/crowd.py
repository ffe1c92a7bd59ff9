"""Many clients at once: some follow a drive, some ask and wait, some ask and leave."""

from __future__ import annotations

import selectors
import socket
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import httpx

PATIENCE_S = 120.0
LOOK_EVERY_S = 0.2


@dataclass
class Stream:
    """One connection on which events come."""

    socket: socket.socket
    status: str = ""
    """As far as anything came."""
    events: int = 0
    open: bool = True


@dataclass
class Streams:
    """Clients that follow one drive until they are closed."""

    members: list[Stream]
    most_at_once: int = 0
    _selector: selectors.BaseSelector = field(default_factory=selectors.DefaultSelector)

    @property
    def statuses(self) -> dict[str, int]:
        """How often each was answered."""
        return dict(Counter(stream.status or "none" for stream in self.members))

    @property
    def fewest_events(self) -> int:
        """Events on the stream that received fewest, of those that were accepted."""
        return min((s.events for s in self.members if s.status == "200"), default=0)

    def listen(self, over: threading.Event) -> None:
        """Read what comes."""
        for stream in self.members:
            stream.socket.setblocking(False)
            self._selector.register(stream.socket, selectors.EVENT_READ, stream)
        while not over.is_set():
            for key, _ in self._selector.select(LOOK_EVERY_S):
                self._hear(key.data)
            self.most_at_once = max(
                self.most_at_once, sum(s.open and s.status == "200" for s in self.members)
            )

    def _hear(self, stream: Stream) -> None:
        try:
            piece = stream.socket.recv(1 << 20)
        except OSError:
            piece = b""
        if not stream.status and piece.startswith(b"HTTP/1.1 "):
            stream.status = piece[9:12].decode()
        stream.events += piece.count(b"event: drive")
        if not piece:
            stream.open = False
            self._selector.unregister(stream.socket)


@contextmanager
def following(port: int, path: str, count: int) -> Iterator[Streams]:
    """So many connections that follow events, opened one right after the other, until the block ends."""
    streams, over = Streams([Stream(_send_request(port, path)) for _ in range(count)]), threading.Event()
    thread = threading.Thread(target=streams.listen, args=(over,))
    thread.start()
    try:
        yield streams
    finally:
        over.set()
        thread.join()
        for stream in streams.members:
            stream.socket.close()


def ask_and_leave(port: int, paths: Iterable[str], after_s: float) -> None:
    """Ask for all of these at once and go away."""
    sockets = [_send_request(port, path) for path in paths]
    threading.Event().wait(after_s)
    for one in sockets:
        one.close()


class Asked:
    """Requests that are on their way all at once, each in a thread."""

    def __init__(self, address: str, requests: Sequence[tuple[str, str]]) -> None:
        """Of methods and paths."""
        self.statuses: dict[str, Counter[str]] = {method: Counter() for method, _ in requests}
        limits = httpx.Limits(max_connections=len(requests))
        self._client = httpx.Client(base_url=address, timeout=PATIENCE_S, trust_env=False, limits=limits)
        self._threads = [threading.Thread(target=self._ask, args=request) for request in requests]
        for thread in self._threads:
            thread.start()

    def await_all(self) -> dict[str, dict[str, int]]:
        """How often each status came, by method."""
        for thread in self._threads:
            thread.join()
        self._client.close()
        return {method: dict(statuses) for method, statuses in self.statuses.items()}

    def _ask(self, method: str, path: str) -> None:
        try:
            status = str(self._client.request(method, path).status_code)
        except httpx.HTTPError as error:
            status = type(error).__name__
        self.statuses[method][status] += 1


def _send_request(port: int, path: str) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port))
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    return connection
