"""Changes of the map as server-sent events: what a map that is open fetches anew."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse

from app.changes.live import Change, Live
from app.core.http import problems
from app.core.receiving.sse import EventStream, event, events_of, stream_answer
from app.core.text import dumps

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
        **stream_answer("`change` events; the data are `version` and `bbox`.", _EXAMPLE),
        **problems(503),
    },
)
async def map_events(live: Annotated[Live, Depends(get_live)]) -> StreamingResponse:
    """Tells a map that is open what to fetch anew: the present `version` at once, then each change within a second.

    `bbox` is west, south, east, north of the cells in which anything changed, null where it may be anything. Versions
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
    events = events_of(follower, first, _event_maker(), lambda _: False)
    return EventStream(events, lambda: live.leave(follower))


def _event_maker() -> Callable[[Change], str]:
    sent = ""

    def event_of(change: Change) -> str:
        nonlocal sent
        if change.version == sent:
            return ""
        sent = change.version
        box = None if change.box is None else [round(value, DIGITS) for value in change.box]
        return event("change", dumps({"version": sent, "bbox": box}))

    return event_of
