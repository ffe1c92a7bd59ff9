"""A way to the database that loses the answer to a COMMIT, as a network does."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

COMMIT = b"COMMIT\0"


class LossyWay:
    """Passes everything between clients and the server on until the first COMMIT, whose client is cut off.

    ``arrives`` False: the server does not get that COMMIT. ``late_s``: it gets it so long after the client was cut off.
    ``unnoticed``: it does not get it, nor learns that the client is gone. ``for_good``: nobody gets through afterwards.
    """

    def __init__(self, server: str, folder: Path, **how: Any) -> None:
        self._server = server
        self._arrives, self._late_s = how.get("arrives", True), how.get("late_s", 0.0)
        self._unnoticed, self._for_good = how.get("unnoticed", False), how.get("for_good", False)
        self._muted: socket.socket | None = None
        self._over = threading.Event()
        self.lost = 0
        self._open = True
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(folder / Path(server).name))
        self._listener.listen()
        self._ways: list[threading.Thread] = []
        self._start(self._accept)

    def _start(self, work: object, *values: object) -> None:
        thread = threading.Thread(target=work, args=values, daemon=True)  # type: ignore[arg-type]
        self._ways.append(thread)
        thread.start()

    def _accept(self) -> None:
        while self._open:
            try:
                client = self._listener.accept()[0]
            except OSError:
                return
            if not self._open or (self.lost and self._for_good):
                client.close()
                continue
            server = socket.socket(socket.AF_UNIX)
            server.connect(self._server)
            self._start(self._forward, client, server)
            self._start(self._back, server, client)

    def _forward(self, client: socket.socket, server: socket.socket) -> None:
        with client, server:
            while data := _received(client):
                if COMMIT in data and not self.lost:
                    self.lost += 1
                    self._lose(client, server, data)
                    break
                server.sendall(data)
            with contextlib.suppress(OSError):  # else the other thread's reading would keep it open
                server.shutdown(socket.SHUT_RDWR)

    def _lose(self, client: socket.socket, server: socket.socket, commit: bytes) -> None:
        self._muted = server
        if self._late_s or self._unnoticed:
            client.shutdown(socket.SHUT_RDWR)
            self._over.wait(60 if self._unnoticed else self._late_s)
        if self._arrives and not self._unnoticed:
            server.sendall(commit)
            self._over.wait(
                0.2
            )  # until the server has read it: it drops what comes with the end of a connection
        with contextlib.suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)

    def _back(self, server: socket.socket, client: socket.socket) -> None:
        while data := _received(server):
            if self._muted is server:
                continue
            with contextlib.suppress(OSError):
                client.sendall(data)

    def close(self) -> None:
        """Let nobody through any more."""
        self._open = False
        self._over.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for way in self._ways:
            way.join(timeout=10)


def _received(way: socket.socket) -> bytes:
    try:
        return way.recv(65536)
    except OSError:
        return b""


@contextlib.contextmanager
def lossy_way(url: str, folder: Path, **how: Any) -> Iterator[tuple[str, LossyWay]]:
    """The database's URL by a lossy way through a socket in ``folder``, and the way."""
    parts = urlsplit(url)
    host, port = (parse_qs(parts.query)[name][0] for name in ("host", "port"))
    way = LossyWay(f"{host}/.s.PGSQL.{port}", folder, **how)
    try:
        yield parts._replace(query=f"host={quote(str(folder))}&port={port}").geturl(), way
    finally:
        way.close()
