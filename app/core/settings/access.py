"""Who may ask for what: the second part of the service's settings."""

from __future__ import annotations

import re
from ipaddress import ip_address
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, SecretStr

from app.core.settings.places import Places

PublicMap = Literal["live", "off", "releases"]
QUOTA_MOST = 10**15 - 1
"""The largest integer that a structured header field can tell (RFC 9651)."""


def http_url(url: str) -> str:
    """An address of the web without a slash at its end; ValueError for another."""
    if not url.startswith(("http://", "https://")):
        raise ValueError("it must begin with http:// or https://")
    return url.rstrip("/")


def _header(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9-]+", name):
        raise ValueError("it must be the name of a header, such as Remote-User")
    return name.lower()


def is_loopback(host: str) -> bool:
    """Whether the name or address is this machine's own."""
    name = host.strip("[]").lower().rstrip(".")
    try:
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False


HttpUrlText = Annotated[str, AfterValidator(http_url)]
HeaderName = Annotated[str, AfterValidator(_header)]


class Access(Places):
    """Who may ask for what."""

    access: Literal["keys", "open"] = "keys"
    """Whom the API answers: whoever has a key for what is asked (keys), or everybody for everything (open). Open is for
    a service that only this machine reaches; OPEN_TO_NETWORK allows it elsewhere."""
    open_to_network: bool = False
    """Whether ACCESS may be open though others reach the service: everybody who does may then read and remove every
    drive."""
    public_map: PublicMap | None = None
    """What is answered without a key: the map as it is now (live), nothing of it (off), or editions of it that give no
    owner away (releases). A map that changes when a drive arrives gives the drive away. Unset: live where only this
    machine reaches the service, else off."""
    public_owners: int = Field(3, ge=1, le=1000)
    """Among so many owners each is hidden in editions. 1 hides nobody: for a service whose drives are no secret."""
    public_colluders: int | None = Field(None, ge=0, le=1000)
    """So many owners may work together against another and still learn nothing: a segment is in an edition, and changes
    in it, once PUBLIC_OWNERS and so many more contribute. Unset: one fewer than PUBLIC_OWNERS."""
    release_days: int = Field(7, ge=1, le=366)
    """Days from one edition to the next, where PUBLIC_MAP is releases."""
    owners_map: Literal["live", "releases"] = "live"
    """What owners see of the map besides their own drives, where PUBLIC_MAP is releases: the map as it is now, or
    editions as everybody. Whoever sees it as it is now sees where others drive; operators always do."""
    editions_kept: int = Field(1, ge=1)
    """So many editions keep their files, the newest ones. Files of older ones still hold what was removed since."""
    key: SecretStr | None = None
    """The key that `versant upload` and other clients send; unset: that of the data folder, to this machine alone."""
    quota_drives: int | None = Field(None, ge=0, le=QUOTA_MOST)
    """Drives that an owner may upload in a day (UTC); one more is answered by 429. Unset: any number. An owner can have
    a quota of its own; operators have no other."""
    quota_bytes: int | None = Field(None, ge=0, le=QUOTA_MOST)
    """Bytes of logs, as stored, that an owner may upload in a day, as QUOTA_DRIVES says it of drives."""
    quota_records: int | None = Field(None, ge=0, le=QUOTA_MOST)
    """Records of logs in a day, as QUOTA_DRIVES says it of drives: the epochs of the sensor of which a log has most.
    They are known when a worker has read the log, so a drive that is sent before they are used up is taken whole."""
    quota_exports: int = Field(10, ge=1, le=QUOTA_MOST)
    """Exports of an owner that may wait or be made at once; one more is answered by 429. Operators may ask for any
    number."""
    oidc_issuer: HttpUrlText | None = None
    """Address of a provider of logins (OpenID Connect), such as https://login.example/realms/roads; unset: none. It
    needs OIDC_CLIENT_ID and OIDC_CLIENT_SECRET, and PUBLIC_URL/v1/session/oidc/done as an allowed redirect."""
    oidc_client_id: str | None = None
    """By what the provider of logins knows this service."""
    oidc_client_secret: SecretStr | None = None
    """The secret that this service shows to the provider of logins."""
    oidc_request: str = "openid profile email"
    """What the provider of logins is asked for (its scopes), separated by spaces."""
    oidc_owner_claim: str = Field("sub", min_length=1)
    """What of a login names its owner, who is made at the first login. Choose one that people cannot choose themselves:
    whoever has an owner's name sees its drives."""
    oidc_role_claim: str = Field("roles", min_length=1)
    """What of a login holds its role or roles."""
    oidc_operate_role: str | None = None
    """The role of which a login may operate the service; unset: none may."""
    proxy_secret: SecretStr | None = Field(None)
    """What one of TRUSTED_PROXIES sends as X-Versant-Proxy-Secret: it has checked who asks, and names the owner in
    PROXY_OWNER_HEADER. Unset: no proxy is believed that."""
    proxy_owner_header: HeaderName = "remote-user"
    """The header in which such a proxy names the owner, who is made at the first request."""
    proxy_role_header: HeaderName = "remote-role"
    """The header in which it names the role; `operate` may operate the service."""
