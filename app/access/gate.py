"""The gate: finds out who a request is from, and lets it pass or refuses it, before anything of it is read.

It stands before the way of tiles and before every route. A caller is known by a key (``Authorization: Bearer``, or
Basic with the key as password, as GDAL and QGIS send it), by a proxy that has checked who it is, or by the cookie of a
session. What the caller then sees of a table is the database's business (``app.core.caller``).
"""

from __future__ import annotations

import base64
import binascii
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request, cookie_parser
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.callers import Callers, Kind
from app.access.rules import Rule, Rules
from app.core.caller import NOBODY, SERVICE, STILL_KNOWN, Caller, as_caller
from app.core.caller import Scope as CallerScope
from app.core.errors import CrossOriginWriteError, ForbiddenError, ServiceError, UnauthorizedError
from app.core.messages import say
from app.core.middleware import CHANGING, LIVE_PATH, EarlyAnswers
from app.core.problems import database_error, refuse
from app.core.receiving.clients import PROXIED
from app.core.settings import Settings

SECURE_COOKIE = "__Host-versant"
"""A browser takes it from this very host alone, and only by https."""
PROXY_SECRET_HEADER = "x-versant-proxy-secret"  # noqa: S105 - its name
SESSION_PATH = "/v1/session"
KNOWN, _ERROR = "versant.known", "versant.error"
"""What the scope of a request has of its caller (``Known``), and why it is refused."""
_CHALLENGE, _CHALLENGE_PROGRAMS = 'Bearer realm="Versant"', 'Bearer realm="Versant", Basic realm="Versant"'
_NEEDS: dict[Rule, CallerScope] = {
    Rule.LIVE: "live",
    Rule.UPLOAD: "upload",
    Rule.OWN: "own",
    Rule.OPERATE: "operate",
}


@dataclass(frozen=True)
class Credential:
    """What a request shows."""

    kind: Kind
    secret: str
    in_address: bool = False


def cookie_name(scope: Scope) -> str:
    """The name of the cookie of sessions.

    By plain http a cookie goes to every service of this machine, so its name has the port.
    """
    if scope.get("scheme") == "https":
        return SECURE_COOKIE
    return f"versant-{(scope.get('server') or ('', 0))[1]}"


@dataclass(frozen=True)
class Proxy:
    """How a proxy that the settings name says who asks; it has checked that."""

    secret: str
    owner_header: str
    role_header: str

    @classmethod
    def of(cls, settings: Settings) -> Proxy | None:
        """As the settings have it; None: no proxy is believed who asks."""
        secret = settings.proxy_secret
        if secret is None:
            return None
        return cls(secret.get_secret_value(), settings.proxy_owner_header, settings.proxy_role_header)

    def credential(self, scope: Scope, headers: Headers) -> Credential | None:
        """Whom the proxy names; None: the request did not come through it, or it names nobody."""
        shown = headers.get(PROXY_SECRET_HEADER, "")
        if not scope.get(PROXIED) or not secrets.compare_digest(shown.encode(), self.secret.encode()):
            return None
        owner = headers.get(self.owner_header, "").strip()
        return Credential("proxy", f"{owner}\n{headers.get(self.role_header, '').strip()}") if owner else None


def credential_of(scope: Scope, proxy: Proxy | None = None) -> Credential | None:
    """What a request shows of its caller, whether or not that is one; None: it shows nothing.

    A key goes first: a device that sends one means it, whatever a proxy adds.
    """
    headers = Headers(scope=scope)
    if (authorization := headers.get("authorization")) is not None:
        return Credential("key", _key_of(authorization))
    if proxy is not None and (named := proxy.credential(scope, headers)) is not None:
        return named
    cookies = cookie_parser(headers.get("cookie", ""))
    secret = cookies.get(cookie_name(scope))
    return None if not secret else Credential("session", secret)


def _key_of(authorization: str) -> str:
    kind, _, rest = authorization.partition(" ")
    if kind.lower() == "basic":
        try:
            return base64.b64decode(rest.strip(), validate=True).decode().partition(":")[2]
        except (binascii.Error, UnicodeDecodeError):
            return ""
    return rest.strip() if kind.lower() == "bearer" else ""


def capability_of(scope: Scope) -> Credential | None:
    """What a request for the room of points shows: a key in a header, else one in the address."""
    headers = Headers(scope=scope)
    if (authorization := headers.get("authorization")) is not None:
        return Credential("key", _key_of(authorization))
    _, _, secret = scope["path"].removeprefix(LIVE_PATH).partition("/")
    return Credential("key", secret, in_address=True) if secret else None


def callers_of(scope: Scope) -> Callers:
    """The callers that the process knows."""
    callers: Callers = scope["app"].state.callers
    return callers


class Gate:
    """Lets requests pass that the rules allow to whoever asks."""

    def __init__(self, app: ASGIApp, settings: Settings, routes: Sequence[tuple[str, str]]) -> None:
        self.app = app
        self._open = settings.access == "open"
        self._map: CallerScope = "own" if settings.shown_map == "off" else "nobody"
        # Of whom what is seen of the map is an edition. Operators see it as it is now; a key that can only upload lies
        # about in devices, and shows no more than none.
        self._see_editions: frozenset[CallerScope] = frozenset()
        if settings.shown_map == "releases":
            owners: tuple[CallerScope, ...] = ("own",) if settings.owners_see_editions else ()
            self._see_editions = frozenset(("nobody", "live", "upload", *owners))
        self._rules = Rules(routes)
        self._proxy = Proxy.of(settings)
        # What an upload still sends is read for a while, so that its client reads the refusal.
        self._refusal = EarlyAnswers(_refuse)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on as its caller's, or refuse it."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        rule = self._rules.of(scope["method"], scope["path"])
        live = capability_of(scope) if rule is Rule.LIVE else None
        if self._open and live is None:
            await self._pass(SERVICE, scope, receive, send)
            return
        if rule is Rule.OPEN and scope["path"] != SESSION_PATH:
            await self._pass(NOBODY, scope, receive, send)
            return
        credential = live if rule is Rule.LIVE else credential_of(scope, self._proxy)
        callers = callers_of(scope)
        try:
            known = None if credential is None else await callers.find(credential.kind, credential.secret)
        except (OperationalError, PoolTimeoutError) as away:  # no route has been asked that would answer it
            await EarlyAnswers(await database_error(Request(scope), away))(scope, receive, send)
            return
        caller = NOBODY if known is None else known.caller
        error = self._error(rule, caller, credential, scope)
        if error is not None:
            await self._refusal({**scope, _ERROR: error}, receive, send)
            return
        if credential is not None and known is not None:
            shown, known_as = credential, known.caller

            async def still_known() -> bool:
                now = await callers.find(shown.kind, shown.secret)
                return now is not None and now.caller == known_as

            scope[STILL_KNOWN], scope[KNOWN] = still_known, known
        others_see_another = rule is Rule.MAP and known is not None and bool(self._see_editions)
        if others_see_another or (rule is not Rule.OPEN and self._need(rule) != "nobody"):
            send = _kept_by_nobody_else(send)
        await self._pass(caller, scope, receive, send)

    def _need(self, rule: Rule) -> CallerScope:
        return self._map if rule is Rule.MAP else _NEEDS[rule]

    async def _pass(self, caller: Caller, scope: Scope, receive: Receive, send: Send) -> None:
        if caller.scope in self._see_editions:
            caller = replace(caller, sees="edition")
        with as_caller(caller):
            await self.app(scope, receive, send)

    def _error(
        self, rule: Rule, caller: Caller, credential: Credential | None, scope: Scope
    ) -> ServiceError | None:
        if rule is Rule.OPEN:
            return None
        if caller is NOBODY and credential is not None and credential.kind == "key":
            return UnauthorizedError(say("access.no_such_key"))
        if credential is not None and credential.in_address and caller.scope != "live":
            return ForbiddenError(say("access.not_in_address", scope=caller.scope))
        need = self._need(rule)
        if not caller.may(need):
            return _refused(caller, need)
        if credential is not None and credential.kind != "key" and scope["method"] in CHANGING:
            # A browser says where a change comes from. Where nothing is said it may be a page of another site.
            headers = Headers(scope=scope)
            if "origin" not in headers and "sec-fetch-site" not in headers:
                return CrossOriginWriteError(say("access.which_page"))
        return None


def _refused(caller: Caller, need: CallerScope) -> ServiceError:
    if caller is NOBODY:
        return UnauthorizedError(say("access.needs_key"))
    return ForbiddenError(say("access.needs_scope", need=need, scope=caller.scope))


def _kept_by_nobody_else(send: Send) -> Send:
    """``send`` for an answer that needed a key: a cache between many clients must not keep it for others."""

    async def private(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            caching = headers.get("cache-control", "")
            if "no-store" not in caching:
                rest = caching.replace("public", "").strip(" ,")
                headers["Cache-Control"] = f"private, {rest}" if rest else "private"
        await send(message)

    return private


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    error: ServiceError = scope[_ERROR]
    headers = {}
    if isinstance(error, UnauthorizedError):
        # A browser would answer Basic by a window of its own, in front of the page that leads to the login.
        browser = "sec-fetch-mode" in Headers(scope=scope)
        headers = {"WWW-Authenticate": _CHALLENGE if browser else _CHALLENGE_PROGRAMS}
    await refuse(error, scope, receive, send, **headers)
