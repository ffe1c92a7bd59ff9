"""The service as ``versant up`` runs it, on an embedded cluster, and ways to kill its parts.

What is started again, how and after how long, is the service's own supervisor's affair.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import psycopg

from accuracy.arguments import REPOSITORY
from app.cli.children import Child, Children, Watched, child_environment
from app.cli.console import Console
from app.cli.database import open_cluster
from app.cli.supervisor import DatabaseWatch, Service
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from service.watching import repeated
from soak.servers import kill_server

WORKERS = 2
HEARTBEAT_S, STALLED_S, PUBLISH_EVERY_S = 1.0, 5.0, 5.0
"""Shorter than usual, so that ten minutes hold what else takes an hour."""
RESTART_S = 0.5
"""Half of the pause before what was killed is started again: kills are no series of crashes."""
MOST_DEATHS = 1
"""A drive that takes three processes along is given up on purpose. Who computes one that has lost more is spared."""

_LOOK_EVERY_S = 0.2

_IN_DANGER = "SELECT EXISTS (SELECT FROM computations WHERE deaths > %s AND since IS NOT NULL)"
_BACKENDS = """
    SELECT pid FROM pg_stat_activity
    WHERE datname = current_database() AND backend_type = 'client backend' AND pid <> pg_backend_pid()
"""


@dataclass(frozen=True)
class Diary(Console):
    """What the supervisor complains of goes into the log of its children."""

    path: Path = Path()

    def complain(self, text: str) -> None:
        """Write a line."""
        with self.path.open("a") as file:
            file.write(f"{datetime.now(UTC):%H:%M:%S} {text}\n")


class Counting(Protocol):
    """Something that is counted while the service is disturbed."""

    def counted(self) -> AbstractContextManager[None]:
        """Count within the block."""

    def rows(self) -> list[dict[str, float | str]]:
        """What was counted: ``what``, ``mean``, ``most``."""


Kill = Callable[[random.Random], bool]
"""Whether there was something to kill."""


@dataclass(frozen=True)
class Parts:
    """What a service is made of."""

    settings: Settings
    """Those of its commands."""
    apis: Sequence[Child]
    addresses: Sequence[str]
    """Of the APIs."""
    workers: Sequence[Child]


class Disturbed:
    """A running service."""

    def __init__(
        self,
        parts: Parts,
        cluster: EmbeddedPostgres,
        log: Path,
        more: Mapping[str, Kill] = MappingProxyType({}),
        connections: Counting | None = None,
    ) -> None:
        """``more``: what else can be killed; ``connections``: what counts them."""
        self.parts, self.cluster, self.log, self.connections = parts, cluster, log, connections
        self.settings = parts.settings
        self.url = libpq_url(str(self.settings.session_url))
        self.kills: Mapping[str, Kill] = {
            "API": self._kill_api,
            "worker": self._kill_worker,
            "postmaster": lambda _: kill_server(cluster.log_path.parents[1]),
            "backend": self._kill_backend,
            **more,
        }

    def ask(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        """The rows of a query."""
        with psycopg.connect(self.url, autocommit=True, connect_timeout=5) as connection:
            return connection.execute(query.encode(), values or None).fetchall()

    def begin(self, *arguments: str) -> subprocess.Popen[bytes]:
        """A command of ours on this service's database, as a process; what it prints goes into the log."""
        with self.log.open("ab") as output:
            return subprocess.Popen(
                [sys.executable, "-m", "app.cli", *arguments],
                cwd=REPOSITORY,
                env=child_environment(self.settings),
                stdout=output,
                stderr=output,
            )

    def _kill_api(self, rng: random.Random) -> bool:
        return _kill_child(rng.choice(self.parts.apis))

    def _kill_worker(self, rng: random.Random) -> bool:
        try:
            if self.ask(_IN_DANGER, MOST_DEATHS)[0][0]:
                return False
        except psycopg.Error:  # the database is down: a good moment
            pass
        process = rng.choice(self.parts.workers).process
        if process is None or process.pid is None:
            return False
        with suppress(OSError):  # one of the lanes, or what they are forked from
            lanes = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            return _kill(rng.choice([process.pid, *map(int, lanes)]))
        return False

    def _kill_backend(self, rng: random.Random) -> bool:
        """PostgreSQL takes all others along and repairs itself."""
        try:
            backends = self.ask(_BACKENDS)
        except psycopg.Error:
            return False
        return bool(backends) and _kill(rng.choice(backends)[0])


def short_waits(**more: Any) -> Settings:
    """The settings that every machine has."""
    return Settings(
        access="open",
        port=0,
        heartbeat_interval_s=HEARTBEAT_S,
        stalled_after_s=STALLED_S,
        publish_every_s=PUBLISH_EVERY_S,
        **more,
    )


@contextmanager
def disturbed(folder: Path) -> Iterator[Disturbed]:
    """Start it in ``folder`` and keep it running until the block ends."""
    settings = short_waits(data_dir=folder / "data", worker_concurrency=WORKERS)
    log = folder / "service.log"
    with open_cluster(settings) as cluster:
        service = Service(
            settings.model_copy(update={"database_url": cluster.url}), Diary(path=log), cluster=cluster
        )
        log_into(log, service)
        with service, looked_after(service, DatabaseWatch(cluster)):
            api, workers = service.children
            yield Disturbed(Parts(service.settings, [api], [service.address], [workers]), cluster, log)


def log_into(log: Path, service: Children) -> None:
    """Let everything that the children print go into a file."""
    for child in service.children:
        # The shell becomes the child: signals reach it.
        child.command = ["/bin/sh", "-c", 'log=$0; exec "$@" >>"$log" 2>&1', str(log), *child.command]


@contextmanager
def looked_after(service: Children, *others: Watched) -> Iterator[None]:
    """As ``versant up`` does, in a thread."""

    def look() -> None:
        for part in (*others, *service.children):
            part.look_after(service.console)

    with repeated(look, _LOOK_EVERY_S):
        yield


def _kill_child(child: Child) -> bool:
    process, child.pause_s = child.process, RESTART_S
    return process is not None and process.pid is not None and process.poll() is None and _kill(process.pid)


def _kill(pid: int) -> bool:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
        return True
    return False
