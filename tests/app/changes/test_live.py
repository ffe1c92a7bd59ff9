"""Who has the map open is told at once what changed, and where."""

from __future__ import annotations

import asyncio
import json
import time
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import psycopg
import pytest

from app.changes import routes
from app.changes.routes import Change, Live
from app.core.db import Bounds
from app.core.errors import BusyError
from app.core.receiving.clients import Shares
from web_fixtures import Web


def events(answer: httpx.Response) -> Iterator[dict[str, Any]]:
    lines = answer.iter_lines()
    for line in lines:
        if line == "event: change":
            yield json.loads(next(lines).removeprefix("data: "))


def test_a_published_drive_is_told_with_its_place(filled: Web, drive_maker: Callable[..., uuid.UUID]) -> None:
    with filled.client.stream("GET", "/v1/changes/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        said = events(answer)
        first = next(said)
        assert first["bbox"] is None
        drive_maker(filled.sessions, [0, 1])
        published = time.monotonic()
        change = next(said)
        assert time.monotonic() - published < 3
        assert change["version"] != first["version"]
        west, south, east, north = change["bbox"]
        assert [8.3, 48.9] <= [west, south] <= [8.4, 49.0]
        assert [8.402, 49.0] <= [east, north] <= [8.5, 49.1]
    with filled.client.stream("GET", "/v1/changes/events") as answer:
        again = next(events(answer))
    # Pieces of low zooms may have followed meanwhile; nothing else has happened.
    assert again["version"].split(".")[:2] == change["version"].split(".")[:2]


class Map:
    """A map whose versions are given."""

    def __init__(self, *versions: str | Exception) -> None:
        self.versions = list(versions)
        self.box: Bounds | None = (1.0, 2.0, 3.0, 4.0)

    async def version(self) -> str:
        said = self.versions.pop(0) if len(self.versions) > 1 else self.versions[0]
        if isinstance(said, Exception):
            raise said
        return said

    def take_box(self) -> Bounds | None:
        return self.box


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "LOOK_EVERY_S", 0.01)
    monkeypatch.setattr(routes, "AGAIN_S", 0.01)


def test_a_database_that_does_not_answer_is_asked_again() -> None:
    async def told() -> Change | None:
        follows = Live(Map(psycopg.OperationalError("gone"), ValueError("odd"), "a"), Shares(1, 1))
        follower = follows.follow()
        running = asyncio.create_task(follows.run())
        try:
            return await follower.next(within_s=5)
        finally:
            running.cancel()

    assert asyncio.run(told()) == Change("a", (1.0, 2.0, 3.0, 4.0))


def test_who_is_slow_gets_several_changes_as_one() -> None:
    async def told() -> list[Change | None]:
        follower = Live(Map("a"), Shares(1, 1)).follow()
        follower.tell(Change("a", (1, 2, 3, 4)))
        follower.tell(Change("b", (0, 3, 2, 5)))
        found = [await follower.next(within_s=1), await follower.next(within_s=0.01)]
        follower.tell(Change("c", (1, 2, 3, 4)))
        follower.tell(Change("d", None))
        return [*found, await follower.next(within_s=1)]

    assert asyncio.run(told()) == [Change("b", (0, 2, 3, 5)), None, Change("d", None)]


def test_too_many_are_refused_until_one_leaves() -> None:
    async def follow() -> None:
        follows = Live(Map("a"), Shares(1, 1))
        first = follows.follow()
        with pytest.raises(BusyError, match="1 event streams are open already"):
            follows.follow()
        follows.leave(first)
        follows.leave(first)
        follows.leave(follows.follow())
        assert len(follows) == 0

    asyncio.run(follow())
