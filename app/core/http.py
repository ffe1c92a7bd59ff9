"""Helpers of all routes: the service's parts, links, content negotiation, ETags, and the words of the API's document.

Knows no route.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any, TypeVar
from urllib.parse import urlencode

from anyio import CapacityLimiter
from fastapi import Depends, Request, Response
from pydantic import BaseModel, Field
from sqlalchemy import Engine
from sqlalchemy.orm import Session

from app.core import errors
from app.core.admission import RequestClass
from app.core.blobs import BlobStore
from app.core.db import Bounds, Sessions
from app.core.disconnects import ending_with_client
from app.core.messages import say
from app.core.problems import PROBLEM_JSON
from app.core.settings import Settings
from app.core.standby.use import Standby, from_standby
from app.core.text import GEO_JSON, geojson_text
from fusion.errors import BadOptionsError

Found = TypeVar("Found")

JSON = "application/json"
EXAMPLE_ID = "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11"
"""Of a drive, in the examples of the OpenAPI document."""
REVALIDATE = "public, no-cache"
"""Caches may keep the answer, but ask each time: a 304 costs one indexed row, a stale map costs trust."""


@dataclass(frozen=True)
class Service:
    """The parts that live as long as the application."""

    settings: Settings
    engine: Engine
    sessions: Sessions
    blobs: BlobStore
    request_classes: Mapping[str, RequestClass]
    probes: Sessions
    """Sessions on a connection of their own: a busy service still answers probes."""
    probe_threads: CapacityLimiter
    edition_note: Callable[[Session], Mapping[str, Any]] = lambda _: {}
    """The member ``edition`` of documents of the map, where the present caller sees an edition of it."""
    extents: dict[tuple[object, ...], Bounds | None] = field(default_factory=dict)
    """The network's extent by road version, kept because reading it scans every segment."""
    standby: Standby | None = None
    """What the map is read from where there is one."""

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session for one short read; its connection is returned before the answer is sent.

        If the client disconnects meanwhile, the session's statement is cancelled.
        """
        standby = self.standby if from_standby() else None
        with (standby or self).sessions() as session, ending_with_client(session):
            yield session


async def get_service(request: Request) -> Service:
    """The application's parts."""
    service: Service = request.app.state.service
    return service


async def get_base_url(request: Request, service: Annotated[Service, Depends(get_service)]) -> str:
    """The address that links begin with: ``public_url``, or the one that the request came to."""
    return service.settings.public_url or str(request.base_url).rstrip("/")


ServiceDep = Annotated[Service, Depends(get_service)]
BaseUrl = Annotated[str, Depends(get_base_url)]


class EditionSeen(BaseModel):
    """What documents say of the edition that they are of."""

    number: int = Field(description="Each edition has the next.")
    day: str = Field(description="Its day, UTC: the only time that an edition tells.")
    owners: int = Field(description="k: each owner who drove what is shown is hidden among so many.")
    owners_needed: int = Field(
        description="So many distinct owners drove each segment that is shown: k, and those who might work together."
    )


class OfTheMap(BaseModel):
    """A document of the map. Routes leave out what is not set (``response_model_exclude_unset``)."""

    edition: EditionSeen | None = Field(
        None, description="Where the caller sees editions of the map: which one this is of. Else missing."
    )


class Link(BaseModel):
    """A typed link (RFC 8288)."""

    href: str = Field(description="Absolute address.")
    rel: str = Field(description="Relation to this document.")
    type: str | None = Field(None, description="Media type of the target.")
    title: str | None = Field(None, description="What the target is.")


def link(href: str, rel: str, type_: str | None = JSON, title: str | None = None) -> Link:
    """A typed link."""
    return Link(href=href, rel=rel, type=type_, title=title)


def link_documents(links: list[Link]) -> list[dict[str, str]]:
    """Links as plain dictionaries, without unknown members."""
    return [item.model_dump(exclude_none=True) for item in links]


def with_query(address: str, **parameters: Any) -> str:
    """``address`` with those parameters that are not None; truth values in lower case."""
    given = {k: str(v).lower() if isinstance(v, bool) else v for k, v in parameters.items() if v is not None}
    return f"{address}?{urlencode(given, safe=',')}" if given else address


def geojson_response(document: Mapping[str, Any], headers: dict[str, str] | None = None) -> Response:
    """A GeoJSON document as a response; the ``features`` of a collection may be made while they are written."""
    return Response(geojson_text(document), media_type=GEO_JSON, headers=headers)


def existing(row: Found | None, what: str, key: object) -> Found:
    """``row``, or ``NotFoundError`` when it is None."""
    if row is None:
        raise errors.NotFoundError(say("service.not_there", what=what, name=key))
    return row


def is_named(etag: str, if_none_match: str) -> bool:
    """Whether If-None-Match names ``etag`` (weak comparison, RFC 9110 section 13.1.2)."""
    names = {name.strip().removeprefix("W/") for name in if_none_match.split(",")}
    return "*" in names or etag.removeprefix("W/") in names


def not_modified(request: Request, headers: Mapping[str, str]) -> Response | None:
    """A 304 with these headers where the client holds what their ETag names; None: answer in full."""
    named = is_named(headers["ETag"], request.headers.get("if-none-match", ""))
    return Response(status_code=304, headers=dict(headers)) if named else None


def unless_known(
    request: Request,
    content: bytes,
    media_type: str,
    headers: Mapping[str, str],
    *,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Response:
    """The content with these headers, an ETag among them, or 304 where the client has it; ``more``: of the content."""
    return not_modified(request, headers) or Response(
        content, media_type=media_type, headers={**headers, **more}
    )


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI descriptions of the problem documents of a route."""
    return {status: _PROBLEMS[status] for status in statuses}


def geojson_answer(description: str, example: Any) -> dict[str, Any]:
    """The OpenAPI description of an answer in GeoJSON."""
    schema = {"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}
    return _answer(description, GEO_JSON, schema, example)


def text_answer(media_type: str, description: str, example: str) -> dict[str, Any]:
    """The OpenAPI description of an answer in text."""
    return _answer(description, media_type, {"type": "string"}, example)


def json_answer(description: str, example: Any) -> dict[str, Any]:
    """The OpenAPI description of an answer in JSON that no model describes."""
    return _answer(description, JSON, {"type": "object"}, example)


def file_answers(example: str) -> dict[int | str, dict[str, Any]]:
    """The OpenAPI descriptions of a file's answers: all of it, a part of it, and none where the client has it."""
    binary = {"schema": {"type": "string", "format": "binary"}, "example": example}
    content = {"content": {"application/octet-stream": binary}}
    return {
        200: {"description": "The file.", **content},
        206: {"description": "The part of it that `Range` asks for.", **content},
        304: {"description": "Unchanged since the ETag."},
    }


def _answer(description: str, media_type: str, schema: Any, example: Any) -> dict[str, Any]:
    return {"description": description, "content": {media_type: {"schema": schema, "example": example}}}


def _described(kind: errors.Kind, detail: str, field: str | None = None) -> dict[str, Any]:
    example = {
        "type": errors.PROBLEM_PATH + kind.slug,
        "title": kind.title,
        "status": kind.status,
        "detail": detail,
        "instance": "/the/path",
        "errors": [{"field": field, "message": detail}] if field else [],
    }
    return _answer(kind.title, PROBLEM_JSON, {"$ref": "#/components/schemas/Problem"}, example)


_PROBLEMS: dict[int, dict[str, Any]] = {
    kind.status: _described(kind, *detail)
    for kind, *detail in (
        (errors.KINDS[errors.BadQueryError], "bbox: it needs 4 numbers.", "bbox"),
        (errors.KINDS[errors.UnauthorizedError], "This needs a key. Send one, or log in at /login."),
        (errors.KINDS[errors.CrossOriginWriteError], "Do it from this site."),
        (errors.KINDS[errors.NotFoundError], "There is no such thing. It may have been deleted."),
        (errors.KINDS[errors.NotAcceptableError], "Ask for application/json or image/png."),
        (errors.KINDS[errors.NotDoneError], "The export is being made: 40 % of it is done."),
        (errors.KINDS[errors.GoneError], "since: this version is of another database. Read anew.", "since"),
        (errors.KINDS[errors.OtherProtocolError], "Say Tus-Resumable: 1.0.0."),
        (errors.KINDS[errors.WrongChecksumError], "The bytes that came have another checksum."),
        (errors.KINDS[errors.BodyTooLargeError], "The upload is larger than 1073741824 bytes."),
        (errors.KINDS[errors.UnsupportedBodyError], "Send the log as it is or gzipped."),
        (errors.STATUS_KINDS[416], "The file has 498112 bytes."),
        (errors.KINDS[BadOptionsError], "particles: it must be at least 1.", "particles"),
        (
            errors.KINDS[errors.TooOftenError],
            "10 attempts a minute are enough. Wait a minute, then try again.",
        ),
        (errors.KINDS[errors.NotReadyError], "The database does not answer."),
        (errors.KINDS[errors.StorageFullError], "The service's storage is full. Send it again later."),
    )
}

_ON_QUOTAS = {
    "RateLimit-Policy": '"drives";q=100;w=86400',
    "RateLimit": '"drives";r=0;t=11520',
}
QUOTA_HEADERS: dict[str, Any] = {
    name: {
        "description": "Quotas of a day, where there are any (draft-ietf-httpapi-ratelimit-headers).",
        "schema": {"type": "string"},
        "example": example,
    }
    for name, example in _ON_QUOTAS.items()
}
"""The description of what an upload is told of quotas."""


def quota_used_up(detail: str, headers: Mapping[str, Any]) -> dict[int | str, dict[str, Any]]:
    """The description of the 429 of a route with a quota, with these headers beside Retry-After."""
    wait = {"description": "Seconds until it may be tried again.", "schema": {"type": "integer"}}
    described = _described(errors.KINDS[errors.QuotaError], detail)
    return {429: {**described, "headers": {**headers, "Retry-After": wait}}}


UNREADABLE_BODY: dict[int | str, dict[str, Any]] = {
    400: _described(errors.STATUS_KINDS[400], "The body cannot be read. Send JSON in UTF-8.")
}
"""The description of the 400 of routes that take a JSON body."""
