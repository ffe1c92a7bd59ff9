"""A client that asks for ordinary things at an ordinary pace, and notes how it is served."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

TIMEOUT_S = 10.0
AGAIN_S = 1.0
"""Before an upload is sent again that was not taken."""
UPLOAD_EVERY_S, ASK_EVERY_S = 4.0, 0.25
TAKEN = {200, 202}
ITEMS = "/collections/segments/items"


@dataclass(frozen=True)
class Answer:
    """When one request was sent (s, monotonic), how long it took, and its status; 0: there was no answer."""

    at_s: float
    took_s: float
    status: int

    @property
    def turned_away(self) -> bool:
        """Whether the service was not there for it."""
        return self.status in {0, 503}


@dataclass(frozen=True)
class Served:
    """How requests of one kind were served."""

    requests: int
    p50_s: float
    p99_s: float
    max_s: float
    turned_away: int
    longest_away_s: float
    """The longest time in which every one of them was answered by 503, or not at all."""
    statuses: Mapping[str, int]


def served(answers: Sequence[Answer], ended_s: float) -> Served:
    """Summarise the answers to one kind, in the order of asking, until ``ended_s`` (s, monotonic)."""
    took = np.array([answer.took_s for answer in answers] or [np.nan])
    return Served(
        len(answers),
        float(np.quantile(took, 0.5)),
        float(np.quantile(took, 0.99)),
        float(took.max()),
        turned_away=sum(answer.turned_away for answer in answers),
        longest_away_s=longest_away(answers, ended_s),
        statuses=dict(Counter(str(answer.status or "none") for answer in answers)),
    )


def longest_away(answers: Sequence[Answer], ended_s: float) -> float:
    """From the first of a row of requests that were turned away to the answer of the next that was not, s."""
    longest, since = 0.0, None
    for answer in answers:
        if answer.turned_away:
            since = answer.at_s if since is None else since
        elif since is not None:
            longest, since = max(longest, answer.at_s + answer.took_s - since), None
    return longest if since is None else max(longest, ended_s - since)


@dataclass
class Client:
    """What it asks of the service on ``port``, and what it was told. Threads share it."""

    port: int
    bbox: str
    tile: str
    logs: Iterator[bytes]
    """No two alike."""
    answers: dict[str, list[Answer]] = field(default_factory=dict)
    drives: list[str] = field(default_factory=list)
    """Those that the service took."""
    over: threading.Event = field(default_factory=threading.Event)

    def results(self) -> dict[str, Served]:
        """By kind."""
        ended_s = time.monotonic()
        return {kind: served(answers, ended_s) for kind, answers in self.answers.items()}

    def ask(
        self, kind: str, method: str, path: str, body: bytes | None = None, *, events: bool = False
    ) -> tuple[int, bytes]:
        """One request on a connection of its own, noted; status 0 where none came in time."""
        began = time.monotonic()
        status, document = request(self.port, method, path, body, events=events)
        self.answers.setdefault(kind, []).append(Answer(began, time.monotonic() - began, status))
        return status, document

    def acts(self) -> dict[Callable[[], object], float]:
        """What it does, and the seconds between two of them."""
        line = json.dumps(
            {
                "range": True,
                "shape": [dict(zip(("lon", "lat"), map(float, at), strict=True)) for at in self._corners()],
            }
        )
        requests: dict[str, Callable[[], object]] = {
            "healthz": lambda: self.ask("healthz", "GET", "/healthz"),
            "readyz": lambda: self.ask("readyz", "GET", "/readyz"),
            "items": lambda: self.ask("items", "GET", f"{ITEMS}?bbox={self.bbox}&limit=20"),
            "filter": lambda: self.ask("filter", "GET", f"{ITEMS}?filter=slope_percent%20%3E%202&limit=20"),
            "tile": lambda: self.ask("tile", "GET", f"/tiles/{self.tile}.mvt"),
            "drives": lambda: self.ask("drives", "GET", "/v1/drives?limit=10"),
            # In the lane of changes, and changes nothing.
            "post": lambda: self.ask("post", "POST", "/height", line.encode()),
            "events": self._follow,
        }  # fmt: skip
        return {**dict.fromkeys(requests.values(), ASK_EVERY_S), self._upload: UPLOAD_EVERY_S}

    def _corners(self) -> list[list[str]]:
        west, south, east, north = self.bbox.split(",")
        return [[west, south], [east, north]]

    def _upload(self) -> None:
        if (log := next(self.logs, None)) is None:
            return
        while not self.over.is_set():
            status, document = self.ask("upload", "POST", "/v1/drives", log)
            if status in TAKEN:
                self.drives.append(json.loads(document)["id"])
                return
            self.over.wait(AGAIN_S)

    def _follow(self) -> None:
        if self.drives:
            self.ask("events", "GET", f"/v1/drives/{self.drives[-1]}/events", events=True)


@contextmanager
def working(client: Client) -> Iterator[None]:
    """Let it work until the block ends; each thing in a thread, so that none waits for another."""

    def repeat(act: Callable[[], object], every_s: float) -> None:
        due = time.monotonic()
        while not client.over.is_set():
            act()
            due = max(due + every_s, time.monotonic())
            client.over.wait(due - time.monotonic())

    threads = [threading.Thread(target=repeat, args=item, daemon=True) for item in client.acts().items()]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        client.over.set()
        for thread in threads:
            thread.join(TIMEOUT_S + AGAIN_S)


def request(
    port: int, method: str, path: str, body: bytes | None = None, *, events: bool = False
) -> tuple[int, bytes]:
    """Status and body; of an event stream its first line alone. (0, b"") without an answer in ``TIMEOUT_S``."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    headers = {"Content-Type": "application/json"} if path == "/height" else {}
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.readline() if events else answer.read()
    except (OSError, http.client.HTTPException):
        return 0, b""
    finally:
        connection.close()
