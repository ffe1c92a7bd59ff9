"""Lanes: requests of one kind wait for each other and for nobody else.

All threads and connections are shared, so whatever is slow and asked for often would use them up, and a look at one
drive would wait behind sixty deletions. A kind that can be slow has a lane: so many of it are worked on at once, so
many more wait, without a thread, and all others are told to come again. What has no lane is quick. Which path is of
which kind stands here, sizes in ``make_lanes``.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.errors import BusyError, kind_of
from app.core.middleware import FOR_PROBES, UPLOAD_PATHS
from app.core.problems import problem_response

LONGEST_WAIT_S = 10.0
"""Then a client is better told to come again."""
MOST_WAITING = 200
"""In each lane: a map asks for some sixty tiles at once."""
WIDE_ZOOM = 12
"""Tiles of lower zooms have a lane of their own."""
CHANGES = "changes"
PARTS = "parts"

_KINDS = (
    ("wide tiles", re.compile(r"/tiles/(\d|1[01])/.*|/collections/[^/]+/items")),
    ("tiles", re.compile(r"/tiles/\d+/.*")),
    (
        PARTS,
        re.compile(
            r"/v1/drives/[^/]+/(track|segments)|/v1/segments/[^/]+/observations|/height|/v1/elevation"
        ),
    ),
    ("figures", re.compile(r"/v1/admin/.*|/metrics")),
)
"""The first pattern that the whole path of a request that reads fits says of which kind it is."""
_STREAM = re.compile(r"/v1/drives/[^/]+/events")


class Lane:
    """Requests of one kind: ``places`` at once, others wait their turn."""

    def __init__(
        self, places: int, most_waiting: int = MOST_WAITING, longest_wait_s: float = LONGEST_WAIT_S
    ) -> None:
        self.places = places
        self._free = asyncio.Semaphore(places)
        self._waiting = 0
        self._most_waiting = most_waiting
        self._longest_wait_s = longest_wait_s

    @asynccontextmanager
    async def place(self) -> AsyncIterator[None]:
        """Hold a place; ``BusyError`` where too many wait or the wait is too long."""
        if self._free.locked() and self._waiting >= self._most_waiting:
            raise BusyError(f"{self._waiting} requests of this kind wait already. Try again in a moment.")
        self._waiting += 1
        try:
            async with asyncio.timeout(self._longest_wait_s):
                await self._free.acquire()
        except TimeoutError:
            raise BusyError(
                f"Other requests of this kind took more than {self._longest_wait_s:g} s. Try again in a moment."
            ) from None
        finally:
            self._waiting -= 1
        try:
            yield
        finally:
            self._free.release()


def tile_lane(z: int) -> str:
    """The name of the lane of a tile of a zoom: what shows much of the map may be slow."""
    return "wide tiles" if z < WIDE_ZOOM else "tiles"


def make_lanes(connections: int) -> dict[str, Lane]:
    """The lanes of a process that keeps ``connections`` to its database open and may open ten more.

    Together they leave three for what is quick.
    """
    places = {"tiles": connections, "wide tiles": 2, PARTS: 2, CHANGES: 2, "figures": 1}
    return {name: Lane(size) for name, size in places.items()}


class Turnstile:
    """Begins one request after the other, and lets probes pass between them.

    Six hundred requests that come at once would else be begun at once: half a second in which nothing is answered.
    Event streams come so many at once when a service has been away, and nobody waits for one as for an answer: of all
    that wait, one has a turn among the others.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._turn, self._turn_of_streams = asyncio.Lock(), asyncio.Lock()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Wait for a turn of the event loop's."""
        if scope["type"] == "http" and scope["path"] not in FOR_PROBES:
            if _STREAM.fullmatch(scope["path"]):
                async with self._turn_of_streams:
                    await self._wait()
            else:
                await self._wait()
        await self.app(scope, receive, send)

    async def _wait(self) -> None:
        async with self._turn:
            await asyncio.sleep(0)


class Lanes:
    """Lets each request into its lane before anything of it begins, until its answer does."""

    def __init__(self, app: ASGIApp, lanes: Mapping[str, Lane]) -> None:
        self.app = app
        self.lanes = lanes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Wait for a place, or answer 503."""
        name = None if scope["type"] != "http" else kind_of_request(scope["method"], scope["path"])
        if name is None:
            await self.app(scope, receive, send)
            return
        async with AsyncExitStack() as held:
            try:
                await held.enter_async_context(self.lanes[name].place())
            except BusyError as error:
                await problem_response(Request(scope), kind_of(error), str(error))(scope, receive, send)
                return

            async def leaving(message: Message) -> None:
                # A client may take its answer slowly: that is nobody else's time.
                if message["type"] == "http.response.start":
                    await held.aclose()
                await send(message)

            await self.app(scope, receive, leaving)


def kind_of_request(method: str, path: str) -> str | None:
    """The name of the lane of a request; None for what is quick, and for uploads, which go at the client's pace."""
    if method not in {"GET", "HEAD", "OPTIONS"}:
        return None if path in UPLOAD_PATHS else CHANGES
    return next((name for name, pattern in _KINDS if pattern.fullmatch(path)), None)
