"""Tells those who have the map open that it changed, and where: one look for all of them. Knows no HTTP and no tiles.

What is told is only that one has to fetch anew what one shows there. Who is slow gets several changes as one.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from typing import NamedTuple, Protocol

import psycopg

from app.core.db import Bounds
from app.core.errors import BusyError
from app.core.receiving.clients import Shares, present_client

LOOK_EVERY_S = 0.5
AGAIN_S = 2.0
"""After a look that failed."""

log = logging.getLogger(__name__)


class WatchedMap(Protocol):
    """What is looked at."""

    async def version(self) -> str:
        """Of the map as of now; raises what the database says."""

    def take_box(self) -> Bounds | None:
        """Where anything changed since this was asked last, in degrees; None: it may be anywhere."""


class Change(NamedTuple):
    """The map has this version since something changed in the box; None: it may be anywhere, or nowhere."""

    version: str
    box: Bounds | None


class Follower:
    """One who has the map open."""

    def __init__(self, client: str) -> None:
        self.client = client
        self._change: Change | None = None
        self._news = asyncio.Event()

    async def next(self, within_s: float) -> Change | None:
        """What changed since the last answer; None where nothing did in time."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._news.wait()
        self._news.clear()
        change, self._change = self._change, None
        return change

    def tell(self, change: Change) -> None:
        """Together with what was not taken yet."""
        before = self._change
        self._change = change if before is None else Change(change.version, _joined(before.box, change.box))
        self._news.set()


class Live:
    """The followers of a process. Lives in its event loop."""

    def __init__(self, watched: WatchedMap, streams: Shares) -> None:
        self._watched = watched
        self._streams = streams
        self._followers: set[Follower] = set()
        self._somebody = asyncio.Event()
        self._version = ""

    def __len__(self) -> int:
        """How many follow."""
        return len(self._followers)

    async def version(self) -> str:
        """Of the map as of now; raises what the database says."""
        return await self._watched.version()

    def follow(self) -> Follower:
        """A new follower; ``BusyError`` where there are too many."""
        client = present_client()
        if not self._streams.allows(client):
            raise BusyError(
                f"{self._streams.total} event streams are open already, {self._streams.held[client]} of them yours. "
                "Ask GET /v1/changes every few seconds, or try again in a moment."
            )
        self._streams.take(client)
        follower = Follower(client)
        self._followers.add(follower)
        self._somebody.set()
        return follower

    def leave(self, follower: Follower) -> None:
        """Follow no longer."""
        if follower in self._followers:
            self._followers.remove(follower)
            self._streams.give_back(follower.client)
        if not self._followers:
            self._somebody.clear()

    async def run(self) -> None:
        """Look as long as anybody follows, until cancelled."""
        while True:
            await self._somebody.wait()
            try:
                await self._look()
            except (psycopg.Error, OSError) as error:
                log.debug("the map is not looked at for now: %s", type(error).__name__)
                await asyncio.sleep(AGAIN_S)
            except Exception:  # without this loop nobody is told anything any more
                log.exception("the map cannot be looked at")
                await asyncio.sleep(AGAIN_S)
            await asyncio.sleep(LOOK_EVERY_S)

    async def _look(self) -> None:
        version = await self._watched.version()
        if version == self._version:
            return
        self._version, change = version, Change(version, self._watched.take_box())
        for follower in self._followers:
            follower.tell(change)


def _joined(one: Bounds | None, other: Bounds | None) -> Bounds | None:
    if one is None or other is None:
        return None
    return (min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3]))
