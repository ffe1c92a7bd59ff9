"""The change feed over HTTP: which segments changed since a version, and from which version to go on."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from app.changes import store
from app.changes.pages import Page, page_since
from app.changes.store import Since, State
from app.core.db import Bounds
from app.core.errors import BadQueryError, BadRequestError
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    Link,
    ServiceDep,
    etag_matches,
    link,
    problems,
    with_query,
)
from app.core.query import parse_bbox, refuse_unknown
from app.core.text import GEO_JSON, Moment

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


class ChangeList(BaseModel):
    """One page of the changes since a version."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

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
    box = _box(bbox)
    with service.reading() as session:
        # The page's own snapshot is a later one: it sees all below the horizon.
        now = store.state(session)
        place = None if since is None else _place(now, since)
        etag = f'W/"{store.text_of(Since(now.epoch, now.horizon))}"'
        headers = {"ETag": etag, "Cache-Control": REVALIDATE}
        if etag_matches(request, etag):
            return Response(status_code=304, headers=headers)
        page = _page(session, now, place, limit, box)
    own: dict[str, Any] = {"limit": None if limit == PAGE_DEFAULT else limit, "bbox": bbox}
    here, version = f"{base}/v1/changes", store.text_of(page.until)
    items = f"{base}/collections/segments/items"
    links = [link(with_query(here, since=since, **own), "self")]
    if page.more:
        links.append(link(with_query(here, since=version, **own), "next"))
    if since is None:
        links.append(
            link(with_query(items, bbox=bbox), "items", GEO_JSON, "All segments: read them, then go on")
        )
    else:
        links.append(
            link(with_query(items, updated_since=since, bbox=bbox), "items", GEO_JSON, "Those that are there")
        )
    document = ChangeList(
        since=since,
        version=version,
        changes=[ChangedSegment(**one._asdict()) for one in page.changes],
        links=links,
    )
    return Response(document.model_dump_json(), media_type="application/json", headers=headers)


def _page(session: Any, now: State, since: Since | None, limit: int, box: Bounds | None) -> Page:
    if since is None:
        return Page([], Since(now.epoch, now.horizon), more=False)
    return page_since(session, now, since, limit, box)


def _box(value: str | None) -> Bounds | None:
    try:
        return parse_bbox(value)
    except BadQueryError as error:  # the OGC's status is not this route's
        raise BadRequestError(str(error), field="bbox") from error


def _place(now: State, value: str) -> Since:
    try:
        return store.parse_since(now, value)
    except BadQueryError as error:
        raise BadRequestError(str(error), field="since") from error
