"""One message on its way: signed as Standard Webhooks has it, to an address that may be called, within a time.

Knows no database. A name is looked up once and the connection goes to the address that was found and allowed: a name
that changes its mind between two looks reaches nothing else. Redirects are not followed, proxies of the environment not
used, and of the answer only the status is read.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import http.client
import secrets
import socket
import ssl
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address, ip_network
from typing import Any
from urllib.parse import SplitResult, urlsplit

from app.core.messages import say

SECRET_PREFIX = "whsec_"  # noqa: S105 - no secret itself
_SECRET_BYTES = 32
_LONGEST_URL = 2000
_GONE = 410

_UNICAST = ip_network("2000::/3")
"""All of version 6 that is given out to be reached from everywhere; what is outside of it is of some place only."""
_TRANSLATED = ip_network("64:ff9b::/96")
"""How a network without version 4 reaches it: the last 32 bits decide."""
_SPECIAL = tuple(
    ip_network(one)
    for one in (
        "192.0.0.0/24",  # protocols
        "192.88.99.0/24",  # relays of 6to4
        "2001::/23",  # protocols, Teredo among them, which holds addresses of version 4
        "2001:db8::/32",  # documentation, as the next
        "3fff::/20",
        "2002::/16",  # 6to4, likewise
    )
)
"""What ``is_global`` takes for reachable from everywhere, or takes so in some versions of Python."""


class RefusedError(Exception):
    """The address may not be called."""


@dataclass(frozen=True)
class Answer:
    """What came of one attempt."""

    status: int | None
    problem: str | None
    """None: the message was taken."""
    unwanted: bool = False
    """The receiver says that it is to be told nothing any more."""


def new_secret() -> str:
    """What the messages to one address are signed by."""
    return SECRET_PREFIX + base64.b64encode(secrets.token_bytes(_SECRET_BYTES)).decode("ascii")


def signature(secret: str, message_id: str, timestamp_s: int, body: bytes) -> str:
    """The header ``webhook-signature`` (Standard Webhooks, symmetric)."""
    key = base64.b64decode(secret.removeprefix(SECRET_PREFIX))
    signed = f"{message_id}.{timestamp_s}.".encode() + body
    return "v1," + base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode("ascii")


def check_url(url: str, *, private: bool) -> None:
    """``RefusedError``, in a sentence, for an address that no message can go to; names are looked up later."""
    parts = _split(url)
    if not private and parts.scheme != "https":
        raise RefusedError(say("webhook.https"))
    with suppress(ValueError):  # a name, which is looked up later
        if not _is_public(ip_address((parts.hostname or "").partition("%")[0])) and not private:
            raise RefusedError(_NOT_PUBLIC)


def post(url: str, headers: dict[str, str], body: bytes, *, timeout_s: float, private: bool) -> Answer:
    """Send one message; whatever happens is said in the answer."""
    try:
        check_url(url, private=private)
        status = _exchange(_split(url), headers, body, time.monotonic() + timeout_s, private=private)
    except RefusedError as error:
        return Answer(None, f"The address is not called: {error}")
    except TimeoutError:
        return Answer(None, f"There was no answer within {timeout_s:g} s.")
    except (OSError, http.client.HTTPException, ValueError) as error:
        return Answer(None, f"The address could not be reached: {_reason(error)}.")
    if 200 <= status < 300:
        return Answer(status, None)
    if 300 <= status < 400:
        return Answer(
            status, f"It answered {status}; redirects are not followed: give the address that it leads to."
        )
    return Answer(status, f"It answered {status}.", unwanted=status == _GONE)


_NOT_PUBLIC = say("webhook.not_public")


def _split(url: str) -> SplitResult:
    try:
        parts = urlsplit(url)
        port, host = parts.port, parts.hostname
        if host:
            host.encode("idna")
    except (ValueError, UnicodeError):
        raise RefusedError(say("webhook.no_address")) from None
    if parts.scheme not in {"http", "https"} or not host or port == 0 or len(url) > _LONGEST_URL:
        raise RefusedError(say("webhook.address"))
    if parts.username is not None or parts.password is not None or parts.fragment:
        raise RefusedError(say("webhook.user"))
    if any(ord(letter) <= 32 or ord(letter) >= 127 for letter in url):
        raise RefusedError(say("webhook.ascii"))
    return parts


def _exchange(
    parts: SplitResult, headers: dict[str, str], body: bytes, deadline_s: float, *, private: bool
) -> int:
    """The status of the answer; ``TimeoutError`` when the deadline passes, whatever was sent until then."""
    host = parts.hostname or ""
    port = parts.port or (443 if parts.scheme == "https" else 80)
    raw = _connected(host, port, deadline_s, private=private)
    late = threading.Event()

    def end() -> None:
        late.set()
        with suppress(OSError):  # it is closed already
            socket.socket.shutdown(raw, socket.SHUT_RDWR)

    # Times of a socket begin anew with each byte, and somebody may send one a second.
    watch = threading.Timer(max(deadline_s - time.monotonic(), 0.001), end)
    watch.daemon = True
    watch.start()
    try:
        connection = http.client.HTTPConnection(host, port)
        connection.sock = raw
        if parts.scheme == "https":
            connection.sock = ssl.create_default_context().wrap_socket(raw, server_hostname=host)
        try:
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            connection.request("POST", path, body, {"Host": parts.netloc, **headers, "Connection": "close"})
            return connection.getresponse().status
        finally:
            connection.close()
    except (OSError, http.client.HTTPException) as error:
        if late.is_set():
            raise TimeoutError from error
        raise
    finally:
        watch.cancel()
        raw.close()


def _connected(host: str, port: int, deadline_s: float, *, private: bool) -> socket.socket:
    """A connection to the first address of the name that may be called and answers."""
    addresses: list[Any] = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    allowed = [one for one in addresses if private or _is_public(ip_address(one[4][0].partition("%")[0]))]
    if not allowed:
        raise RefusedError(_NOT_PUBLIC)
    last: OSError = TimeoutError()
    for family, kind, protocol, _, address in allowed:
        left_s = deadline_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        raw = socket.socket(family, kind, protocol)
        raw.settimeout(left_s)
        try:
            raw.connect(address)
            return raw
        except OSError as error:
            raw.close()
            last = error
    raise last


def _is_public(address: IPv4Address | IPv6Address) -> bool:
    if isinstance(address, IPv6Address) and address in _TRANSLATED:
        return _is_public(IPv4Address(int(address) & 0xFFFF_FFFF))
    if address.version == 6 and address not in _UNICAST:
        return False
    return address.is_global and not address.is_multicast and not any(address in one for one in _SPECIAL)


def _reason(error: Exception) -> str:
    """What went wrong, without the address: it may hold a token."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate does not hold ({error.verify_message})"
    if isinstance(error, socket.gaierror):
        return "its name is not known"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return "it does not speak HTTP"
