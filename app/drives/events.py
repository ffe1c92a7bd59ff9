"""A drive's progress as server-sent events. What changed it is told by the feed; knows nothing of workers."""

from __future__ import annotations

import time
import uuid
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.core.http import EXAMPLE_ID, BaseUrl, found, problems
from app.core.text import dumps
from app.drives.documents import ENDED
from app.drives.feed import Feed, Follower, News

HEARTBEAT_S = 15.0
"""Pauses are filled with comments, because proxies end connections on which nothing moves."""
RECONNECT_MS = 2000
LONGEST_S = 600.0
"""Then the stream ends, and the browser comes again by itself: no connection is held for ever."""


async def get_feed(request: Request) -> Feed:
    """The application's feed of changes."""
    feed: Feed = request.app.state.feed
    return feed


FeedDep = Annotated[Feed, Depends(get_feed)]

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_EXAMPLE = f'id: 3\nevent: drive\ndata: {{"id": "{EXAMPLE_ID}", "status": "running", "progress": 0.4}}\n\n'


@router.get(
    "/{drive_id}/events",
    summary="Follow a drive",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "`drive` events; the data are those of `GET /v1/drives/{drive_id}`.",
            "content": {"text/event-stream": {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        **problems(404, 503),
    },
)
async def drive_events(drive_id: uuid.UUID, feed: FeedDep, base: BaseUrl) -> StreamingResponse:
    """The state at once, then each change. Ends after `done` or `failed`, or by `deleted` when the drive is gone.

    A browser's EventSource connects again when the stream ends: close it at a terminal status. Where too many streams
    are open already the answer is 503: ask for the drive itself every few seconds.
    """
    follower = feed.follow(drive_id)
    try:
        first = found(await follower.first(), "drive", drive_id)
    except BaseException:
        feed.leave(follower)
        raise
    return _EventStream(feed, follower, base, first)


class _EventStream(StreamingResponse):
    """The events of one follower, who leaves with the client."""

    def __init__(self, feed: Feed, follower: Follower, base: str, first: News) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(_events(follower, base, first), media_type="text/event-stream", headers=headers)
        self._feed, self._follower = feed, follower

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._feed.leave(self._follower)


async def _events(follower: Follower, base: str, first: News) -> AsyncIterator[str]:
    # When the client leaves, the server cancels this generator at its next await.
    yield f"retry: {RECONNECT_MS}\n\n"
    state: News | None = first
    number, sent, until = 0, "", time.monotonic() + LONGEST_S
    while state is not None:
        text = state.text(base)
        if text != sent:
            number, sent = number + 1, text
            yield f"id: {number}\nevent: drive\ndata: {text}\n\n"
        if state.drive.status in ENDED or time.monotonic() > until:
            return
        if not await follower.changed(within_s=HEARTBEAT_S):
            yield ": still here\n\n"
        state = follower.state
    data = dumps({"id": str(follower.drive_id), "status": "cancelled"})
    yield f"id: {number + 1}\nevent: deleted\ndata: {data}\n\n"
