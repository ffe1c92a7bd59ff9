"""Admission control: requests of one class wait for each other and for nobody else.

Threads and connections are shared. A slow kind of request that is asked for often would use them up, and one drive's
page would wait behind sixty deletions. So each kind that can be slow is a request class: a fixed number is worked on at
once, a fixed number waits without a thread, and the rest is answered 503. A request without a class is quick.
``class_of_request`` tells the class of a path, ``make_request_classes`` the sizes.
"""

from __future__ import annotations

import asyncio
import re
from collections import deque
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager, nullcontext
from urllib.parse import unquote_plus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.errors import BusyError
from app.core.messages import say
from app.core.middleware import FOR_PROBES, LIVE_PATH, is_upload
from app.core.problems import refuse
from app.core.receiving.clients import Shares, present_client

LONGEST_WAIT_S = 10.0
"""A client that would wait longer is answered 503."""
MOST_WAITING = 400
"""In each class, of one client half as many: a map asks for some sixty tiles at once."""
FOR_OTHERS = 2
"""Places of each class that only clients get who have none in it."""
MORE_CONNECTIONS = 31
"""To the database, beside those that a process keeps open: as many as the classes may need, one for all archives of
owners (``app.drives.person.archive``), and three."""
WIDE_ZOOM = 12
"""Tiles of lower zooms have a class of their own."""
CHANGES = "changes"
SEARCHES = "searches"
PARTS = "parts"
POINTS = "points"
"""Of drives under way."""

_KINDS = {
    "wide tiles": r"/(tiles|names)/(\d|1[01])/.*",
    "tiles": r"/(tiles|names)/\d+/.*",
    PARTS: r"/v1/drives/[^/]+/(track|segments)|/v1/segments/[^/]+/observations|/height|/v1/elevation|/v1/regions",
    "figures": r"/v1/admin/.*|/metrics",
}
"""A reading request is of the first class whose pattern fits its whole path."""
_ITEMS = re.compile(r"/collections/[^/]+/items")
_WITHOUT_SEARCH = frozenset(
    {"bbox", "bbox-crs", "limit", "after", "f", "crs", "properties", "skipGeometry", "gaps"}
)
"""Of pages of items: an index finds them. With anything else (filters, orders, conditions) all may have to be read."""
_STREAM = re.compile(r"/v1/drives/[^/]+/events")


class RequestClass:
    """Requests of one class: ``places`` at once and ``for_others`` more for clients that hold none; others wait.

    Fair among clients (``app.core.receiving.clients``). A client that holds all ``places`` cannot take those
    ``for_others``. Among those that wait, the client that holds fewest is next, of equals the one that was served
    longest ago. One client fills at most half of the waiting room.
    """

    def __init__(
        self,
        places: int,
        most_waiting: int = MOST_WAITING,
        longest_wait_s: float = LONGEST_WAIT_S,
        *,
        for_others: int = 0,
    ) -> None:
        self.places = places
        self.for_others = for_others
        self._held = Shares(places + for_others, places + for_others)
        self._waiting = Shares(most_waiting, most_waiting)
        self._turns: dict[str, deque[asyncio.Future[None]]] = {}
        self._longest_wait_s = longest_wait_s

    @asynccontextmanager
    async def place(self) -> AsyncIterator[None]:
        """Hold a place; ``BusyError`` where too many wait or the wait is too long."""
        client = present_client()
        if client in self._turns or not self._allows(client):
            await self._turn(client)
        else:
            self._held.take(client)
        try:
            yield
        finally:
            self._leave(client)

    def _allows(self, client: str) -> bool:
        free = self._held.most - self._held.total
        return free > (self.for_others if self._held.held[client] else 0)

    async def _turn(self, client: str) -> None:
        if not self._waiting.allows(client):
            raise BusyError(say("service.many_wait", n=self._waiting.total))
        turn = asyncio.get_running_loop().create_future()
        self._turns.setdefault(client, deque()).append(turn)
        self._waiting.take(client)
        try:
            async with asyncio.timeout(self._longest_wait_s):
                await turn
        except BaseException as error:
            if turn.done() and not turn.cancelled():  # both happened at once
                self._leave(client)
            if isinstance(error, TimeoutError):
                raise BusyError(say("service.slow", wait_s=self._longest_wait_s)) from None
            raise
        finally:
            self._waiting.give_back(client)

    def _leave(self, client: str) -> None:
        self._held.give_back(client)
        while waiting := [one for one in self._turns if self._allows(one)]:
            self._serve(min(waiting, key=self._held.held.__getitem__))

    def _serve(self, client: str) -> None:
        """Give a place to the client's next request that still waits, and move the client behind the others."""
        turns = self._turns.pop(client)
        while turns:
            turn = turns.popleft()
            if not turn.done():
                self._held.take(client)
                turn.set_result(None)
                break
        if turns:
            self._turns[client] = turns


def class_of_tile(z: int) -> str:
    """The class of a tile of zoom ``z``: one that shows much of the map may be slow."""
    return "wide tiles" if z < WIDE_ZOOM else "tiles"


def make_request_classes(connections: int) -> dict[str, RequestClass]:
    """The classes, by name, of a process that keeps ``connections`` open and may open ``MORE_CONNECTIONS`` more.

    Together they leave four connections: one for archives, three for quick requests.
    """
    places = {
        "tiles": connections,
        "wide tiles": 2,
        SEARCHES: 2,
        PARTS: 2,
        CHANGES: 2,
        POINTS: 4,
        "figures": 1,
    }
    return {name: RequestClass(size, for_others=FOR_OTHERS) for name, size in places.items()}


class Turnstile:
    """Begins one request after the other, and lets probes pass between them.

    Six hundred requests begun at once would keep the event loop busy for half a second. Event streams reconnect by the
    hundred after a restart, and nobody waits for one as for an answer: all that wait share one turn among the others.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._turn, self._turn_of_streams = asyncio.Lock(), asyncio.Lock()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Wait for a turn of the event loop's."""
        if scope["type"] == "http" and scope["path"] not in FOR_PROBES:
            before = self._turn_of_streams if _STREAM.fullmatch(scope["path"]) else nullcontext()
            async with before, self._turn:
                await asyncio.sleep(0)
        await self.app(scope, receive, send)


class Admission:
    """Holds a place of the request's class from before its route begins until its answer does."""

    def __init__(self, app: ASGIApp, request_classes: Mapping[str, RequestClass]) -> None:
        self.app = app
        self._classes = request_classes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Wait for a place, or answer 503."""
        # The body of a change has been read already (``app.core.receiving.pace``): nobody holds a place meanwhile.
        name = None
        if scope["type"] == "http":
            name = class_of_request(scope["method"], scope["path"], scope["query_string"])
        if name is None:
            await self.app(scope, receive, send)
            return
        async with AsyncExitStack() as held:
            try:
                await held.enter_async_context(self._classes[name].place())
            except BusyError as error:
                await refuse(error, scope, receive, send)
                return

            async def send_and_leave(message: Message) -> None:
                # A client may take its answer slowly: others need not wait for that.
                if message["type"] == "http.response.start":
                    await held.aclose()
                await send(message)

            await self.app(scope, receive, send_and_leave)


def class_of_request(method: str, path: str, query: bytes = b"") -> str | None:
    """The class of a request; None if it is quick, or an upload, which goes at the client's pace."""
    if path.startswith(LIVE_PATH):
        return POINTS
    if method not in {"GET", "HEAD", "OPTIONS"}:
        return None if is_upload(path) else CHANGES
    if _ITEMS.fullmatch(path):
        names = {unquote_plus(pair.partition("=")[0]) for pair in query.decode("latin-1").split("&") if pair}
        return "wide tiles" if names <= _WITHOUT_SEARCH else SEARCHES
    return next((name for name, pattern in _KINDS.items() if re.fullmatch(pattern, path)), None)
