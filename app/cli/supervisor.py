"""Keeps the API and the workers running as child processes, and the embedded database with them.

Knows the children by their commands and addresses alone.
"""

from __future__ import annotations

import socket
import time
from dataclasses import dataclass

import httpx

from app.cli.children import LONGEST_PAUSE_S, Child, Children, child_environment, versant, workers
from app.cli.console import Console, sentence
from app.core.messages import say
from app.core.settings import Settings
from app.core.settings.access import is_loopback
from app.embedded.cluster import EmbeddedPostgres
from fusion.errors import FusionError

READY_TIMEOUT_S = 60.0  # from the start of the API to its first answer that it is ready
SEEN_WITHOUT_KEY = {
    "live": "the map is seen without one",
    "off": "nothing is seen without one",
    "releases": "editions of the map are seen without one",
}
_DATABASE_LOOK_EVERY_S = 1.0


class StartError(FusionError):
    """The service cannot be started."""

    kind = "start"


@dataclass
class DatabaseWatch:
    """Starts the embedded PostgreSQL again when it ends by itself, with growing pauses while that fails."""

    cluster: EmbeddedPostgres
    next_look_s: float = 0.0
    pause_s: float = _DATABASE_LOOK_EVERY_S

    def look_after(self, console: Console) -> None:
        """Look whether it is there, once a second; say so in one line when it is not."""
        if time.monotonic() < self.next_look_s:
            return
        try:
            if self.cluster.revive():
                console.complain(say("up.database_again", log=self.cluster.log_path))
            self.pause_s = _DATABASE_LOOK_EVERY_S
        except Exception as error:  # whatever it is, API and worker are to go on as soon as it is over
            self.pause_s = min(self.pause_s * 2, LONGEST_PAUSE_S)
            console.complain(say("up.database_gone", seconds=self.pause_s, reason=sentence(error)))
        self.next_look_s = time.monotonic() + self.pause_s


@dataclass
class Service(Children):
    """API and workers on one database; use as a context manager, which returns once the API is ready.

    With a ``cluster``, the database in it is looked after as well.
    """

    cluster: EmbeddedPostgres | None = None

    def __post_init__(self) -> None:
        self.settings = self.settings.model_copy(update={"port": free_port(self.settings)})
        api = Child("api", versant("api"), child_environment(self.settings))
        self.children = [api, workers(self.settings)]

    @property
    def address(self) -> str:
        """Where the API listens, as this machine reaches it."""
        host = self.settings.host
        host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(host, host)  # noqa: S104 - compared, not bound
        return (
            f"http://[{host}]:{self.settings.port}" if ":" in host else f"http://{host}:{self.settings.port}"
        )

    def serve_forever(self) -> None:
        """Look after the children until a signal interrupts (``stop_signals``)."""
        self.look_after_all([] if self.cluster is None else [DatabaseWatch(self.cluster)])

    def await_ready(self) -> None:
        """Return once the API answers that it is; raises ``StartError`` if it does not."""
        api = self.children[0]
        deadline = time.monotonic() + READY_TIMEOUT_S
        with httpx.Client(base_url=self.address, timeout=5.0, trust_env=False) as client:
            while time.monotonic() < deadline:
                if not api.running:
                    raise StartError(say("up.api_ended"))
                try:
                    if client.get("/readyz").is_success:
                        return
                except httpx.TransportError:
                    pass
                time.sleep(0.05)
        raise StartError(say("up.late", seconds=READY_TIMEOUT_S))


def free_port(settings: Settings) -> int:
    """The port to listen on, checked to be free; raises ``StartError`` with what to do where it is not."""
    try:
        family = socket.getaddrinfo(settings.host or None, settings.port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # As the server itself does: a port whose last connections are still closing is free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((settings.host, settings.port))
            return int(probe.getsockname()[1])
    except OSError as error:
        raise StartError(
            say("up.port", host=settings.host, port=settings.port, reason=error.strerror)
        ) from error


def reach(settings: Settings) -> str:
    """The sentence that says who can reach the service, and what else it takes."""
    local, where = is_loopback(settings.host), settings.host or say("up.everywhere")
    if settings.access == "open":
        if local:
            return say("up.local_open")
        return say("up.warning", where=where)
    if local:
        return say("up.local")
    seen = SEEN_WITHOUT_KEY[settings.shown_map]
    return say("up.asks", where=where, seen=seen)
