"""A drive's progress as server-sent events. What changed it is told by the feed; knows nothing of workers."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse

from app.core.http import EXAMPLE_ID, BaseUrl, existing, problems
from app.core.receiving.sse import EventStream, event, events_of, stream_answer
from app.core.text import dumps
from app.drives.documents import ENDED
from app.drives.feed import Feed, News


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
        **stream_answer("`drive` events; the data are those of `GET /v1/drives/{drive_id}`.", _EXAMPLE),
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
        first = await follower.next()
        assert first is not None  # noqa: S101 - it waits until it is told
        existing(first.drive, "drive", drive_id)
    except BaseException:
        feed.leave(follower)
        raise
    events = events_of(follower, first, _event_maker(drive_id, base), _is_last)
    return EventStream(events, lambda: feed.leave(follower))


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
