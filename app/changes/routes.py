"""The change feed over HTTP: which segments changed since a version, and the same as server-sent events.

Of the events, one look at the map is for all who follow it. A map that is told fetches anew what it shows there. A slow
follower gets several changes as one.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, NamedTuple, Protocol

import psycopg
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from app.changes import store
from app.changes.store import Page, Since, page_since
from app.core.caller import present_caller
from app.core.db import Bounds
from app.core.errors import BadQueryError, BadRequestError
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    Link,
    OfTheMap,
    ServiceDep,
    link,
    not_modified,
    problems,
    with_query,
)
from app.core.messages import say
from app.core.query import parse_bbox, refuse_unknown
from app.core.receiving.clients import Shares
from app.core.receiving.sse import EventStream, Follower, Followers, event, events_of, stream_answer
from app.core.text import GEO_JSON, Moment, dumps
from fusion.messages import message_of

PAGE_DEFAULT, PAGE_MAX = 1000, 10_000
EXAMPLE_VERSION = "k3v7qmx2ab-184467"
_EXAMPLE: dict[str, Any] = {
    "since": EXAMPLE_VERSION,
    "version": "k3v7qmx2ab-184532",
    "changes": [
        {"id": 17, "changed_at": "2026-11-20T09:13:02.004Z", "gone": False},
        {"id": 18, "changed_at": "2026-11-20T09:13:02.004Z", "gone": True},
    ],
    "links": [
        {
            "href": f"http://127.0.0.1:8000/v1/changes?since={EXAMPLE_VERSION}",
            "rel": "self",
            "type": "application/json",
        }
    ],
}

router = APIRouter(prefix="/v1/changes", tags=["changes"])


class ChangedSegment(BaseModel):
    """A segment of which anything that is shown changed; of several changes the last."""

    id: int
    changed_at: Moment = Field(description="When it was written.")
    gone: bool = Field(description="There is no such segment any more.")


class ChangeList(OfTheMap, json_schema_extra={"examples": [_EXAMPLE]}):
    """One page of the changes since a version."""

    since: str | None = Field(description="The version that was asked for.")
    version: str = Field(description="Where to go on from: `since` of the next request, now or in a month.")
    changes: list[ChangedSegment] = Field(description="In the order in which they came.")
    links: list[Link] = Field(
        description="`next` is missing where there is no more yet; `items` leads to the segments themselves."
    )


@router.get(
    "",
    summary="Segments changed since a version",
    response_model=ChangeList,
    responses={304: {"description": "Nothing changed since."}, **problems(410, 422, 503)},
)
def changes(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    since: Annotated[
        str | None,
        Query(
            description="The `version` of an earlier answer; without: nothing is listed, and `version` is the present "
            "one.",
            examples=[EXAMPLE_VERSION],
        ),
    ] = None,
    limit: Annotated[int, Query(ge=1, le=PAGE_MAX, description="Segments per page.")] = PAGE_DEFAULT,
    bbox: Annotated[
        str | None,
        Query(
            description="West,south,east,north in degrees: only segments that are there, or were. A page may then hold "
            "fewer than `limit`, even none, and have a `next` link.",
            examples=["8.46,48.95,8.50,48.99"],
        ),
    ] = None,
) -> Response:
    """Which segments changed since a version: came, went, or have other properties.

    To begin, ask without `since`, keep `version`, and read all segments (`/collections/segments/items`). From then on
    ask with `since`, follow `next` until there is none, and keep the last `version`: nothing is missed in whatever
    order the service's transactions end, and a segment that changes while you read comes again. An id that you do not
    know and that is `gone` came and went meanwhile. A version that this database cannot go on from (it was restored, or
    what was removed since is forgotten) is answered by 410: begin anew.
    """
    refuse_unknown(request, {"since", "limit", "bbox"}, BadRequestError)
    with _refusing():
        box = parse_bbox(bbox)
    with service.reading() as session:
        # The page's own snapshot is a later one: it sees all below the horizon.
        now, note = store.state(session), service.edition_note(session)
        with _refusing():
            place = None if since is None else store.parse_since(now, since)
        tag = store.text_of(Since(now.epoch, now.horizon))
        if note:  # an edition in which nothing changed has another number all the same
            tag += f".{note['edition']['number']}"
        headers = {"ETag": f'W/"{tag}"', "Cache-Control": REVALIDATE}
        if unchanged := not_modified(request, headers):
            return unchanged
        page = Page([], Since(now.epoch, now.horizon), more=False)
        if place is not None:
            page = page_since(session, now, place, limit, box)
    own: dict[str, Any] = {"limit": None if limit == PAGE_DEFAULT else limit, "bbox": bbox}
    here, version = f"{base}/v1/changes", store.text_of(page.until)
    items = f"{base}/collections/segments/items"
    links = [link(with_query(here, since=since, **own), "self")]
    if page.more:
        links.append(link(with_query(here, since=version, **own), "next"))
    title = "All segments: read them, then go on" if since is None else "Those that are there"
    links.append(link(with_query(items, updated_since=since, bbox=bbox), "items", GEO_JSON, title))
    changed = [ChangedSegment(**one._asdict()) for one in page.changes]
    document = ChangeList(**note, since=since, version=version, changes=changed, links=links)
    content = document.model_dump_json(exclude_unset=True)
    return Response(content, media_type="application/json", headers=headers)


@contextmanager
def _refusing() -> Iterator[None]:
    """Refuse by 422 what is refused inside: the OGC's status is not this route's."""
    try:
        yield
    except BadQueryError as error:
        raise BadRequestError(message_of(error), errors=error.errors) from error


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
        self._followers = Followers[str, Change](streams, say("stream.ask_changes"), join_changes)
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


DIGITS = 6

_EVENT_EXAMPLE = (
    'event: change\ndata: {"version": "k3v7qmx2ab1204.9d1.62f8c1e.77d", "bbox": [8.459473, 48.951366, 8.503418, '
    "48.994636]}\n\n"
)


async def get_live(request: Request) -> Live:
    """Who follow the map."""
    state = request.app.state
    live: Live = state.edition_live if present_caller().sees == "edition" else state.live
    return live


@router.get(
    "/events",
    summary="Follow the map",
    response_class=StreamingResponse,
    responses={
        **stream_answer("`change` events; the data are `version` and `bbox`.", _EVENT_EXAMPLE),
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
