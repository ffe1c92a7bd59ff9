"""Errors of requests, and one table from every error to its HTTP status. Knows no request.

ServiceError            a request cannot be answered as asked
├── NotFoundError            what the address names does not exist (any more)
├── GoneError                a version of the map from which nobody can go on any more
├── LogDeletedError          a drive is to be read again whose log is kept no longer
├── BadRequestError          a parameter or body cannot be used
│   └── BadQueryError             the same on OGC routes, where the standard wants 400
├── BodyTooLargeError        an upload above the limit
├── HeadTooLargeError        an address or headers beyond what any program sends
├── SlowClientError          a head or body that does not arrive
├── UnsupportedBodyError     a body of a kind that is not taken
├── NotAcceptableError       a representation that does not exist
├── UnauthorizedError        nobody may ask for it, and whoever asks is nobody
│   └── LoginFailedError          a provider of logins was not understood
├── ForbiddenError           the key is not for that
├── ConflictError            there is one of that name already
├── TooOftenError            somebody tries again and again
├── QuotaError               an owner has as much as it may have in a day, or at once
├── CrossOriginWriteError    a page of another site asks for a change
├── StorageFullError         there is no room for what was sent
├── UnknownHostError         the request came under a name that is not the service's
├── BusyError                too many ask for the same kind of thing
├── TooManyError             there is as much of it already as there may be
├── NotDoneError             what is asked for is still being made
└── NotReadyError            the service waits for something else
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Self

import psycopg
from psycopg.errors import DiskFull, LockNotAvailable, QueryCanceled
from pydantic import BaseModel, Field
from sqlalchemy.exc import DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from app.core.messages import say
from fusion import errors as fusion

PROBLEM_PATH = "/problems/"
"""Where the kinds of problems are explained; a kind's ``type`` is this and its slug."""


class FieldError(BaseModel):
    """One thing at fault in a request or a log."""

    field: str = Field(description="Where: a parameter, a field of the body, a line or a byte of a file.")
    message: str = Field(description="What is wrong there.")


class ServiceError(Exception):
    """Base of the service's own errors; ``str(error)`` is a message for a person.

    The docstring of a class is what people are told that such a problem means.
    """

    answer: ClassVar[tuple[int, str, str]]
    """HTTP status, the last part of ``type``, and title: each class of errors names its own."""
    headers: Mapping[str, str] = MappingProxyType({})
    """Of the answer, beside those of every problem."""

    def __init_subclass__(cls, *, answer: tuple[int, str, str] | None = None) -> None:
        cls.answer = answer or cls.answer

    def __init__(self, message: str, *, field: str | None = None, errors: Sequence[FieldError] = ()) -> None:
        """``field`` names the one thing at fault; ``errors`` lists several."""
        super().__init__(message)
        self.errors = [FieldError(field=field, message=message)] if field else list(errors)

    @classmethod
    def about(cls, field: str, reason: str) -> Self:
        """The error that ``field`` is at fault, which begins with its name."""
        return cls(say("about", field=field, reason=reason), field=field)


class NotFoundError(ServiceError, answer=(404, "not-found", "Not found")):
    """The address names nothing that exists (any more)."""


class GoneError(ServiceError, answer=(410, "gone", "Start anew")):
    """Nobody can go on from that version of the map any more."""


class LogDeletedError(ServiceError, answer=(410, "log-deleted", "The log was deleted")):
    """The owner keeps logs no longer than until they are computed, or for some days. What was computed of it stays."""


class BadRequestError(ServiceError, answer=(422, "invalid-request", "Unusable request")):
    """A parameter or the body is unusable."""


class BadQueryError(BadRequestError, answer=(400, "bad-query", "Unusable query")):
    """A query parameter is unknown or out of range."""


class BodyTooLargeError(ServiceError, answer=(413, "too-large", "Upload too large")):
    """The upload exceeds the size that this service takes."""


class HeadTooLargeError(ServiceError, answer=(431, "head-too-large", "Request Header Fields Too Large")):
    """The address and the headers of a request may have 32 KiB in 200 fields. Send less."""


class SlowClientError(ServiceError, answer=(408, "slow-client", "Request Timeout")):
    """The request did not arrive in time. Send it again, over a better connection."""


class UnsupportedBodyError(ServiceError, answer=(415, "unsupported-body", "Unsupported body")):
    """Send multipart/form-data or the log as it is."""


class NotAcceptableError(ServiceError, answer=(406, "not-acceptable", "Not acceptable")):
    """There is no such representation."""


class UnauthorizedError(ServiceError, answer=(401, "unauthorized", "A key is needed")):
    """It needs a key: send one as `Authorization: Bearer vsk_...`, or log in at /login."""


class LoginFailedError(UnauthorizedError, answer=(401, "login-failed", "Not logged in")):
    """The provider of logins did not say who it is. Try again, or log in by a key."""


class ForbiddenError(ServiceError, answer=(403, "forbidden", "Not for this key")):
    """The scope of the key is too small for it."""


class ConflictError(ServiceError, answer=(409, "conflict", "Already there")):
    """There is one of that name already."""


class TooOftenError(ServiceError, answer=(429, "too-often", "Too often")):
    """It was tried too often; wait as long as Retry-After says."""

    def __init__(self, message: str, retry_after_s: int) -> None:
        """``retry_after_s``: by then it may be tried again."""
        super().__init__(message)
        self.headers = {"Retry-After": str(retry_after_s)}


class QuotaError(ServiceError, answer=(429, "quota", "Quota used up")):
    """As much was uploaded today as may be in a day, or as much is asked for as may be at once; wait as long as
    Retry-After says, or ask whoever runs the service for more."""

    def __init__(self, message: str, *, quota: str, headers: Mapping[str, str]) -> None:
        """``quota`` is the one that is used up."""
        super().__init__(message)
        self.quota, self.headers = quota, headers


class CrossOriginWriteError(ServiceError, answer=(403, "cross-origin-write", "Change from another site")):
    """Pages of other sites may not change data."""


class StorageFullError(ServiceError, answer=(507, "storage-full", "Storage full")):
    """The service has no room; try again later."""


class NotReadyError(ServiceError, answer=(503, "not-ready", "Not ready")):
    """The service waits for what it needs; try again."""


class UnknownHostError(ServiceError, answer=(421, "unknown-host", "Not this service's name")):
    """The Host header names another host; VERSANT_ALLOWED_HOSTS lists further names of the service."""


class BusyError(ServiceError, answer=(503, "busy", "Too busy")):
    """Too many requests of this kind at once; try again in a moment."""


class TooManyError(ServiceError, answer=(409, "too-many", "Too many of them")):
    """There are as many as there may be; remove one that is not needed."""


class NotDoneError(ServiceError, answer=(409, "not-done", "Not done yet")):
    """What is asked for is being made; ask again after a moment."""


class ConflictingOffsetError(ServiceError, answer=(409, "conflicting-offset", "Another offset")):
    """The upload stands elsewhere; ask where (HEAD) and go on from there."""


class OtherProtocolError(ServiceError, answer=(412, "other-protocol", "Another protocol")):
    """Resumable uploads speak tus 1.0.0, which the header Tus-Resumable says."""

    def __init__(self, message: str) -> None:
        """With the version that is spoken."""
        super().__init__(message)
        self.headers = {"Tus-Version": "1.0.0"}


class WrongChecksumError(ServiceError, answer=(460, "wrong-checksum", "Another checksum")):
    """The bytes are not those that were sent; send them again."""


@dataclass(frozen=True)
class Kind:
    """One row of the table: status, the last part of ``type``, ``title``, and what such a problem means."""

    status: int
    slug: str
    title: str
    meaning: str


_UNAVAILABLE = Kind(503, "database-unavailable", "Database unavailable", "Try again in a moment.")

KINDS: Mapping[type[Exception], Kind] = {
    # A subclass before its class.
    **{
        cls: Kind(*cls.answer, " ".join(str(cls.__doc__).split()))
        for base in ServiceError.__subclasses__()
        for cls in (*base.__subclasses__(), base)
    },
    OperationalError: _UNAVAILABLE,
    psycopg.OperationalError: _UNAVAILABLE,
    PoolTimeoutError: Kind(
        503, "no-connection", "Too busy", "All database connections are in use; try again in a moment."
    ),
    QueryCanceled: Kind(
        503,
        "too-slow",
        "Took too long",
        "The database did not answer within the time that a request may take "
        "(VERSANT_STATEMENT_TIMEOUT_S); ask for less, or try again in a moment.",
    ),
    LockNotAvailable: Kind(
        503, "locked", "Being changed", "What is asked for is being changed; try again in a moment."
    ),
    **{
        cls: Kind(status, cls.kind, title, meaning)
        for status, cls, title, meaning in (
            (415, fusion.UnknownFormatError, "Unknown log format", "No reader knows the bytes."),
            (422, fusion.EmptyLogError, "Log without positions", "No row of the log can be used."),
            (422, fusion.MalformedLogError, "Broken log", "The log is broken beyond skipping."),
            (422, fusion.NotOnRoadsError, "Not on roads", "The log is of another sport than was asked for."),
            (422, fusion.LogError, "Unusable log", "The log cannot be used."),
            (422, fusion.RoadsError, "Unusable road file", "The road file cannot be used."),
            (422, fusion.TerrainError, "Unusable elevation file", "The raster cannot be used."),
            (422, fusion.ControlError, "Unusable surveyed heights", "The file cannot be used."),
            (422, fusion.UnknownNameError, "Unknown name", "No method or option has that name."),
            (422, fusion.BadOptionsError, "Unusable options", "The method does not take them."),
            (422, fusion.MissingSensorError, "Missing sensor", "The log lacks a sensor."),
            (422, fusion.NoMatchError, "No road near", "The log never comes near a road."),
            (422, fusion.MethodError, "Method failed", "The method cannot do what was asked."),
            (422, fusion.FusionError, "Unusable input", "The input cannot be used."),
        )
    },
    Exception: Kind(500, "internal", "Internal error", "A fault of the service, written to its log."),
}
"""Error class -> answer; an error takes the row of the nearest class above it."""

STATUS_KINDS: Mapping[int, Kind] = {
    400: Kind(
        400, "unreadable-body", "Unreadable body", "The body is no JSON in UTF-8, or nested too deeply."
    ),
    401: KINDS[UnauthorizedError],
    404: KINDS[NotFoundError],
    405: Kind(405, "method-not-allowed", "Method not allowed", "The Allow header lists what is."),
    406: KINDS[NotAcceptableError],
    408: KINDS[SlowClientError],
    413: KINDS[BodyTooLargeError],
    416: Kind(416, "no-such-range", "No such range", "The file ends before the range that is asked for."),
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
    """The row of the nearest class of ``error`` in the table; of SQLAlchemy's errors that of the driver's error."""
    cause = error.orig if isinstance(error, DBAPIError) and isinstance(error.orig, psycopg.Error) else error
    if isinstance(cause, DiskFull):
        return KINDS[StorageFullError]
    return next(KINDS[cls] for cls in type(cause).__mro__ if cls in KINDS)
