"""Server-sent events: who follows what, the pace of a stream, and its end. Knows no subject.

A subject keeps ``Followers`` and tells them what it finds; ``events_of`` turns what one is told into the text of a
stream, and ``EventStream`` is the answer.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterable, AsyncIterator, Awaitable, Callable, Collection
from contextlib import suppress
from typing import Any, Generic, TypeVar
from weakref import WeakSet

from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.core.caller import STILL_KNOWN
from app.core.errors import BusyError
from app.core.http import text_answer
from app.core.messages import say
from app.core.receiving.clients import Shares, present_client

HEARTBEAT_S = 15.0
"""Pauses are filled with comments, because proxies end connections on which nothing moves."""
RECONNECT_MS = 2000
LONGEST_S = 600.0
"""Then the stream ends, and the browser comes again by itself: no connection is held for ever."""

K = TypeVar("K")
T = TypeVar("T")


def newest(_former: T, news: T) -> T:
    """Of two pieces of news that one is told of together, the last."""
    return news


class Follower(Generic[K, T]):
    """One who follows a topic, and the news that it has not taken yet."""

    def __init__(self, topic: K, client: str, join: Callable[[T, T], T] = newest) -> None:
        """``join`` makes one piece of news of two that were not taken."""
        self.topic, self.client = topic, client
        self._join = join
        self.last: T | None = None
        """The news told last."""
        self.over = False
        """No more news will come."""
        self._waiting: T | None = None
        self._error: Exception | None = None
        self._told = asyncio.Event()

    def tell(self, news: T) -> None:
        """Something has changed."""
        self.last, self._error = news, None
        self._waiting = news if self._waiting is None else self._join(self._waiting, news)
        self._told.set()

    def fail(self, error: Exception) -> None:
        """News cannot be read. Only a follower that has been told nothing yet learns of it."""
        if self.last is None:
            self._error = error
            self._told.set()

    def end(self) -> None:
        """Nothing more is told."""
        self.over = True
        self._told.set()

    async def next(self, within_s: float | None = None) -> T | None:
        """What has changed since the last answer; None where nothing did in time. Raises what ``fail`` was given."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._told.wait()
        self._told.clear()
        if self._error is not None:
            raise self._error
        news, self._waiting = self._waiting, None
        return news


class Followers(Generic[K, T]):
    """The followers of a process, by topic."""

    def __init__(self, streams: Shares, instead: str, join: Callable[[T, T], T] = newest) -> None:
        """``streams`` bounds how many follow, here and elsewhere; ``instead`` is what others may do."""
        self._streams, self._instead, self._join = streams, instead, join
        self._by_topic: dict[K, set[Follower[K, T]]] = {}

    def __len__(self) -> int:
        """How many follow."""
        return sum(map(len, self._by_topic.values()))

    @property
    def topics(self) -> Collection[K]:
        """What is followed."""
        return self._by_topic.keys()

    def of(self, topics: Collection[K]) -> list[Follower[K, T]]:
        """Those who follow one of these topics."""
        return [follower for topic in topics for follower in self._by_topic.get(topic, ())]

    def add(self, topic: K) -> Follower[K, T]:
        """A new follower; ``BusyError`` where there are too many."""
        client = present_client()
        if not self._streams.allows(client):
            raise BusyError(
                say(
                    "stream.many",
                    n=self._streams.total,
                    yours=self._streams.held[client],
                    instead=self._instead,
                )
            )
        self._streams.take(client)
        follower = Follower[K, T](topic, client, self._join)
        _FOLLOWING.add(follower)
        self._by_topic.setdefault(topic, set()).add(follower)
        return follower

    def leave(self, follower: Follower[K, T]) -> None:
        """Follow no longer; once more changes nothing."""
        others = self._by_topic.get(follower.topic, set())
        if follower not in others:
            return
        others.remove(follower)
        self._streams.give_back(follower.client)
        if not others:
            del self._by_topic[follower.topic]


_FOLLOWING: WeakSet[Follower[Any, Any]] = WeakSet()


def end_streams() -> None:
    """End all streams of this process, whose server stops: it would wait for their clients otherwise."""
    for follower in list(_FOLLOWING):
        follower.end()


def event(name: str, data: str, number: int | None = None) -> str:
    """The text of one event."""
    return ("" if number is None else f"id: {number}\n") + f"event: {name}\ndata: {data}\n\n"


async def events_of(
    follower: Follower[K, T], first: T, event_of: Callable[[T], str], is_last: Callable[[T], bool]
) -> AsyncIterator[str]:
    """The stream of a follower: the first news, then each change, until the last or until it has lasted long enough.

    ``event_of`` returns the text of an event; an empty one is not sent.
    """
    # When the client leaves, the server cancels this generator at its next await.
    yield f"retry: {RECONNECT_MS}\n\n"
    news: T | None = first
    until = time.monotonic() + LONGEST_S
    while True:
        if news is None:
            yield ": still here\n\n"
        elif text := event_of(news):
            yield text
        if (news is not None and is_last(news)) or follower.over or time.monotonic() > until:
            return
        news = await follower.next(within_s=HEARTBEAT_S)


async def while_known(
    still_known: Callable[[], Awaitable[bool]], events: AsyncIterable[Any]
) -> AsyncIterator[Any]:
    """The events, or other pieces of a long answer, until the key that the caller showed is good no longer."""
    async for one in events:
        if not await still_known():
            return
        yield one


class EventStream(StreamingResponse):
    """The events of one follower, who leaves with the client."""

    def __init__(self, events: AsyncIterator[str], leave: Callable[[], None]) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(events, media_type="text/event-stream", headers=headers)
        self._leave = leave

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if (still_known := scope.get(STILL_KNOWN)) is not None:
            self.body_iterator = while_known(still_known, self.body_iterator)
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._leave()


def stream_answer(description: str, example: str) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI description of a stream."""
    return {200: text_answer("text/event-stream", description, example)}
