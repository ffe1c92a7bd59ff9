"""What the service answers when something is wrong: RFC 9457 problem documents, and one table to HTTP status.

ServiceError            a request cannot be answered as asked
├── NotFoundError            what the address names does not exist (any more)
├── BadRequestError          a parameter or body cannot be used
│   └── BadQueryError             the same on OGC routes, where the standard wants 400
├── BodyTooLargeError        an upload above the limit
├── UnsupportedBodyError     a body of a kind that is not taken
├── NotAcceptableError       a representation that does not exist
├── CrossOriginWriteError    a page of another site asks for a change
└── NotReadyError            the service waits for something else
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from fusion.errors import (
    BadOptionsError,
    EmptyLogError,
    FusionError,
    LogError,
    MalformedLogError,
    MethodError,
    MissingSensorError,
    NoMatchError,
    RoadsError,
    TerrainError,
    UnknownFormatError,
    UnknownNameError,
)

PROBLEM_JSON = "application/problem+json"
PROBLEM_PATH = "/problems/"
OGC_PATHS = ("/collections", "/conformance")

log = logging.getLogger(__name__)


class FieldError(BaseModel):
    """One thing at fault in a request or a log."""

    field: str = Field(description="Where: a parameter, a field of the body, a line or a byte of a file.")
    message: str = Field(description="What is wrong there.")


class Problem(BaseModel):
    """A problem document (RFC 9457)."""

    type: str = Field(description="Stable identifier of the kind of problem, an address that explains it.")
    title: str = Field(description="The kind of problem in a few words; the same for each of a kind.")
    status: int = Field(description="The HTTP status, repeated.")
    detail: str = Field(description="What is wrong in this request and what to do about it.")
    instance: str = Field(description="The path that was asked for.")
    errors: list[FieldError] = Field(default=[], description="The fields or lines at fault, as far as known.")


class ServiceError(Exception):
    """Base of the service's own errors; ``str(error)`` is a message for a person."""

    def __init__(self, message: str, *, field: str | None = None, errors: Sequence[FieldError] = ()) -> None:
        """``field`` names the one thing at fault; ``errors`` lists several."""
        super().__init__(message)
        self.errors = [FieldError(field=field, message=message)] if field else list(errors)


class NotFoundError(ServiceError):
    """What the address names does not exist (any more)."""


class BadRequestError(ServiceError):
    """A parameter or body cannot be used."""


class BadQueryError(BadRequestError):
    """A query parameter of an OGC route cannot be used."""


class BodyTooLargeError(ServiceError):
    """An upload above ``max_upload_bytes``."""


class UnsupportedBodyError(ServiceError):
    """A body of a kind that is not taken."""


class NotAcceptableError(ServiceError):
    """No representation that the Accept header allows exists."""


class CrossOriginWriteError(ServiceError):
    """A page of another site asks for a change."""


class NotReadyError(ServiceError):
    """The service waits for something else, such as its database."""


@dataclass(frozen=True)
class Kind:
    """One row of the table: status, the last part of ``type``, ``title``, and what such a problem means."""

    status: int
    slug: str
    title: str
    meaning: str


KINDS: Mapping[type[Exception], Kind] = {
    NotFoundError: Kind(404, "not-found", "Not found", "The address names nothing that exists (any more)."),
    BadQueryError: Kind(400, "bad-query", "Unusable query", "A query parameter is unknown or out of range."),
    BadRequestError: Kind(422, "invalid-request", "Unusable request", "A parameter or the body is unusable."),
    BodyTooLargeError: Kind(
        413, "too-large", "Upload too large", "The upload exceeds the size that this service takes."
    ),
    UnsupportedBodyError: Kind(
        415,
        "unsupported-body",
        "Unsupported body",
        "Send multipart/form-data or the log as it is.",
    ),
    NotAcceptableError: Kind(406, "not-acceptable", "Not acceptable", "There is no such representation."),
    CrossOriginWriteError: Kind(
        403,
        "cross-origin-write",
        "Change from another site",
        "Pages of other sites may not change data.",
    ),
    NotReadyError: Kind(503, "not-ready", "Not ready", "The service waits for what it needs; try again."),
    OperationalError: Kind(503, "database-unavailable", "Database unavailable", "Try again in a moment."),
    PoolTimeoutError: Kind(503, "busy", "Too busy", "All connections are in use; try again in a moment."),
    UnknownFormatError: Kind(
        422, UnknownFormatError.kind, "Unknown log format", "No reader knows the bytes."
    ),
    EmptyLogError: Kind(422, EmptyLogError.kind, "Log without positions", "No row of the log can be used."),
    MalformedLogError: Kind(422, MalformedLogError.kind, "Broken log", "The log is broken beyond skipping."),
    LogError: Kind(422, LogError.kind, "Unusable log", "The log cannot be used."),
    RoadsError: Kind(422, RoadsError.kind, "Unusable road file", "The road file cannot be used."),
    TerrainError: Kind(422, TerrainError.kind, "Unusable elevation file", "The raster cannot be used."),
    UnknownNameError: Kind(422, UnknownNameError.kind, "Unknown name", "No method or option has that name."),
    BadOptionsError: Kind(422, BadOptionsError.kind, "Unusable options", "The method does not take them."),
    MissingSensorError: Kind(422, MissingSensorError.kind, "Missing sensor", "The log lacks a sensor."),
    NoMatchError: Kind(422, NoMatchError.kind, "No road near", "The log never comes near a road."),
    MethodError: Kind(422, MethodError.kind, "Method failed", "The method cannot do what was asked."),
    FusionError: Kind(422, FusionError.kind, "Unusable input", "The input cannot be used."),
    Exception: Kind(500, "internal", "Internal error", "A fault of the service, written to its log."),
}
"""Error class -> answer; an error takes the row of the nearest class above it."""

STATUS_KINDS: Mapping[int, Kind] = {
    400: Kind(
        400, "unreadable-body", "Unreadable body", "The body is no JSON in UTF-8, or nested too deeply."
    ),
    404: KINDS[NotFoundError],
    405: Kind(405, "method-not-allowed", "Method not allowed", "The Allow header lists what is."),
    406: KINDS[NotAcceptableError],
    413: KINDS[BodyTooLargeError],
    415: KINDS[UnsupportedBodyError],
    422: KINDS[BadRequestError],
    500: KINDS[Exception],
    503: KINDS[NotReadyError],
}
"""The rows for errors that the framework raises with a bare status."""


def all_kinds() -> dict[str, Kind]:
    """Every kind of problem by its slug."""
    return {kind.slug: kind for kind in (*KINDS.values(), *STATUS_KINDS.values())}


def kind_of(error: Exception) -> Kind:
    """The row of the nearest class of ``error`` that the table holds."""
    return next(KINDS[cls] for cls in type(error).__mro__ if cls in KINDS)


def problem_response(
    request: Request,
    kind: Kind,
    detail: str,
    errors: Sequence[FieldError] = (),
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """The problem document as a response."""
    problem = Problem(
        type=PROBLEM_PATH + kind.slug,
        title=kind.title,
        status=kind.status,
        detail=detail,
        instance=request.url.path,
        errors=list(errors),
    )
    return JSONResponse(problem.model_dump(), kind.status, headers, PROBLEM_JSON)


async def _service_error(request: Request, error: Exception) -> JSONResponse:
    errors = error.errors if isinstance(error, ServiceError) else ()
    return problem_response(request, kind_of(error), str(error), errors)


async def _fusion_error(request: Request, error: Exception) -> JSONResponse:
    where = getattr(error, "where", None)
    errors = [FieldError(field=where, message=str(error))] if where else []
    return problem_response(request, kind_of(error), str(error), errors)


async def _database_error(request: Request, error: Exception) -> JSONResponse:
    kind = kind_of(error)
    log.error("%s %s: %s", request.method, request.url.path, error)  # the driver's text may name hosts
    return problem_response(request, kind, f"{kind.title}. {kind.meaning}", headers={"Retry-After": "5"})


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 -- the type that the handler is registered for
    kind = STATUS_KINDS.get(error.status_code) or Kind(
        error.status_code, "http-error", HTTPStatus(error.status_code).phrase, "The request was refused."
    )
    detail = {
        400: "The body cannot be read. Send JSON in UTF-8.",
        404: f"There is nothing at {request.url.path}. The landing page / lists what there is.",
        405: f"{request.method} is not possible here. The Allow header lists what is.",
    }.get(error.status_code, str(error.detail))
    headers = dict(error.headers or {})
    if error.status_code == 405:  # the framework names the methods of the first route that fits, not of all
        headers["Allow"] = ", ".join(_methods_at(request.app, request.url.path))
    return problem_response(request, kind, detail, headers=headers)


def _methods_at(app: FastAPI, path: str) -> list[str]:
    """The methods that ``path`` takes, for the Allow header; HEAD comes with GET."""
    found: set[str] = set()
    for template, operations in app.openapi()["paths"].items():
        pattern = "[^/]+".join(re.escape(part) for part in re.split(r"{\w+}", template))
        if re.fullmatch(pattern, path):
            found |= {method.upper() for method in operations}
    return sorted(found | ({"HEAD"} if "GET" in found else set()))


async def _invalid_request(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)  # noqa: S101 -- the type that the handler is registered for
    errors = [_field_error(item) for item in error.errors()]
    if any(item["loc"][0] == "path" for item in error.errors()):
        # An address that cannot be the address of anything names nothing.
        kind, start = KINDS[NotFoundError], f"There is nothing at {request.url.path}"
    elif request.url.path.startswith(OGC_PATHS):
        kind, start = KINDS[BadQueryError], "The query cannot be used"
    else:
        kind, start = KINDS[BadRequestError], "The request cannot be used"
    reasons = "; ".join(f"{e.field}: {e.message}" for e in errors)
    return problem_response(request, kind, f"{start}. {reasons}.", errors)


def _field_error(item: Mapping[str, Any]) -> FieldError:
    place, *rest = item["loc"]
    message = str(item["msg"]).removeprefix("Value error, ")
    if item["type"] == "json_invalid":  # its place is a position in the text
        return FieldError(field=str(place), message=f"{message} at character {rest[0]}")
    field = ".".join(str(part) for part in rest) or str(place)
    if not message[:2].isupper():  # an acronym stays as it is
        message = message[:1].lower() + message[1:]
    return FieldError(field=field, message=message)


async def _internal_error(request: Request, error: Exception) -> JSONResponse:
    # Starlette raises the error again after this answer: the server logs it with its traceback and then closes
    # the connection. An answer that does not say so would invite the next request onto it, which is then reset.
    detail = "The service failed on this request. The fault is in its log; trying again may help."
    return problem_response(request, KINDS[Exception], detail, headers={"Connection": "close"})


async def _client_gone(request: Request, error: Exception) -> JSONResponse:
    # Nobody reads this answer; the status is what the metrics count (nginx's 499).
    kind = Kind(499, "client-gone", "Connection closed", "The client closed the connection before the end.")
    return problem_response(request, kind, kind.meaning)


def install_error_handlers(app: FastAPI) -> None:
    """Make every error of ``app`` a problem document."""
    for cls, handler in (
        (ServiceError, _service_error),
        (FusionError, _fusion_error),
        (OperationalError, _database_error),
        (PoolTimeoutError, _database_error),
        (HTTPException, _http_error),
        (RequestValidationError, _invalid_request),
        (ClientDisconnect, _client_gone),
        (Exception, _internal_error),
    ):
        app.add_exception_handler(cls, handler)
