"""How long a service takes to answer: single requests, again and again, from a process of their own.

Its own, because whoever makes a load waits for himself: in one program what is measured would stand behind what loads.
"""

from __future__ import annotations

import http.client
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Answers:
    """What one route answered, in the order of asking."""

    route: str
    took_ms: list[float]
    statuses: list[str]
    """A number of HTTP, or the name of an error."""

    @property
    def median_ms(self) -> float:
        """Half of the answers took no longer."""
        return float(np.median(self.took_ms)) if self.took_ms else float("nan")

    @property
    def p99_ms(self) -> float:
        """Of a hundred answers ninety-nine took no longer."""
        return float(np.quantile(self.took_ms, 0.99)) if self.took_ms else float("nan")

    @property
    def max_ms(self) -> float:
        """No answer took longer."""
        return max(self.took_ms, default=float("nan"))

    @property
    def unlike_2xx(self) -> dict[str, int]:
        """How often each other status came."""
        return dict(Counter(status for status in self.statuses if not status.startswith("2")))


@dataclass(frozen=True)
class Probes:
    """A running prober's notes."""

    routes: Sequence[str]
    notes: Path

    def between(self, begin_s: float, end_s: float) -> list[Answers]:
        """What was asked for in that time (Unix seconds), by route."""
        lines = [line.split() for line in self.notes.read_text().splitlines()]
        answers = [
            (int(k), float(ms), status) for k, at, ms, status in lines if begin_s <= float(at) <= end_s
        ]
        return [
            Answers(
                route, [ms for k, ms, _ in answers if k == n], [status for k, _, status in answers if k == n]
            )
            for n, route in enumerate(self.routes)
        ]


@contextmanager
def probing(port: int, routes: Sequence[str], notes: Path, every_s: float = 0.1) -> Iterator[Probes]:
    """Ask for every route so often until the block ends, each in a thread: none waits for another's answer."""
    command = [sys.executable, __file__, str(port), str(every_s), str(notes), *routes]
    process = subprocess.Popen(command)
    try:
        yield Probes(routes, notes)
    finally:
        process.kill()
        process.wait()


def main() -> None:
    """What ``probing`` starts."""
    port, every_s, notes, *routes = sys.argv[1:]
    sys.setswitchinterval(0.0005)  # the threads hardly compute: none is to wait for another's turn
    # Lines are shorter than what the system writes whole.
    with Path(notes).open("a", buffering=1) as file:
        asking = [
            threading.Thread(target=_ask, args=(file, int(port), route, number, float(every_s)), daemon=True)
            for number, route in enumerate(routes)
        ]
        for thread in asking:
            thread.start()
        for thread in asking:
            thread.join()


def _ask(file: object, port: int, route: str, number: int, every_s: float) -> None:
    due = time.monotonic()
    while True:
        at, start = time.time(), time.perf_counter()
        status = _status(port, route)
        took_ms = 1000 * (time.perf_counter() - start)
        print(number, f"{at:.3f}", f"{took_ms:.2f}", status, file=file)  # type: ignore[call-overload]
        due = max(due + every_s, time.monotonic())
        time.sleep(due - time.monotonic() if due > time.monotonic() else 0.0)


def _status(port: int, route: str) -> str:
    """The status of one request on a connection of its own, as balancers ask."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    try:
        connection.request("GET", route)
        answer = connection.getresponse()
        answer.read()
        return str(answer.status)
    except (OSError, http.client.HTTPException) as error:
        return type(error).__name__
    finally:
        connection.close()


if __name__ == "__main__":
    main()
