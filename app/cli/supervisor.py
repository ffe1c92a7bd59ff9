"""Keeps the API and the worker running as child processes, and stops them quickly and completely.

Knows them by their commands and addresses alone; of the database it knows the embedded cluster's life.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType, TracebackType
from typing import Self

import httpx

from app.cli.console import Console, sentence
from app.core.settings import ENV_PREFIX, Settings
from app.embedded.cluster import EmbeddedPostgres
from fusion.errors import FusionError

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
READY_TIMEOUT_S = 60.0  # from the start of the API to its first answer that it is ready
STOP_TIMEOUT_S = 10.0  # a stopping worker lets its drive run on for some seconds
LONGEST_PAUSE_S = 30.0  # between two attempts to start what keeps ending
STEADY_S = 60.0  # a child that ran this long is no longer in a series of crashes
_LOOK_EVERY_S = 0.2
_DATABASE_LOOK_EVERY_S = 1.0


class StartError(FusionError):
    """The service cannot be started."""

    kind = "start"


@dataclass
class Child:
    """One process, restarted with growing pauses while it keeps ending by itself."""

    name: str
    command: Sequence[str]
    environment: dict[str, str]
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    restart_s: float = 0.0
    pause_s: float = 1.0

    def start(self) -> None:
        """Start it in its own session: a Ctrl-C in the terminal is for the parent, which stops everything.

        The pipe at its standard input is never written to. It closes when the parent dies, however it dies.
        """
        self.started_s = time.monotonic()
        self.process = subprocess.Popen(  # noqa: S603 - our own program with our own arguments
            self.command, env=self.environment, stdin=subprocess.PIPE, start_new_session=True
        )

    def look_after(self, console: Console) -> None:
        """Start it again if it has ended, after a pause that doubles from crash to crash."""
        now = time.monotonic()
        if self.process is not None and self.process.poll() is not None:
            self.pause_s = 1.0 if now - self.started_s > STEADY_S else min(self.pause_s * 2, LONGEST_PAUSE_S)
            self.restart_s = now + self.pause_s
            ended = self.process.returncode
            console.complain(
                f"the {self.name} ended with status {ended}; starting it again in {self.pause_s:.0f} s."
            )
            self.process = None
        if self.process is None and now >= self.restart_s:
            self.start()

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self.process is not None and self.process.poll() is None


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
                console.complain(
                    f"PostgreSQL ended by itself and was started again; {self.cluster.log_path} may say why."
                )
            self.pause_s = _DATABASE_LOOK_EVERY_S
        except Exception as error:  # whatever it is, API and worker are to go on as soon as it is over
            self.pause_s = min(self.pause_s * 2, LONGEST_PAUSE_S)
            console.complain(
                f"PostgreSQL ended and could not be started again; trying once more in {self.pause_s:.0f} s. "
                f"{sentence(error)}"
            )
        self.next_look_s = time.monotonic() + self.pause_s


@dataclass
class Service:
    """API and worker on one database; use as a context manager, which returns once the API is ready.

    With a ``cluster``, the database in it is looked after as well.
    """

    settings: Settings
    console: Console
    cluster: EmbeddedPostgres | None = None
    children: list[Child] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.settings = self.settings.model_copy(update={"port": free_port(self.settings)})
        for name in ("api", "worker"):
            command = [sys.executable, "-m", "app.cli", name, "--stop-with-parent"]
            self.children.append(Child(name, command, child_environment(self.settings)))

    @property
    def address(self) -> str:
        """Where the API listens, as this machine reaches it."""
        host = self.settings.host
        host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(host, host)  # noqa: S104 - compared, not bound
        return (
            f"http://[{host}]:{self.settings.port}" if ":" in host else f"http://{host}:{self.settings.port}"
        )

    def __enter__(self) -> Self:
        try:
            for child in self.children:
                child.start()
            self._await_ready()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def serve_forever(self) -> None:
        """Look after the children until a signal interrupts (``stop_signals``)."""
        watched: list[Child | DatabaseWatch] = [*self.children]
        if self.cluster is not None:
            watched.insert(0, DatabaseWatch(self.cluster))
        while True:
            time.sleep(_LOOK_EVERY_S)
            for one in watched:
                one.look_after(self.console)

    def stop(self) -> None:
        """End every child: asked first, killed after ``STOP_TIMEOUT_S``; no signal interrupts this."""
        with _signals_ignored():
            running = [c.process for c in self.children if c.process is not None and c.running]
            for process in running:
                process.terminate()
            deadline = time.monotonic() + STOP_TIMEOUT_S
            for process in running:
                try:
                    process.wait(max(deadline - time.monotonic(), 0.01))
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            for child in self.children:
                if child.process is not None and child.process.stdin is not None:
                    child.process.stdin.close()
                child.process = None

    def _await_ready(self) -> None:
        api = self.children[0]
        deadline = time.monotonic() + READY_TIMEOUT_S
        with httpx.Client(base_url=self.address, timeout=5.0, trust_env=False) as client:
            while time.monotonic() < deadline:
                if not api.running:
                    raise StartError("The API ended while it was starting. The lines above say why.")
                try:
                    if client.get("/readyz").is_success:
                        return
                except httpx.TransportError:
                    pass
                time.sleep(0.05)
        raise StartError(f"The API was not ready within {READY_TIMEOUT_S:.0f} s.")


def child_environment(settings: Settings) -> dict[str, str]:
    """The environment in which a child reads exactly these settings."""
    changed = settings.model_dump(mode="json", exclude_none=True)
    ours = {ENV_PREFIX + name.upper(): str(value) for name, value in changed.items()}
    return {name: v for name, v in os.environ.items() if not name.startswith(ENV_PREFIX)} | ours


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
            f"{settings.host}:{settings.port} cannot be listened on ({error.strerror}). Is a service running "
            "there already? Choose another with --port or --host."
        ) from error


def reach(settings: Settings) -> str:
    """The sentence that says who can reach the service."""
    if settings.host in LOOPBACK:
        return "Only this machine can reach it: there is no access control yet. --host changes that."
    return (
        f"Warning: it listens on {settings.host or 'every address'} and has no access control yet: whoever "
        "reaches that address can upload and delete."
    )


@contextmanager
def stop_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP do what Ctrl-C does: leave the block by ``KeyboardInterrupt``, caught here."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    wanted = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
    former = {number: signal.signal(number, interrupt) for number in wanted}
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def stop_with_parent() -> None:
    """End this process as by SIGTERM once its standard input closes, as it does when the parent dies."""

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _signals_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    wanted = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
    former = {number: signal.signal(number, signal.SIG_IGN) for number in wanted}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
