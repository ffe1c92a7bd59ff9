"""The service's settings: environment variables that begin with ``VERSANT_``.

Nothing is read at import. A program reads them once, by ``get_settings()``, and hands the object on; tests
build ``Settings(...)`` themselves. Every field carries its unit, its default and, below it, its description for users.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from ipaddress import IPv4Network, IPv6Network, ip_network
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_settings import SettingsConfigDict

from app.core.messages import say, with_fault
from app.core.settings.access import Access, HttpUrlText, PublicMap, is_loopback
from app.core.settings.places import GIB
from fusion.errors import FusionError
from fusion.messages import joined

ENV_PREFIX = "VERSANT_"
ANY_ORIGIN = "*"
_ORIGIN = re.compile(r"https?://[^/?#@\s,]+")

Network = IPv4Network | IPv6Network


class SettingsError(FusionError):
    """A setting has a value that cannot be used; the message names the variable."""

    kind = "bad-settings"


def _login_url(url: str) -> str:
    if not re.match(r"https?://|/(?![/\\])", url):
        raise ValueError("it must begin with http://, https:// or one /")
    return url


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


def _backgrounds(text: str) -> str:
    for one in listed(text):
        name, _, address = one.partition("=")
        if not name.strip() or not re.fullmatch(r"https?://[^/\s]+/\S*", address.strip()):
            raise ValueError(
                "each must be a name, =, and the address of a style, such as Plain=https://map.example/s.json"
            )
    return text


LoginUrlText = Annotated[str, AfterValidator(_login_url)]
Zoom = Annotated[int, Field(ge=0, le=24)]


class Settings(Access):
    """All settings of the service; frozen. An empty variable counts as unset."""

    model_config = SettingsConfigDict(
        env_prefix=ENV_PREFIX, env_ignore_empty=True, frozen=True, extra="forbid"
    )

    # Before every route of the API: whom it believes, and what one client may hold of it
    cors_origins: Annotated[str, AfterValidator(_origins)] | None = None
    """Origins, separated by commas, whose pages may read the map (not the drives) from a visitor's browser, such as
    https://map.example; * for any. Unset: none."""
    trusted_proxies: Annotated[str, AfterValidator(_networks)] | None = None
    """Addresses and networks, separated by commas, of proxies in front of the API: from these alone X-Forwarded-For and
    X-Forwarded-Proto are believed. Unset: none."""
    connections_max: int = Field(2000, ge=10, le=1_000_000)
    """Connections that one API process holds at once; fewer where the system allows fewer open files."""
    connections_per_client: int = Field(400, ge=1)
    """Connections that one client holds at once (an IPv4 address, a /64 of IPv6); trusted proxies are not counted."""
    events_per_client: int = Field(100, ge=1)
    """Event streams that one client holds at once; one more is answered by 503."""
    head_timeout_s: float = Field(10.0, gt=0, le=3600)
    """Seconds in which a connection has to send the whole head of a request; then it is closed."""
    body_timeout_s: float = Field(10.0, gt=0, le=3600)
    """Seconds in which the body of a request has to be whole, but for uploads and imports; then 408."""
    upload_stall_s: float = Field(30.0, gt=0, le=3600)
    """Seconds in which an upload or import has to bring 1000 bytes for each of them; then 408."""

    # The API
    host: str = "127.0.0.1"
    """Address that the API listens on; by default only this machine reaches it."""
    port: int = Field(8000, ge=0, le=65535)
    """TCP port of the API; 0 lets the system choose."""
    public_url: HttpUrlText | None = None
    """Address under which people reach the API, used in links; unset: that of the request."""
    server: HttpUrlText = "http://127.0.0.1:8000"
    """Address of the API that `versant upload` sends logs to."""
    max_upload_bytes: int = Field(GIB, ge=1)
    """Largest upload accepted, bytes as sent; a larger one is answered by 413."""
    max_import_bytes: int = Field(8 * GIB, ge=1)
    """Largest file of roads or elevation that the API takes, bytes as sent, where a larger one is answered by 413, and
    unpacked."""
    imports_kept_bytes: int = Field(32 * GIB, ge=1)
    """What files of operations that wait, run or are planned may take of the store, bytes; one more is answered by
    503."""
    max_raster_posts: int = Field(4_000_000_000, ge=1)
    """Most posts (rows times columns) of an elevation raster that the API takes; the command line takes more."""
    items_limit_default: int = Field(100, ge=1)
    """Items per page when a request names no limit."""
    items_limit_max: int = Field(10_000, ge=1)
    """Most items per page; a larger limit is reduced to it."""
    items_timeout_s: float = Field(5.0, ge=0.001, le=3600)
    """Seconds for searching and sorting items; longer is a 400."""
    tile_features_max: int = Field(5000, ge=1)
    """Most segments in a GeoJSON tile; a link leads to the next ones."""
    events_poll_s: float = Field(10.0, gt=0, le=60)
    """Seconds after which drives whose events are followed are looked at though the database told of no change."""
    events_max: int = Field(800, ge=1)
    """Event streams that one process serves at once, of drives and of the map; one more is answered by 503."""
    tile_min_zoom: Zoom = 6
    """Lowest zoom level with tiles; further out a tile is empty."""
    tile_full_zoom: Zoom = 13
    """Zoom level from which tiles hold every road; further out only driven or major roads."""
    tile_max_zoom: Zoom = 18
    """Highest zoom level with tiles; a map enlarges those beyond it."""
    tile_max_age_s: int = Field(0, ge=0, le=31_536_000)
    """Seconds for which caches may answer a vector tile unasked; 0: they ask."""
    tile_stale_s: int = Field(600, ge=0, le=31_536_000)
    """Seconds more in which they may while they fetch the new one, where TILE_MAX_AGE_S is set."""
    tile_memory_bytes: int = Field(64 * 2**20, ge=0)
    """Compressed vector tiles that one process keeps in memory, bytes; and as much of the roads in them."""
    tiles_stored_bytes: int = Field(2 * GIB, ge=0)
    """Compressed vector tiles in the database, bytes; those asked for last stay."""

    map_background_url: HttpUrlText | None = None
    """A MapLibre style that the map page draws below the roads; its host, and no other, is then asked for it by
    browsers. None: the roads stand on a plain ground."""
    map_backgrounds: Annotated[str, AfterValidator(_backgrounds)] | None = None
    """Styles that people may choose there, separated by commas: Plain=https://map.example/style.json. The hosts are
    asked by browsers whose users choose them. None: nothing is to be chosen."""
    login_url: LoginUrlText | None = None
    """Where pages send whoever is answered 401, with the address to come back to as return_to: a path of this service's
    own host or an address, of whatever stands in front of the service and checks who asks."""
    allowed_hosts: str | None = None
    """Host names, separated by commas, under which the API answers besides loopback, the address that it listens on and
    that of public_url; * for any, where something in front of it checks them."""
    statement_timeout_s: float = Field(20.0, ge=0.001, le=3600)
    """Seconds that one statement of a request may take; then 503."""
    lock_timeout_s: float = Field(2.0, ge=0.001, le=3600)
    """Seconds that a request waits for one lock; then 503."""
    pool_timeout_s: float = Field(3.0, gt=0, le=3600)
    """Seconds that a request waits for a database connection; then 503."""
    pictures_kept: int = Field(1000, ge=0)
    """Pictures of profiles that are kept, so that they are drawn once."""
    pictures_waiting: int = Field(100, ge=0)
    """Requests for pictures that may wait for one that is drawn, half of them one client's; one more is answered by
    503."""

    # The worker
    worker_concurrency: int | None = Field(None, ge=1, le=256)
    """Drives that `versant worker` and `versant up` compute at once, each in a process of its own; unset: as many as
    there are cores, as far as memory goes (1 GiB each), at most 8."""
    lane_memory_bytes: int = Field(3 * GIB, ge=512 * 2**20)
    """Memory that a drive may ask for beyond what its process has, bytes, about twice of what it then uses; a drive
    that needs more fails (Linux)."""
    grace_s: float = Field(10.0, gt=0, le=3600)
    """Seconds in which a worker ends that is asked to stop: for half of them its drive goes on, then it goes back into
    the queue."""
    webhook_private: bool = False
    """Whether webhooks may call addresses of this machine and of private networks, and by plain http: whoever reaches
    the API could then make the service call what only it reaches."""
    webhook_timeout_s: float = Field(10.0, gt=0, le=30)
    """Seconds in which a webhook's receiver has to answer."""
    webhook_patience_days: float = Field(3.0, gt=0, le=30)
    """Days of failures after which a webhook is switched off."""
    run_limit_s: float = Field(3600.0, gt=0)
    """Seconds that processing a drive may take; beyond them it fails."""
    heartbeat_interval_s: float = Field(5.0, gt=0)
    """Seconds between two signs of life of a worker that computes."""
    stalled_after_s: float = Field(30.0, gt=0)
    """Seconds without a sign of life after which a drive is given to another worker."""
    live_silence_s: float = Field(900.0, ge=1, le=86_400)
    """Seconds without a point after which a drive that a phone or tracker sends is closed and computed."""
    publish_every_s: float = Field(30.0, ge=0)
    """While drives wait, slopes of one place are published at most so often, seconds; else at once."""
    default_method: str | None = Field(None, min_length=1)
    """Estimator of drives uploaded without a method; unset: the default of `versant methods`."""
    max_log_bytes: int = Field(GIB // 2, ge=1)
    """Largest log after decompression, bytes; a larger one fails as malformed."""

    # Both
    db_pool_size: int = Field(5, ge=1, le=100)
    """Database connections that one process keeps open."""
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = "INFO"
    """Least severe messages that are logged."""
    log_format: Literal["text", "json"] = "text"
    """Each line of the log as text, or as a JSON object with the same fields."""
    otlp_endpoint: HttpUrlText | None = None
    """Address of an OpenTelemetry collector (OTLP over HTTP), such as http://127.0.0.1:4318, that traces are sent to;
    needs `pip install 'versant[otel]'`. Unset: none are made."""

    @model_validator(mode="after")
    def _consistent(self) -> Settings:
        if self.stalled_after_s < 2 * self.heartbeat_interval_s:
            raise ValueError("stalled_after_s must be at least twice heartbeat_interval_s")
        if self.items_limit_default > self.items_limit_max:
            raise ValueError("items_limit_default must not exceed items_limit_max")
        if not self.tile_min_zoom <= self.tile_full_zoom <= self.tile_max_zoom:
            order = "tile_min_zoom, tile_full_zoom, tile_max_zoom"
            raise ValueError(f"the zoom levels must be in the order {order}")
        if self.access == "open" and not (self.is_local or self.open_to_network):
            raise ValueError(
                "access must not be open where others reach the service (host, public_url, allowed_hosts or "
                "trusted_proxies say so); set VERSANT_OPEN_TO_NETWORK=true as well if everybody who reaches it may "
                "read and remove every drive"
            )
        if self.oidc_issuer and not (self.oidc_client_id and self.oidc_client_secret):
            raise ValueError("oidc_issuer needs oidc_client_id and oidc_client_secret")
        if self.proxy_secret and not self.trusted_proxies:
            raise ValueError("proxy_secret needs trusted_proxies: it is believed from these alone")
        return self

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches the service, as far as the settings tell."""
        public = urlsplit(self.public_url or "").hostname
        others = self.trusted_proxies or any(not is_loopback(name) for name in self.host_names)
        return is_loopback(self.host) and not others and (public is None or is_loopback(public))

    @property
    def shown_map(self) -> PublicMap:
        """What is answered without a key."""
        return self.public_map or ("live" if self.is_local else "off")

    @property
    def owners_needed(self) -> int:
        """Distinct owners who have to contribute to what an edition tells."""
        colluders = self.public_owners - 1 if self.public_colluders is None else self.public_colluders
        return self.public_owners + colluders

    @property
    def owners_see_editions(self) -> bool:
        """Whether owners, too, see of the map what the public sees."""
        return self.shown_map == "releases" and self.owners_map == "releases"

    @property
    def origins(self) -> tuple[str, ...]:
        """Those in ``cors_origins``."""
        return listed(self.cors_origins)

    @property
    def backgrounds(self) -> dict[str, str]:
        """Name -> address of those in ``map_backgrounds``."""
        each = (one.partition("=") for one in listed(self.map_backgrounds))
        return {name.strip(): address.strip() for name, _, address in each}

    @property
    def proxies(self) -> tuple[Network, ...]:
        """Those in ``trusted_proxies``."""
        return tuple(ip_network(one) for one in listed(self.trusted_proxies))

    @property
    def host_names(self) -> frozenset[str]:
        """The names in ``allowed_hosts``."""
        return frozenset(name.lower() for name in listed(self.allowed_hosts))


def load_settings(source: Callable[[], Settings] = Settings) -> Settings:
    """Read the environment now; ``SettingsError`` names each variable at fault and what is wrong with it."""
    try:
        return source()
    except ValidationError as error:
        raise SettingsError(_explain(error)) from error


@lru_cache(maxsize=1)
def get_settings() -> Settings:
    """The process's settings, read at the first call. ``get_settings.cache_clear()`` makes it read again."""
    return load_settings()


def _explain(error: ValidationError) -> str:
    problems: list[str] = []
    for item in error.errors():
        field = str(item["loc"][0]) if item["loc"] else ""
        reason = with_fault(item["msg"].removeprefix("Value error, "), item)
        # The value is not repeated: a database URL holds a password.
        problems.append(
            say("about", field=f"{ENV_PREFIX}{field.upper()}", reason=reason) if field else reason
        )
    return say("cli.settings", problems=joined(problems, "; "))
