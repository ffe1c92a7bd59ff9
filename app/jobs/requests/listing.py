"""Requests over HTTP, page by page."""

from __future__ import annotations

import uuid
from typing import Annotated, Any

from fastapi import Query

from app.core.http import Link, Service, link, with_query
from app.core.query import cursor_of, parse_cursor
from app.jobs.requests.store import R, RequestStore

AfterQuery = Annotated[
    str | None, Query(description="Where the page begins; only `next` links know what to write here.")
]


def page_of(
    service: Service, store: RequestStore[R], address: str, *, limit: int, after: str | None, **equal: Any
) -> tuple[list[R], list[Link]]:
    """The newest requests, all of which columns are equal to those that are not None, and links to this page and the
    next."""
    place = None
    if after is not None:
        moment, number = parse_cursor(after)
        place = (moment, uuid.UUID(int=number))
    chosen = {name: value for name, value in equal.items() if value is not None}
    with service.reading() as session:
        listed = store.page(session, limit=limit + 1, after=place, **chosen)
    shown = listed[:limit]
    links = [link(with_query(address, **equal, limit=limit, after=after), "self")]
    if len(listed) > limit:
        following = cursor_of(shown[-1].created_at, shown[-1].id.int)
        links.append(link(with_query(address, **equal, limit=limit, after=following), "next"))
    return shown, links
