"""Errors as answers: RFC 9457 problem documents. Which error is which kind stands in ``app.core.errors``."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

import psycopg
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.types import Receive, Scope, Send

from app.core.disconnects import client_left
from app.core.errors import (
    KINDS,
    PROBLEM_PATH,
    STATUS_KINDS,
    BadQueryError,
    BadRequestError,
    FieldError,
    Kind,
    NotDoneError,
    NotFoundError,
    ServiceError,
    kind_of,
)
from app.core.messages import Said, say, with_fault
from app.core.text import language_of
from fusion.errors import FusionError
from fusion.messages import joined, message_of, term, text_in

PROBLEM_JSON = "application/problem+json"
RETRY_AFTER_S = 5
"""What a 503 says: by then a statement has ended, and a queue is shorter."""
MOST_REPEATED, MOST_ERRORS = 4000, 100
"""Characters of a request that an answer repeats in one place, and faults that it lists."""
OGC_PATHS = ("/collections", "/conformance")
"""Routes whose standard wants a 400 where others answer 422."""

log = logging.getLogger(__name__)


class Problem(BaseModel):
    """A problem document (RFC 9457)."""

    type: str = Field(description="Stable identifier of the kind of problem, an address that explains it.")
    title: str = Field(description="The kind of problem in a few words; the same for each of a kind.")
    status: int = Field(description="The HTTP status, repeated.")
    detail: str = Field(description="What is wrong in this request and what to do about it.")
    instance: str = Field(description="The path that was asked for.")
    errors: list[FieldError] = Field(default=[], description="The fields or lines at fault, as far as known.")
    said: Said | None = Field(None, description="`detail` by its key; missing where it has none.")


def install_error_handlers(app: FastAPI) -> None:
    """Make every error of ``app`` a problem document."""
    for cls, handler in (
        (ServiceError, service_error),
        (FusionError, _fusion_error),
        (OperationalError, database_error),
        (psycopg.OperationalError, database_error),
        (PoolTimeoutError, database_error),
        (HTTPException, _http_error),
        (RequestValidationError, _invalid_request),
        (ClientDisconnect, _client_gone),
        (Exception, _internal_error),
    ):
        app.add_exception_handler(cls, handler)


def problem_response(
    request: Request,
    kind: Kind,
    detail: str,
    errors: Sequence[FieldError] = (),
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    """The problem document as a response."""
    language = language_of(request.headers.get("accept-language", ""))
    problem = problem_document(kind, detail, request.url.path, errors, language)
    spoken = {} if language == "en" else {"Content-Language": language, "Vary": "Accept-Language"}
    again = kind.status == 503 or kind is KINDS[NotDoneError]
    waiting = {"Retry-After": str(RETRY_AFTER_S)} if again else {}
    document = problem.model_dump(exclude={"said"} if problem.said is None else None)
    return JSONResponse(document, kind.status, {**waiting, **spoken, **(headers or {})}, PROBLEM_JSON)


async def refuse(error: ServiceError, scope: Scope, receive: Receive, send: Send, **headers: str) -> None:
    """Answer a request by an error that was found out before any route was asked."""
    answer = problem_response(Request(scope), kind_of(error), message_of(error), headers=headers)
    await answer(scope, receive, send)


def problem_document(
    kind: Kind, detail: str, instance: str, errors: Sequence[FieldError] = (), language: str = "en"
) -> Problem:
    """The document, which repeats no more than so much of a request; its sentences in ``language`` as far as known."""
    told = text_in(language, detail)
    named = [(one.field, told if one.message == detail else one.message) for one in errors[:MOST_ERRORS]]
    return Problem(
        type=PROBLEM_PATH + kind.slug,
        title=term(language, kind.title),
        status=kind.status,
        detail=_cut(told),
        instance=instance[:MOST_REPEATED],
        errors=[FieldError(field=_cut(field), message=_cut(message)) for field, message in named],
        said=Said.of(detail) if len(detail) <= MOST_REPEATED else None,
    )


def _cut(text: str) -> str:
    """Without the middle of what is too long: its end says what to do."""
    half = MOST_REPEATED // 2
    return text if len(text) <= MOST_REPEATED else f"{text[:half]} ... {text[-half:]}"


async def service_error(request: Request, error: Exception) -> JSONResponse:
    """The answer to an error of the service's own."""
    errors, headers = (error.errors, error.headers) if isinstance(error, ServiceError) else ((), {})
    return problem_response(request, kind_of(error), message_of(error), errors, headers)


async def _fusion_error(request: Request, error: Exception) -> JSONResponse:
    where = getattr(error, "where", None)
    errors = [FieldError(field=where, message=message_of(error))] if where else []
    return problem_response(request, kind_of(error), message_of(error), errors)


async def database_error(request: Request, error: Exception) -> JSONResponse:
    """The answer where the database does not do what it is asked for."""
    if client_left():  # its statement was cancelled, or it is the reason why nothing was waited for
        return await _client_gone(request, error)
    kind = kind_of(error)
    log.error("%s %s: %s", request.method, request.url.path, error)  # the driver's text may name hosts
    return problem_response(request, kind, say("service.kind", title=kind.title, meaning=kind.meaning))


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 -- the type that the handler is registered for
    kind = STATUS_KINDS.get(error.status_code) or Kind(
        error.status_code, "http-error", HTTPStatus(error.status_code).phrase, "The request was refused."
    )
    detail = {
        400: say("service.no_json"),
        404: say("service.nothing_at", path=request.url.path),
        405: say("service.method", method=request.method),
    }.get(error.status_code) or str(error.detail)
    headers = dict(error.headers or {})
    if error.status_code == 405:  # the framework names the methods of the first route that fits, not of all
        headers["Allow"] = ", ".join(_methods_at(request.app, request.url.path))
    return problem_response(request, kind, detail, headers=headers)


def _methods_at(app: FastAPI, path: str) -> list[str]:
    """The methods that ``path`` takes, for the Allow header; HEAD comes with GET."""
    methods: set[str] = set()
    for template, operations in app.openapi()["paths"].items():
        pattern = "[^/]+".join(re.escape(part) for part in re.split(r"{\w+}", template))
        if re.fullmatch(pattern, path):
            methods |= {method.upper() for method in operations}
    return sorted(methods | ({"HEAD"} if "GET" in methods else set()))


async def _invalid_request(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)  # noqa: S101 -- the type that the handler is registered for
    faults = [_fault(item) for item in error.errors()]
    if any(item["loc"][0] == "path" for item in error.errors()):
        # An address that cannot be the address of anything names nothing.
        kind, start = KINDS[NotFoundError], say("query.nothing_at", path=request.url.path)
    elif request.url.path.startswith(OGC_PATHS):
        kind, start = KINDS[BadQueryError], say("query.not_usable")
    else:
        kind, start = KINDS[BadRequestError], say("query.request_not_usable")
    reasons = joined([say("about", field=field, reason=reason) for field, reason in faults], "; ")
    errors = [FieldError(field=field, message=reason) for field, reason in faults]
    return problem_response(request, kind, say("query.faults", start=start, reasons=reasons), errors)


def _fault(item: Mapping[str, Any]) -> tuple[str, str]:
    """Where it is, and what is wrong there: the validator's own words, with a key where the catalogues have it."""
    place, *rest = item["loc"]
    message = str(item["msg"]).removeprefix("Value error, ")
    if item["type"] == "json_invalid":  # its place is a position in the text
        return str(place), f"{message} at character {rest[0]}"
    field = ".".join(str(part) for part in rest) or str(place)
    if not message[:2].isupper():  # an acronym stays as it is
        message = message[:1].lower() + message[1:]
    return field, with_fault(message, item)


async def _internal_error(request: Request, error: Exception) -> JSONResponse:
    # Starlette raises the error again after this answer: the server logs it with its traceback and then closes
    # the connection. An answer that does not say so would invite the next request onto it, which is then reset.
    detail = say("service.failed")
    return problem_response(request, KINDS[Exception], detail, headers={"Connection": "close"})


async def _client_gone(request: Request, error: Exception) -> JSONResponse:
    # Nobody reads this answer; the status is what the metrics count (nginx's 499).
    kind = Kind(499, "client-gone", "Connection closed", "The client closed the connection before the end.")
    return problem_response(request, kind, kind.meaning)
