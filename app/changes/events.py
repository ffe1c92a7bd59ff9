"""Changes of the map as server-sent events: what a map that is open fetches anew."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.changes.live import Change, Follower, Live
from app.core.http import problems
from app.core.text import dumps

HEARTBEAT_S = 15.0
"""Pauses are filled with comments, because proxies end connections on which nothing moves."""
RECONNECT_MS = 2000
LONGEST_S = 600.0
"""Then the stream ends, and the browser comes again by itself: no connection is held for ever."""
DIGITS = 6

_EXAMPLE = (
    'event: change\ndata: {"version": "k3v7qmx2ab1204.9d1.62f8c1e.77d", "bbox": [8.459473, 48.951366, 8.503418, '
    "48.994636]}\n\n"
)


async def get_live(request: Request) -> Live:
    """Who follow the map."""
    live: Live = request.app.state.live
    return live


router = APIRouter(prefix="/v1/changes", tags=["changes"])


@router.get(
    "/events",
    summary="Follow the map",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "`change` events; the data are `version` and `bbox`.",
            "content": {"text/event-stream": {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        **problems(503),
    },
)
async def map_events(live: Annotated[Live, Depends(get_live)]) -> StreamingResponse:
    """Tells a map that is open what to fetch anew: the present `version` at once, then each change within a second.

    `bbox` is west, south, east, north of the squares in which anything changed, null where it may be anything. Versions
    are equal while the tiles are: who connects again and gets another one than the last has missed something. Which
    segments changed is told by `GET /v1/changes`. The stream ends after ten minutes; a browser's EventSource connects
    again by itself. Where too many streams are open already the answer is 503.
    """
    follower = live.follow()
    try:
        first = Change(await live.version(), None)
    except BaseException:
        live.leave(follower)
        raise
    return _EventStream(live, follower, first)


class _EventStream(StreamingResponse):
    """The events of one follower, who leaves with the client."""

    def __init__(self, live: Live, follower: Follower, first: Change) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(_events(follower, first), media_type="text/event-stream", headers=headers)
        self._live, self._follower = live, follower

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._live.leave(self._follower)


async def _events(follower: Follower, first: Change) -> AsyncIterator[str]:
    # When the client leaves, the server cancels this generator at its next await.
    yield f"retry: {RECONNECT_MS}\n\n"
    change: Change | None = first
    sent, until = "", time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        if change is None:
            yield ": still here\n\n"
        elif change.version != sent:
            sent = change.version
            box = None if change.box is None else [round(value, DIGITS) for value in change.box]
            yield f"event: change\ndata: {dumps({'version': sent, 'bbox': box})}\n\n"
        change = await follower.next(within_s=HEARTBEAT_S)
