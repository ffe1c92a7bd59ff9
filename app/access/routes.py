"""Logging in and out, and keys, over HTTP."""

from __future__ import annotations

import math
import time
import uuid
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from app.access import store
from app.access.callers import Callers
from app.access.documents import (
    Key,
    KeyOfSession,
    Keys,
    Login,
    MadeKey,
    NewKey,
    OwnerName,
    SessionDocument,
)
from app.access.gate import KNOWN, SECURE_COOKIE, cookie_name
from app.core.caller import SERVICE, as_caller, present_caller
from app.core.errors import BadRequestError, ForbiddenError, TooOftenError, UnauthorizedError
from app.core.http import UNREADABLE_BODY, Service, ServiceDep, existing, problems
from app.core.receiving.clients import present_client
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin

router = APIRouter(prefix="/v1", tags=["access"])

LOGINS = RateLimitItemPerMinute(10)
"""Attempts of one client. A key cannot be guessed; this keeps the trying from costing others anything."""


class Attempts:
    """How often each client tried to log in, in this process."""

    def __init__(self) -> None:
        self._limiter = MovingWindowRateLimiter(MemoryStorage())

    def count(self) -> None:
        """Count one of the present client's; ``TooOftenError`` where there were too many."""
        client = present_client()
        if not self._limiter.hit(LOGINS, client):
            until_s = self._limiter.get_window_stats(LOGINS, client).reset_time - time.time()
            wait_s = max(1, math.ceil(until_s))
            message = f"{LOGINS.amount} attempts a minute are enough. Wait {wait_s} s, then try again."
            raise TooOftenError(message, wait_s)


@router.get("/session", summary="Who the caller is", response_model=SessionDocument)
def session(request: Request, response: Response, service: ServiceDep) -> SessionDocument:
    """The caller's owner, scope and key, and what is to be had without a key."""
    response.headers["Cache-Control"] = "no-store"
    return _session(service, request.scope.get(KNOWN))


@router.post(
    "/session",
    summary="Log a browser in",
    response_model=SessionDocument,
    responses={**UNREADABLE_BODY, **problems(401, 403, 422, 429)},
)
async def log_in(
    request: Request, response: Response, service: ServiceDep, login: Login, origin: Origin
) -> SessionDocument:
    """Begin a session by a key or by a link that is good once; the answer sets its cookie."""
    attempts: Attempts = request.app.state.attempts
    attempts.count()
    if (login.key is None) == (login.link is None):
        raise BadRequestError("Send either a key or a link.", field="key")
    with as_caller(SERVICE):
        known, secret = await run_in_threadpool(_begin, service, login, origin)
    response.headers["Cache-Control"] = "no-store"
    secure = cookie_name(request.scope) == SECURE_COOKIE
    response.set_cookie(
        cookie_name(request.scope),
        secret,
        max_age=round(store.SESSION_TIME.total_seconds()),
        path="/",
        httponly=True,
        secure=secure,
        samesite="lax",
    )
    with as_caller(SERVICE):
        return await run_in_threadpool(_session, service, known)


def _begin(service: Service, login: Login, origin: str) -> tuple[store.Known, str]:
    """Whoever the key or link stands for, and the secret of a new session of it."""
    with service.sessions.begin() as session:
        if login.key is not None:
            found = store.by_key(session, login.key.strip())
            key_id = None if found is None else found.caller.key_id
            wrong = "This is no key of this service, or it is revoked or expired."
        else:
            key_id = store.use_link(session, (login.link or "").strip())
            wrong = "This link was used already, or it is too old. Ask for another: `versant keys link`."
        refused = _refusal(session, key_id, wrong)
        if refused is None and key_id is not None:
            secret, _ = store.begin_session(session, key_id)
            found = store.by_session(session, secret)
            audit.note(session, origin, "logged in", f"key {key_id}")
    if refused is not None:  # what the link stood for is used up all the same
        raise refused
    assert found is not None  # noqa: S101 - the session was just begun
    return found, secret


def _refusal(session: Session, key_id: uuid.UUID | None, wrong: str) -> Exception | None:
    key = None if key_id is None else store.get_key(session, key_id)
    if (
        key is None
        or key.revoked_at is not None
        or (key.expires_at or datetime.max.replace(tzinfo=UTC)) <= datetime.now(UTC)
    ):
        return UnauthorizedError(wrong)
    if key.scope == "upload":
        return ForbiddenError("This key may only send drives. Log in with one of scope own or operate.")
    return None


@router.delete("/session", status_code=204, summary="Log out")
async def log_out(request: Request, service: ServiceDep) -> Response:
    """End the session of the cookie that was sent; without one nothing happens."""
    name = cookie_name(request.scope)
    if secret := request.cookies.get(name):
        with as_caller(SERVICE):
            await run_in_threadpool(_end, service, secret)
        _callers(request).forget()
    response = Response(status_code=204)
    response.delete_cookie(name, path="/", httponly=True, secure=name == SECURE_COOKIE, samesite="lax")
    return response


def _end(service: Service, secret: str) -> None:
    with service.sessions.begin() as session:
        store.end_session(session, secret)


def _session(service: Service, known: store.Known | None) -> SessionDocument:
    settings = service.settings
    caller = present_caller() if known is None else known.caller
    key = None
    if caller.key_id is not None:
        with service.sessions() as session:
            key = store.get_key(session, caller.key_id)
    owner = None if key is None else OwnerName(id=key.owner_id, name=key.owner)
    return SessionDocument(
        access=settings.access,
        public_map=settings.shown_map,
        scope=None if caller.scope == "nobody" else caller.scope,
        owner=owner,
        key=None if key is None else KeyOfSession(id=key.id, label=key.label),
        expires_at=None if known is None else known.expires_at,
    )


@router.get("/keys", summary="The keys", response_model=Keys, responses=problems(401, 403, 404))
def list_keys(
    service: ServiceDep,
    owner: Annotated[str | None, Query(description="Only those of the owner of that name.")] = None,
) -> Keys:
    """The keys of the caller's owner; with the scope `operate` those of all."""
    with service.reading() as session:
        owner_id = None if owner is None else existing(store.owner_named(session, owner), "owner", owner).id
        return Keys(keys=[Key.of(key) for key in store.list_keys(session, owner_id)])


@router.post(
    "/keys",
    status_code=201,
    summary="Make a key",
    response_model=MadeKey,
    responses={**UNREADABLE_BODY, **problems(401, 403, 404, 422)},
)
def make_key(request: NewKey, response: Response, service: ServiceDep, origin: Origin) -> MadeKey:
    """Make a key. Its secret is in the answer and is never told again."""
    caller = present_caller()
    if not caller.may(request.scope):
        raise ForbiddenError("A key cannot make one that may do more than itself.")
    if request.expires_at is not None and request.expires_at <= datetime.now(UTC):
        raise BadRequestError.about("expires_at", "that is past already.")
    response.headers["Cache-Control"] = "no-store"
    with service.sessions.begin() as session:
        owner_id = caller.owner_id
        if request.owner is not None:
            owner_id = existing(store.owner_named(session, request.owner), "owner", request.owner).id
        assert owner_id is not None  # noqa: S101 - whoever may do this has an owner
        key, secret = store.create_key(session, owner_id, request.label, request.scope, request.expires_at)
        audit.note(session, origin, "key made", f"key {key.id}", scope=key.scope, owner=key.owner)
    return MadeKey(key=Key.of(key), secret=secret)


@router.delete("/keys/{key_id}", status_code=204, summary="Revoke a key", responses=problems(401, 403, 404))
def revoke_key(key_id: uuid.UUID, request: Request, service: ServiceDep, origin: Origin) -> Response:
    """From the answer on the key lets nobody in, nor does a session that began with it."""
    with service.sessions.begin() as session:
        _own_key(session, key_id)
        store.revoke_key(session, key_id)
        audit.note(session, origin, "key revoked", f"key {key_id}")
    _callers(request).forget()
    return Response(status_code=204)


@router.post(
    "/keys/{key_id}/rotate",
    summary="Give a key another secret",
    response_model=MadeKey,
    responses=problems(401, 403, 404),
)
def rotate_key(
    key_id: uuid.UUID, request: Request, response: Response, service: ServiceDep, origin: Origin
) -> MadeKey:
    """The secret before is void from the answer on, and so are the key's sessions."""
    response.headers["Cache-Control"] = "no-store"
    with service.sessions.begin() as session:
        _own_key(session, key_id)
        made = existing(store.rotate_key(session, key_id), "key that is not revoked", key_id)
        audit.note(session, origin, "key rotated", f"key {key_id}")
    _callers(request).forget()
    key, secret = made
    return MadeKey(key=Key.of(key), secret=secret)


def _own_key(session: Session, key_id: uuid.UUID) -> None:
    """Raise unless the caller may change that key: one of its owner's that may do no more than itself."""
    key: store.Key = existing(store.get_key(session, key_id), "key", key_id)
    if not present_caller().may(key.scope):
        raise ForbiddenError("That key may do more than this one.")


def _callers(request: Request) -> Callers:
    callers: Callers = request.app.state.callers
    return callers
