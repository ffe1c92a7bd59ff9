"""Who the client of a request is: one answer for admission, event streams, the audit, links and logs.

It is who the connection comes from, unless that is a proxy that the settings name. From such a one alone
``X-Forwarded-For`` and ``X-Forwarded-Proto`` are believed. ``X-Forwarded-Host`` and ``Forwarded`` are believed from
nobody: many proxies pass on what a client sends there, so a page could give its requests any host name. A proxy passes
``Host`` on, or ``VERSANT_PUBLIC_URL`` says it.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from contextvars import ContextVar
from functools import lru_cache
from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network

from starlette.types import ASGIApp, Receive, Scope, Send

from app.core.settings import Network

CLIENT_PREFIX = 64
"""Of IPv6: a client that has one address has all 2^64 of its network."""
UNKNOWN = "unknown"
PROXIED = "versant.proxied"
"""What the scope of a request has that came through a proxy which the settings name."""
_LONGEST_ADDRESS = 60

log = logging.getLogger(__name__)
_current: ContextVar[str] = ContextVar("client of this request", default=UNKNOWN)


def present_client() -> str:
    """The client of the request that is being answered, as limits count it."""
    return _current.get()


@lru_cache(maxsize=4096)
def client_of(address: str) -> str:
    """What limits count an address as: IPv4 itself, IPv6 by its /64, anything else as one unknown client."""
    parsed = parsed_address(address)
    if parsed is None:
        return UNKNOWN
    if isinstance(parsed, IPv4Address):
        return str(parsed)
    return str(ip_network((int(parsed) >> CLIENT_PREFIX << CLIENT_PREFIX, CLIENT_PREFIX)))


def parsed_address(text: str) -> IPv4Address | IPv6Address | None:
    """An address with or without a port; IPv4 where a socket for both writes it as IPv6; None: it is none."""
    text = text.strip()[:_LONGEST_ADDRESS]
    if text.startswith("["):
        text = text[1:].partition("]")[0]
    elif text.count(":") == 1:
        text = text.partition(":")[0]
    try:
        address = ip_address(text.partition("%")[0])
    except ValueError:
        return None
    mapped = address.ipv4_mapped if isinstance(address, IPv6Address) else None
    return mapped or address


def is_within(address: str, networks: Sequence[Network]) -> bool:
    """Whether an address lies in one of the networks."""
    parsed = parsed_address(address) if networks else None
    return parsed is not None and any(parsed in network for network in networks)


def forwarded_for(peer: str, header: str, proxies: Sequence[Network]) -> str:
    """The client's address by ``X-Forwarded-For``: each proxy appends the address that the request came from.

    So it is the last that is no trusted proxy; where something is no address, the proxy that wrote it.
    """
    nearest = peer
    for name in reversed(header.split(",")):
        parsed = parsed_address(name)
        if parsed is None:
            break
        nearest = str(parsed)
        if not is_within(nearest, proxies):
            break
    return nearest


class Forwarded:
    """Says who the client is, before anything else asks: the scope's ``client`` and ``scheme``, ``present_client``."""

    def __init__(self, app: ASGIApp, proxies: Sequence[Network]) -> None:
        self.app = app
        self._proxies = proxies
        self._warned = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on as its client's."""
        if scope["type"] == "http":
            peer = (scope.get("client") or (UNKNOWN, 0))[0]
            headers = [value for name, value in scope["headers"] if name == b"x-forwarded-for"]
            if is_within(peer, self._proxies):
                scope = self._believed(scope, peer, headers)
            elif headers and not self._warned:
                self._warned = True
                log.warning(
                    "a request says that it was forwarded (X-Forwarded-For), by an address that is not in "
                    "VERSANT_TRUSTED_PROXIES: if that is a proxy of yours, all its users share what one client may have"
                )
            _current.set(client_of((scope.get("client") or (UNKNOWN, 0))[0]))
        await self.app(scope, receive, send)

    def _believed(self, scope: Scope, peer: str, headers: Sequence[bytes]) -> Scope:
        schemes = [value for name, value in scope["headers"] if name == b"x-forwarded-proto"]
        scheme = schemes[-1].decode("latin-1").strip().lower() if schemes else ""
        believed = {**scope, PROXIED: True}
        if scheme in {"http", "https"}:
            believed["scheme"] = scheme
        if headers:
            address = forwarded_for(peer, b",".join(headers).decode("latin-1"), self._proxies)
            believed["client"] = (address, 0)
        return believed


class Shares:
    """How many of a bounded number each client holds.

    A client may hold ``per_client``, and no more than are left: one alone at most half of all, two a third each. So
    few clients cannot take all, and who has none finds one.
    """

    def __init__(self, most: int, per_client: int) -> None:
        self.most = most
        self.per_client = per_client
        self.held: Counter[str] = Counter()
        self.total = 0

    def allows(self, client: str) -> bool:
        """Whether the client may have one more."""
        held = self.held[client]
        return held < self.per_client and held < self.most - self.total

    def take(self, client: str) -> None:
        """The client has one more."""
        self.held[client] += 1
        self.total += 1

    def give_back(self, client: str) -> None:
        """The client has one less."""
        self.held[client] -= 1
        self.total -= 1
        if not self.held[client]:
            del self.held[client]
