"""The attacks, each a function that goes on until its time is over. Run as a process of its own, which prints what
became of its requests:

    PYTHONPATH=.:benchmarks python -m hostile.attempts NAME PORT SOURCE SECONDS FOLDER

``SOURCE`` is the loopback address that it comes from. Only 127.0.0.1 is attacked. A refusal is no error: it is what
the service is to answer.
"""

from __future__ import annotations

import http.client
import json
import resource
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from urllib.parse import quote

from hostile import inputs

TARGET = "127.0.0.1"
PATIENCE_S = 15.0
PAUSE_S = 0.05
"""Between two requests of one connection: an attacker without it would be the machine's other load."""
FILTERING, FOLLOWING, HALVES, IDLERS, HEADS = 210, 800, 1100, 40, 4
EVERY_S = 4.0
"""Between two large inputs."""
HEAD_PIECE = b"".join(b"X-%04d: %s\r\n" % (k, b"a" * 1000) for k in range(100))
SLOW_FILTERS = (
    inputs.MODULO,
    " OR ".join(f"CASEI(name) LIKE CASEI('%{'_%' * 20}{k}%')" for k in range(12)),
    "(" * 25 + "slope_percent + length_m * 2 > 3" + ")" * 25,
    "S_INTERSECTS(geometry, POLYGON(("
    + ", ".join(f"{8 + k / 500} {49 + (k % 2) / 3}" for k in range(300))
    + ", 8 49)))",
)


class Attack:
    """One attacker: whom, from where, for how long; and what it was answered."""

    def __init__(self, port: int, source: str, seconds: float, folder: Path) -> None:
        self.port, self.source, self.folder = port, source, folder
        self.ends_s = time.monotonic() + seconds
        self.outcomes: Counter[str] = Counter()

    @property
    def left_s(self) -> float:
        """How long it still goes on."""
        return max(self.ends_s - time.monotonic(), 0.0)

    def prepared(self, make: Callable[[], bytes]) -> bytes:
        """What an attack sends; the time that it takes to make it is not the attack's."""
        began = time.monotonic()
        connection = make()
        self.ends_s += time.monotonic() - began
        return connection

    def ask(self, method: str, path: str, body: bytes | None = None, content_type: str | None = None) -> None:
        """One request; its status is counted."""
        wait_s = min(PATIENCE_S, self.left_s + 0.1)
        connection = http.client.HTTPConnection(TARGET, self.port, wait_s, source_address=(self.source, 0))
        try:
            connection.request(method, path, body, {"Content-Type": content_type} if content_type else {})
            answer = connection.getresponse()
            answer.read()
            self.outcomes[str(answer.status)] += 1
        except (OSError, http.client.HTTPException) as error:
            self.outcomes[type(error).__name__] += 1
        finally:
            connection.close()

    def connect(self) -> socket.socket | None:
        """A connection; None where it is refused."""
        try:
            connection = socket.create_connection((TARGET, self.port), 2.0, (self.source, 0))
        except OSError as error:
            self.outcomes[type(error).__name__] += 1
            return None
        self.outcomes["connected"] += 1
        return connection

    def in_threads(self, count: int, act: Callable[[int], None], pause_s: float = PAUSE_S) -> None:
        """Repeat ``act`` in so many threads until the time is over."""

        def repeat(k: int) -> None:
            while self.left_s:
                act(k)
                time.sleep(min(pause_s, self.left_s))

        threads = [threading.Thread(target=repeat, args=(k,), daemon=True) for k in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(self.left_s + PATIENCE_S)

    def hold(self, count: int, begin: Callable[[int], bytes], more: bytes = b"") -> None:
        """Keep so many connections that have sent ``begin`` and no more, or ``more`` every few seconds; those that the
        service ends are made anew."""
        held: dict[int, socket.socket] = {}
        while self.left_s:
            for k in range(count):
                if not self.left_s:
                    break
                one = held.get(k)
                if one is not None and not _is_open(one, more):
                    self.outcomes["ended by the service"] += 1
                    held.pop(k).close()
                if k not in held and (connection := self.connect()) is not None:
                    held[k] = connection
                    _send(connection, begin(k))
            time.sleep(min(1.0, self.left_s))
        for one in held.values():
            one.close()


def _is_open(one: socket.socket, more: bytes) -> bool:
    one.setblocking(False)
    try:
        if not one.recv(1 << 16):
            return False
    except BlockingIOError:
        pass
    except OSError:
        return False
    return _send(one, more)


def _send(one: socket.socket, data: bytes) -> bool:
    try:
        one.sendall(data)
    except BlockingIOError:  # it reads no more, and holds the connection all the same
        return True
    except OSError:
        return False
    return True


def doubling_filter(attack: Attack) -> None:
    """Number 2: 120 characters whose operands double."""
    attack.in_threads(
        2, lambda _: attack.ask("GET", f"/collections/segments/items?filter={quote(inputs.MODULO)}")
    )


def idle_bodies(attack: Attack) -> None:
    """Number 3: changes of which one byte arrives."""
    head = b"POST %s HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{"
    paths = (b"/v1/exports", b"/height", b"/v1/webhooks", b"/v1/drives")
    attack.hold(IDLERS, lambda k: head % paths[k % len(paths)])


def slow_filters(attack: Attack) -> None:
    """Number 4: 210 connections, each with one slow filter after the other."""

    def act(k: int) -> None:
        slow_filter = quote(SLOW_FILTERS[k % len(SLOW_FILTERS)])
        attack.ask("GET", f"/collections/segments/items?limit=10000&sortby=name&filter={slow_filter}")

    attack.in_threads(FILTERING, act)


def event_streams(attack: Attack) -> None:
    """Number 4: 800 event streams."""
    attack.hold(
        FOLLOWING,
        lambda k: (
            b"GET /v1/changes/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" if k % 2 else _of_drive(attack)
        ),
    )


def _of_drive(attack: Attack) -> bytes:
    drive = (attack.folder / "drive").read_bytes()
    return b"GET /v1/drives/%s/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" % drive


def half_requests(attack: Attack) -> None:
    """Number 4: 1,100 connections with half a head."""
    attack.hold(HALVES, lambda _: b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"X: y\r\n")


def endless_heads(attack: Attack) -> None:
    """Heads of requests that never end, as fast as they are taken."""

    def act(_: int) -> None:
        if (one := attack.connect()) is None:
            return
        with one:
            one.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n")
            try:
                while attack.left_s:
                    one.sendall(HEAD_PIECE)
                    time.sleep(0.002)
            except OSError:
                attack.outcomes["ended by the service"] += 1

    attack.in_threads(HEADS, act)


def sparse_raster(attack: Attack) -> None:
    """Number 7: ten kilobytes that say to be 400,000 x 400,000 posts."""
    body = attack.prepared(lambda: inputs.sparse_raster(attack.folder))

    def act(k: int) -> None:
        name = f"sparse-{time.monotonic_ns()}.tif"
        attack.ask("POST", f"/v1/operations?kind=import-dem&priority=5&filename={name}", body)

    attack.in_threads(1, act, EVERY_S)


def unpacking_bomb(attack: Attack) -> None:
    """Number 7: 3 MB that unpack to 3 GB of heights."""
    body = attack.prepared(inputs.bomb)
    path = "/v1/operations?kind=import-dem&priority=5&filename=N49E008.hgt.gz"
    attack.in_threads(1, lambda _: attack.ask("POST", path, body), EVERY_S)


def many_rows(attack: Attack) -> None:
    """Number 7: a log of three million rows in some 20 MB."""
    attack.ask("POST", "/v1/drives", attack.prepared(inputs.many_rows))
    time.sleep(attack.left_s)


def huge_options(attack: Attack) -> None:
    """Number 7: ten million particles for an ordinary log."""
    log = (attack.folder / "log.csv").read_bytes()

    def act(_: int) -> None:
        unlike = b"#" + str(time.monotonic_ns()).encode() + b"\n"
        attack.ask("POST", "/v1/drives?method=particle&option=particles:10000000", log + unlike)

    attack.in_threads(1, act, EVERY_S)


def copies(attack: Attack) -> None:
    """Hundreds of logs of one short drive that are alike but for their last line."""
    lines = (attack.folder / "log.csv").read_bytes().splitlines(keepends=True)[:25]

    def act(_: int) -> None:
        attack.ask("POST", "/v1/drives", b"".join(lines) + b"#%d\n" % time.monotonic_ns())

    attack.in_threads(1, act)


ATTACKS: Mapping[str, Callable[[Attack], None]] = {
    "doubling filter": doubling_filter,
    "idle bodies": idle_bodies,
    "slow filters": slow_filters,
    "event streams": event_streams,
    "half requests": half_requests,
    "endless heads": endless_heads,
    "sparse raster": sparse_raster,
    "unpacking bomb": unpacking_bomb,
    "many rows": many_rows,
    "huge options": huge_options,
    "copies": copies,
}


def main() -> None:
    """What ``python -m hostile`` starts."""
    name, port, source, seconds, folder = sys.argv[1:]
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    attack = Attack(int(port), source, float(seconds), Path(folder))
    ATTACKS[name](attack)
    print(json.dumps(attack.outcomes))


if __name__ == "__main__":
    main()
