"""Tells those who have the map open that it has changed, and where: one look for all of them. Knows no HTTP, no tiles.

A map that is told fetches anew what it shows there. A slow follower gets several changes as one.
"""

from __future__ import annotations

import asyncio
import logging
from typing import NamedTuple, Protocol

import psycopg

from app.core.db import Bounds
from app.core.receiving.clients import Shares
from app.core.receiving.sse import Follower, Followers

LOOK_EVERY_S = 0.5
AGAIN_S = 2.0
"""After a look that failed."""
_MAP = "map"  # the one topic

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


def join_changes(former: Change, later: Change) -> Change:
    """Two changes as one."""
    one, other = former.box, later.box
    if one is None or other is None:
        return Change(later.version, None)
    west, south, east, north = zip(one, other, strict=True)
    return Change(later.version, (min(west), min(south), max(east), max(north)))


class Live:
    """The followers of a process. Lives in its event loop."""

    def __init__(self, watched: WatchedMap, streams: Shares) -> None:
        self._watched = watched
        self._followers = Followers[str, Change](
            streams, "Ask GET /v1/changes every few seconds", join_changes
        )
        self._somebody = asyncio.Event()
        self._version = ""

    def __len__(self) -> int:
        """How many follow."""
        return len(self._followers)

    async def version(self) -> str:
        """Of the map as of now; raises what the database says."""
        return await self._watched.version()

    def follow(self) -> Follower[str, Change]:
        """A new follower; ``BusyError`` where there are too many."""
        follower = self._followers.add(_MAP)
        self._somebody.set()
        return follower

    def leave(self, follower: Follower[str, Change]) -> None:
        """Follow no longer."""
        self._followers.leave(follower)
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
        for follower in self._followers.of({_MAP}):
            follower.tell(change)
