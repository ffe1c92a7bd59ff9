"""Tells followers of drives each change: one query reads for all of them.

The database announces a drive when its status changes or when it is asked for anew, and when it goes (migration 0039).
An announcement says only that there is something to read, so a lost one costs time alone: after a reconnection, and at
intervals, all followed drives are read, every second while one of them runs: how far it is is not announced, for who
announces holds up all others that do when they commit. Followers get server-sent events. Knows nothing of workers.
"""

from __future__ import annotations

import asyncio
import logging
import time
import uuid
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from itertools import islice

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse
from sqlalchemy.exc import SQLAlchemyError

from app.core.caller import Scope, present_caller
from app.core.http import EXAMPLE_ID, BaseUrl, Service, ServiceDep, existing, problems
from app.core.messages import say
from app.core.receiving.clients import Shares
from app.core.receiving.sse import EventStream, Follower, Followers, event, events_of, stream_answer
from app.core.text import dumps
from app.drives import store
from app.drives.documents import ENDED, Drive, linked

CHANNEL = "versant_drives"
MANY = "*"
"""What is announced instead of ids where one statement changed many drives."""
AT_ONCE = 100
"""Drives that one statement looks at."""
TOLD_AT_ONCE, TELL_PAUSE_S = 10, 0.004
"""Followers that are told in one go, while nobody else is answered, and how long all others are for sure: telling one
takes a third of a millisecond."""
PAUSE_S = 0.05
"""Between two looks: what changes meanwhile is looked at together."""
UNTOLD_LOOK_S = 1.0
"""Between two looks at what is followed where no announcement is received, and at how far drives are."""
AGAIN_S = 1.0
"""After a look that failed."""

Read = Callable[[Collection[uuid.UUID]], Mapping[uuid.UUID, Drive]]

log = logging.getLogger(__name__)


class News:
    """What a look found of a drive: the same to all who follow it."""

    def __init__(self, drive: Drive | None) -> None:
        """None: there is no such drive, or it is gone."""
        self.drive = drive
        self._texts: dict[tuple[str, Scope], str] = {}

    def text(self, base: str) -> str:
        """The drive's document, JSON, as the caller is shown it, with links that begin with ``base``."""
        shown = (base, present_caller().scope)  # who follows is its owner, or an operator
        if shown not in self._texts and self.drive is not None:
            self._texts[shown] = linked(base, self.drive).model_dump_json()
        return self._texts[shown]


class Feed:
    """The followers of a process. Everything but ``read`` happens in the event loop."""

    channel = CHANNEL

    def __init__(self, read: Read, look_every_s: float, streams: Shares, *, announced: bool) -> None:
        """``read`` is called in a thread and returns those of the drives that there are.

        ``announced``: whether announcements are received; else what is followed is looked at every second.
        """
        self._read = read
        self._look_every_s = look_every_s if announced else min(look_every_s, UNTOLD_LOOK_S)
        self._followers = Followers[uuid.UUID, News](streams, say("stream.ask_for_drive"))
        self.leave = self._followers.leave
        self._due: set[uuid.UUID] = set()
        self._wake = asyncio.Event()
        self._thread = CapacityLimiter(1)

    def follow(self, drive_id: uuid.UUID) -> Follower[uuid.UUID, News]:
        """A new follower, to whom the state is told at once; ``BusyError`` where there are too many."""
        follower = self._followers.add(drive_id)
        self._look_at({drive_id})
        return follower

    def _look_at(self, drives: Collection[uuid.UUID]) -> None:
        self._due.update(drives)
        self._wake.set()

    def begin_hearing(self) -> None:
        """Look at all: what was announced meanwhile is lost."""
        self._look_at(self._followers.topics)

    def stop_hearing(self) -> None:
        """All are looked at at intervals."""

    def hear(self, payload: str) -> None:
        """Look at the drive that changed, or at all."""
        if payload == MANY:
            self._look_at(self._followers.topics)
            return
        with suppress(ValueError):  # whoever has the database's password may announce anything
            self._look_at({uuid.UUID(payload)}.intersection(self._followers.topics))

    @property
    def _every_s(self) -> float:
        """How often all are looked at: more often while one runs."""
        told = (follower.last for follower in self._followers.of(self._followers.topics))
        runs = any(news and news.drive and news.drive.status == "running" for news in told)
        return min(UNTOLD_LOOK_S, self._look_every_s) if runs else self._look_every_s

    async def run(self) -> None:
        """Look until cancelled."""
        looked_s = time.monotonic()
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(max(looked_s + self._every_s - time.monotonic(), 0.0)):
                    await self._wake.wait()
            self._wake.clear()
            if time.monotonic() >= looked_s + self._every_s:
                looked_s = time.monotonic()
                self._due.update(self._followers.topics)
            while self._due:
                failed = not await self._look_once(set(islice(self._due, AT_ONCE)))
                await asyncio.sleep(AGAIN_S if failed else PAUSE_S)

    async def _look_once(self, drives: set[uuid.UUID]) -> bool:
        """Look at these drives and tell their followers; False when the database cannot be asked."""
        self._due -= drives
        followed = drives.intersection(self._followers.topics)
        if not followed:
            return True
        # Who comes from here on waits for a look that begins later: a drive may be removed meanwhile.
        waiting = self._followers.of(followed)
        try:
            states = await to_thread.run_sync(self._read, followed, limiter=self._thread)
        except Exception as error:  # whatever it is: without this loop nobody is told anything any more
            if not isinstance(error, SQLAlchemyError):
                log.exception("followed drives cannot be looked at")
            self._due |= followed
            for follower in waiting:
                follower.fail(error)
            return False
        news = {drive_id: News(states.get(drive_id)) for drive_id in followed}
        for number, follower in enumerate(waiting, start=1):
            drive_news = news[follower.topic]
            if follower.last is None or follower.last.drive != drive_news.drive:
                follower.tell(drive_news)
            if number % TOLD_AT_ONCE == 0:
                await asyncio.sleep(TELL_PAUSE_S)
        return True


router = APIRouter(prefix="/v1/drives", tags=["drives"])

_EXAMPLE = f'id: 3\nevent: drive\ndata: {{"id": "{EXAMPLE_ID}", "status": "running", "progress": 0.4}}\n\n'


@router.get(
    "/{drive_id}/events",
    summary="Follow a drive",
    response_class=StreamingResponse,
    responses={
        **stream_answer("`drive` events; the data are those of `GET /v1/drives/{drive_id}`.", _EXAMPLE),
        **problems(404, 503),
    },
)
async def drive_events(
    drive_id: uuid.UUID, request: Request, service: ServiceDep, base: BaseUrl
) -> StreamingResponse:
    """The state at once, then each change. Ends after `done` or `failed`, or by `deleted` when the drive is gone.

    A browser's EventSource connects again when the stream ends: close it at a terminal status. Where too many streams
    are open already the answer is 503: ask for the drive itself every few seconds.
    """
    await to_thread.run_sync(_require_there, service, drive_id)
    feed: Feed = request.app.state.feed
    follower = feed.follow(drive_id)
    try:
        first = await follower.next()
        assert first is not None  # noqa: S101 - it waits until it is told
        existing(first.drive, "drive", drive_id)
    except BaseException:
        feed.leave(follower)
        raise
    events = events_of(follower, first, _event_maker(drive_id, base), _is_last)
    return EventStream(events, lambda: feed.leave(follower))


def _require_there(service: Service, drive_id: uuid.UUID) -> None:
    """``NotFoundError`` unless the drive is there for the caller: the feed reads whatever is followed."""
    with service.reading() as session:
        existing(store.is_there(session, drive_id) or None, "drive", drive_id)


def _is_last(news: News) -> bool:
    return news.drive is None or news.drive.status in ENDED


def _event_maker(drive_id: uuid.UUID, base: str) -> Callable[[News], str]:
    sent: list[str] = []

    def event_of(news: News) -> str:
        if news.drive is None:
            return event("deleted", dumps({"id": str(drive_id), "status": "cancelled"}), len(sent) + 1)
        text = news.text(base)
        if sent[-1:] == [text]:
            return ""
        sent.append(text)
        return event("drive", text, len(sent))

    return event_of
