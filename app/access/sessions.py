"""Logging browsers in and out: by a key, by a link that is good once, by a provider of logins."""

from __future__ import annotations

import logging
import math
import re
import secrets
import time
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import RedirectResponse
from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from app.access import store
from app.access.documents import KeyOfSession, Login, OwnerName, SessionDocument
from app.access.gate import KNOWN, SECURE_COOKIE, callers_of, cookie_name
from app.access.oidc import Attempt, Provider
from app.core.caller import OPERATOR_OWNER, SERVICE, Caller, as_caller, present_caller
from app.core.errors import (
    BadRequestError,
    ForbiddenError,
    LoginFailedError,
    NotFoundError,
    TooOftenError,
    UnauthorizedError,
)
from app.core.http import UNREADABLE_BODY, BaseUrl, Service, ServiceDep, problems
from app.core.messages import say
from app.core.receiving.clients import present_client
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin

router = APIRouter(prefix="/v1/session", tags=["access"])

LOGINS = RateLimitItemPerMinute(10)
"""Attempts of one client. A key cannot be guessed; this keeps the trying from costing others anything."""
ATTEMPT_S = 600
"""For so long somebody may take to log in at the provider."""

logger = logging.getLogger(__name__)

_PATH = re.compile(r"/(?![/\\])[\x21-\x7e]*")


class Logins:
    """What a process of the API keeps of logins: the provider, and how often each client tried."""

    def __init__(self, provider: Provider | None) -> None:
        self.provider = provider
        self._limiter = MovingWindowRateLimiter(MemoryStorage())

    def count(self) -> None:
        """Count one of the present client's; ``TooOftenError`` where there were too many."""
        client = present_client()
        if not self._limiter.hit(LOGINS, client):
            until_s = self._limiter.get_window_stats(LOGINS, client).reset_time - time.time()
            wait_s = max(1, math.ceil(until_s))
            message = f"{LOGINS.amount} attempts a minute are enough. Wait {wait_s} s, then try again."
            raise TooOftenError(message, wait_s)


def _logins(request: Request) -> Logins:
    logins: Logins = request.app.state.logins
    return logins


@router.get("", summary="Who the caller is")
def session(request: Request, response: Response, service: ServiceDep) -> SessionDocument:
    """The caller's owner, scope and key, and what is to be had without a key."""
    response.headers["Cache-Control"] = "no-store"
    return _document(service, request.scope.get(KNOWN))


@router.post("", summary="Log a browser in", responses={**UNREADABLE_BODY, **problems(401, 403, 422, 429)})
async def log_in(
    request: Request, response: Response, service: ServiceDep, login: Login, origin: Origin
) -> SessionDocument:
    """Begin a session by a key or by a link that is good once; the answer sets its cookie."""
    _logins(request).count()
    if (login.key is None) == (login.link is None):
        raise BadRequestError(say("access.key_or_link"), field="key")
    with as_caller(SERVICE):
        caller = await run_in_threadpool(_caller_of, service, login)
        known, secret = await run_in_threadpool(_begin, service, caller, origin)
        document = await run_in_threadpool(_document, service, known)
    response.headers["Cache-Control"] = "no-store"
    _set_cookie(
        request, response, cookie_name(request.scope), secret, round(store.SESSION_TIME.total_seconds())
    )
    return document


@router.delete("", status_code=204, summary="Log out")
async def log_out(request: Request, service: ServiceDep) -> Response:
    """End the session of the cookie that was sent; without one nothing happens."""
    name = cookie_name(request.scope)
    if secret := request.cookies.get(name):
        with as_caller(SERVICE):
            await run_in_threadpool(_end, service, secret)
        callers_of(request.scope).forget()
    response = Response(status_code=204)
    _set_cookie(request, response, name, "", 0)
    return response


@router.get(
    "/oidc",
    status_code=303,
    summary="Log in at the provider of logins",
    response_class=RedirectResponse,
    responses={303: {"description": "To the provider."}, **problems(401, 404, 429)},
)
async def go_to_provider(
    request: Request,
    base: BaseUrl,
    return_to: Annotated[
        str, Query(description="The page to come back to, a path of this service.")
    ] = "/drives",
) -> Response:
    """Send a browser to the provider that VERSANT_OIDC_ISSUER names; it comes back to `/v1/session/oidc/done`."""
    logins = _logins(request)
    if logins.provider is None:
        raise NotFoundError(say("access.no_provider"))
    logins.count()
    attempt = Attempt.new()
    address = await run_in_threadpool(logins.provider.address, attempt, _redirect_uri(base))
    response = RedirectResponse(address, 303)
    kept = ".".join((attempt.state, attempt.nonce, attempt.verifier, _safe_path(return_to)))
    _set_cookie(request, response, f"{cookie_name(request.scope)}-login", kept, ATTEMPT_S)
    return response


@router.get(
    "/oidc/done",
    status_code=303,
    summary="Come back from the provider of logins",
    response_class=RedirectResponse,
    responses={303: {"description": "Logged in."}, **problems(401, 403, 404)},
)
async def come_back(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    origin: Origin,
    code: Annotated[str, Query(description="Of the provider.")] = "",
    state: Annotated[str, Query(description="Of the login that began here.")] = "",
) -> Response:
    """Begin a session of the owner that the provider names; a failure leads to the page for logging in."""
    provider = _logins(request).provider
    if provider is None:
        raise NotFoundError(say("access.no_provider"))
    cookie = f"{cookie_name(request.scope)}-login"
    parts = request.cookies.get(cookie, "").split(".", 3)
    try:
        if len(parts) != 4 or not code or not secrets.compare_digest(parts[0].encode(), state.encode()):
            raise LoginFailedError(say("access.other_browser"))
        claims = await run_in_threadpool(provider.claims, Attempt(*parts[:3]), code, _redirect_uri(base))
        with as_caller(SERVICE):
            caller = await run_in_threadpool(_caller_named, service, claims)
            _, secret = await run_in_threadpool(_begin, service, caller, origin)
    except LoginFailedError as error:
        logger.warning("nobody was logged in: %s", error)
        response = RedirectResponse(f"{base}/login?failed=provider", 303)
        _set_cookie(request, response, cookie, "", 0)
        return response
    response = RedirectResponse(f"{base}{_safe_path(parts[3])}", 303)
    _set_cookie(request, response, cookie, "", 0)
    _set_cookie(
        request, response, cookie_name(request.scope), secret, round(store.SESSION_TIME.total_seconds())
    )
    return response


def _redirect_uri(base: str) -> str:
    return f"{base}/v1/session/oidc/done"


def _safe_path(path: str) -> str:
    """A path of this service, whatever was asked for: nobody is led to another site."""
    return path if _PATH.fullmatch(path) and ";" not in path else "/drives"


def _set_cookie(request: Request, response: Response, name: str, value: str, max_age_s: int) -> None:
    response.set_cookie(
        name,
        value,
        max_age=max_age_s,
        path="/",
        httponly=True,
        secure=name.startswith(SECURE_COOKIE),
        samesite="lax",
    )


def _caller_of(service: Service, login: Login) -> Caller:
    """Whom the key or link stands for; what a link stands for is used up, whatever becomes of it."""
    with service.sessions.begin() as session:
        if login.key is not None:
            known = store.by_key(session, login.key.strip())
            wrong = "This is no key of this service, or it is revoked or expired."
        else:
            known = store.by_link(session, (login.link or "").strip())
            wrong = "This link was used already, or it is too old. Ask for another: `versant keys link`."
    if known is None:
        raise UnauthorizedError(wrong)
    if not known.caller.may("own"):
        raise ForbiddenError(say("access.may_only_send"))
    return known.caller


def _caller_named(service: Service, claims: dict[str, Any]) -> Caller:
    """Whom a provider names; its owner is made at the first login."""
    settings = service.settings
    name, roles = claims.get(settings.oidc_owner_claim), claims.get(settings.oidc_role_claim, ())
    if not isinstance(name, str) or not store.OWNER_NAME.fullmatch(name.strip()):
        raise LoginFailedError(say("access.nothing_usable", claim=settings.oidc_owner_claim))
    held = {roles} if isinstance(roles, str) else set(map(str, roles)) if isinstance(roles, list) else set()
    operates = settings.oidc_operate_role is not None and settings.oidc_operate_role in held
    with service.sessions.begin() as session:
        caller = store.caller_named(session, name.strip(), operates=operates)
    if caller is None:
        raise LoginFailedError(say("access.operators_owner"))
    return caller


def _begin(service: Service, caller: Caller, origin: str) -> tuple[store.Known, str]:
    """A new session of the caller: who it is now, and the secret of its cookie."""
    with service.sessions.begin() as session:
        secret = store.begin_session(session, caller)
        with_key = "a provider" if caller.key_id is None else f"key {caller.key_id}"
        audit.note(session, origin, "logged in", f"owner {caller.owner_id}", by=with_key)
        known = store.by_session(session, secret)
    if known is None:
        raise UnauthorizedError(say("access.revoked_now"))
    return known, secret


def _end(service: Service, secret: str) -> None:
    with service.sessions.begin() as session:
        store.end_session(session, secret)


def _document(service: Service, known: store.Known | None) -> SessionDocument:
    settings = service.settings
    caller = present_caller() if known is None else known.caller
    key, owner = None, None
    if known is not None:
        with as_caller(SERVICE), service.sessions() as session:
            key, owner = _names(session, caller)
    return SessionDocument(
        access=settings.access,
        public_map=settings.shown_map,
        public_owners=settings.owners_needed if settings.shown_map == "releases" else None,
        login_provider=settings.oidc_issuer is not None,
        scope=None if caller.scope == "nobody" else caller.scope,
        owner=owner,
        key=key,
        expires_at=None if known is None else known.expires_at,
    )


def _names(session: Session, caller: Caller) -> tuple[KeyOfSession | None, OwnerName | None]:
    found = None if caller.key_id is None else store.get_key(session, caller.key_id)
    key = None if found is None else KeyOfSession(id=found.id, label=found.label)
    name = None if caller.owner_id is None else store.name_of_owner(session, caller.owner_id)
    return key, None if name is None else OwnerName(id=caller.owner_id or OPERATOR_OWNER, name=name)
