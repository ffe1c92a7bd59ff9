"""Clients that cost little: each a process with one connection that is kept, which asks, waits and asks again."""

from __future__ import annotations

import gzip
import itertools
import multiprocessing
import socket
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

PATIENCE_S = 60.0
_READ = 1 << 18


@dataclass(frozen=True)
class Rates:
    """What clients got together."""

    requests: int
    seconds: float
    took_ms: np.ndarray
    size_bytes: int
    statuses: dict[int, int]

    @property
    def per_second(self) -> float:
        """Requests a second."""
        return self.requests / self.seconds

    @property
    def p95_ms(self) -> float:
        """Of a hundred answers ninety-five took no longer."""
        return float(np.quantile(self.took_ms, 0.95)) if self.requests else float("nan")

    @property
    def mean_bytes(self) -> float:
        """Of a body as it was sent."""
        return self.size_bytes / max(self.requests, 1)


@dataclass(frozen=True)
class Asked:
    """A path, and the tag that the client has of it."""

    path: str
    etag: str | None = None


def ask(
    port: int,
    requests: Sequence[Asked],
    *,
    seconds: float | None = None,
    clients: int = 2,
    compressed: bool = True,
) -> Rates:
    """Ask for all of it, each once and shared out among the clients, or again and again for so many ``seconds``."""
    context = multiprocessing.get_context("fork")
    results = context.SimpleQueue()
    barrier = context.Barrier(clients)
    work = [
        context.Process(
            target=_client,
            args=(port, requests[n::clients], seconds, compressed, barrier, results),
            daemon=True,
        )
        for n in range(clients)
    ]
    for one in work:
        one.start()
    answers = [results.get() for _ in work]
    for one in work:
        one.join()
    took = np.concatenate([np.array(times) for _, _, times, _, _ in answers])
    began, ended = min(b for b, *_ in answers), max(e for _, e, *_ in answers)
    statuses = sum((Counter(s) for *_, s in answers), Counter[int]())
    return Rates(len(took), ended - began, took * 1e3, sum(size for *_, size, _ in answers), dict(statuses))


def tags_of(port: int, paths: Sequence[str]) -> list[Asked]:
    """Each path with the tag of its present answer."""
    with Connection(port, compressed=True) as connection:
        return [Asked(path, connection.get(Asked(path)).etag) for path in paths]


@dataclass(frozen=True)
class Answer:
    """What came back."""

    status: int
    etag: str | None
    body: bytes


class Connection:
    """One kept connection, HTTP/1.1, of which only what is needed is read."""

    def __init__(self, port: int, *, compressed: bool) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""
        encoding = "Accept-Encoding: gzip\r\n" if compressed else ""
        self._fixed = f" HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{encoding}"

    def __enter__(self) -> Connection:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def get(self, request: Asked) -> Answer:
        """The answer to one request."""
        match = "" if request.etag is None else f"If-None-Match: {request.etag}\r\n"
        self._socket.sendall(f"GET {request.path}{self._fixed}{match}\r\n".encode())
        head = self._until(b"\r\n\r\n").decode("latin-1")
        first, *lines = head.split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        status = int(first.split(" ", 2)[1])
        if "content-length" in headers:
            body = self._exactly(int(headers["content-length"]))
        elif headers.get("transfer-encoding") == "chunked":
            body = self._chunks()
        else:
            body = b""
        if headers.get("content-encoding") == "gzip" and not body.startswith(b"\x1f\x8b"):
            raise ValueError(f"{request.path}: a body that is called gzip and is not")
        return Answer(status, headers.get("etag"), body)

    def _until(self, end: bytes) -> bytes:
        while end not in self._rest:
            self._rest += self._received()
        part, _, self._rest = self._rest.partition(end)
        return part

    def _exactly(self, size: int) -> bytes:
        parts, left = [self._rest[:size]], size - len(self._rest)
        self._rest = self._rest[size:]
        while left > 0:
            part = self._received()
            parts.append(part[:left])
            if len(part) > left:
                self._rest = part[left:]
            left -= len(part)
        return b"".join(parts)

    def _chunks(self) -> bytes:
        body = b""
        while size := int(self._until(b"\r\n"), 16):
            body += self._exactly(size)
            self._exactly(2)
        self._exactly(2)
        return body

    def _received(self) -> bytes:
        part = self._socket.recv(_READ)
        if not part:
            raise ConnectionError("the server closed the connection")
        return part


def plain(body: bytes) -> bytes:
    """A body without its compression."""
    return gzip.decompress(body) if body.startswith(b"\x1f\x8b") else body


def _client(port, requests, seconds, compressed, barrier, results) -> None:  # type: ignore[no-untyped-def]
    took: list[float] = []
    size, statuses = 0, Counter[int]()
    with Connection(port, compressed=compressed) as connection:
        barrier.wait()
        began = last = time.monotonic()
        for one in requests if seconds is None else itertools.cycle(requests):
            answer = connection.get(one)
            now = time.monotonic()
            took.append(now - last)
            last = now
            size += len(answer.body)
            statuses[answer.status] += 1
            if seconds is not None and now - began > seconds:
                break
    results.put((began, last, took, size, dict(statuses)))
