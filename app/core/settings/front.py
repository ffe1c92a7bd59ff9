"""Whom the API believes and what one client may hold of it: the second part of its settings."""

from __future__ import annotations

import re
from ipaddress import IPv4Network, IPv6Network, ip_network
from typing import Annotated

from pydantic import AfterValidator, Field

from app.core.settings.places import Places

ANY_ORIGIN = "*"
_ORIGIN = re.compile(r"https?://[^/?#@\s,]+")

Network = IPv4Network | IPv6Network


def listed(text: str | None) -> tuple[str, ...]:
    """The names in a setting that separates them by commas."""
    return tuple(name.strip() for name in (text or "").split(",") if name.strip())


def _origins(text: str) -> str:
    for origin in listed(text):
        if origin != ANY_ORIGIN and not _ORIGIN.fullmatch(origin):
            raise ValueError(
                "each origin must be scheme and host, with a port where it has one, such as https://map.example, "
                "or * for any"
            )
    return text.lower()


def _networks(text: str) -> str:
    for network in listed(text):
        try:
            ip_network(network)
        except ValueError:
            raise ValueError(
                "each must be an IP address, or a network such as 10.0.0.0/8 without bits beyond its prefix"
            ) from None
    return text


class Front(Places):
    """What stands before every route."""

    cors_origins: Annotated[str, AfterValidator(_origins)] | None = Field(
        None,
        description="Origins, separated by commas, whose pages may read the map (not the drives) from a visitor's "
        "browser, such as https://map.example; * for any. Unset: none.",
    )
    trusted_proxies: Annotated[str, AfterValidator(_networks)] | None = Field(
        None,
        description="Addresses and networks, separated by commas, of proxies in front of the API: from these alone "
        "X-Forwarded-For and X-Forwarded-Proto are believed. Unset: none.",
    )
    connections_max: int = Field(
        2000,
        ge=10,
        le=1_000_000,
        description="Connections that one API process holds at once; fewer where the system allows fewer open files.",
    )
    connections_per_client: int = Field(
        400,
        ge=1,
        description="Connections that one client holds at once (an IPv4 address, a /64 of IPv6); trusted proxies are "
        "not counted.",
    )
    events_per_client: int = Field(
        100, ge=1, description="Event streams that one client holds at once; one more is answered by 503."
    )
    head_timeout_s: float = Field(
        10.0,
        gt=0,
        le=3600,
        description="Seconds in which a connection has to send the whole head of a request; then it is closed.",
    )
    body_timeout_s: float = Field(
        10.0,
        gt=0,
        le=3600,
        description="Seconds in which the body of a request has to be whole, but for uploads and imports; then 408.",
    )
    upload_stall_s: float = Field(
        30.0,
        gt=0,
        le=3600,
        description="Seconds in which an upload or import has to bring 1000 bytes for each of them; then 408.",
    )

    @property
    def origins(self) -> tuple[str, ...]:
        """Those in ``cors_origins``."""
        return listed(self.cors_origins)

    @property
    def proxies(self) -> tuple[Network, ...]:
        """Those in ``trusted_proxies``."""
        return tuple(ip_network(one) for one in listed(self.trusted_proxies))
