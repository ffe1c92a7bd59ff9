"""The service as ``versant up`` runs it, on an embedded cluster, and ways to kill its parts.

What is started again, how and after how long, is the service's own supervisor's affair.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import psycopg

from app.cli.children import Child, Watched, child_environment
from app.cli.console import Console
from app.cli.database import open_cluster
from app.cli.supervisor import DatabaseWatch, Service
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.postmaster import running_postmaster

CHECKOUT = Path(__file__).resolve().parents[2]

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


class Disturbed:
    """A running service; what kills returns whether there was something to kill."""

    def __init__(self, service: Service, cluster: EmbeddedPostgres, log: Path) -> None:
        self.service, self.cluster, self.log = service, cluster, log
        self.settings = service.settings
        self.url = libpq_url(str(self.settings.database_url))
        self.kills: Mapping[str, Callable[[random.Random], bool]] = {
            "API": self._kill_api,
            "worker": self._kill_worker,
            "postmaster": self._kill_postmaster,
            "backend": self._kill_backend,
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
                cwd=CHECKOUT,
                env=child_environment(self.settings),
                stdout=output,
                stderr=output,
            )

    def _kill_api(self, rng: random.Random) -> bool:
        return _kill_child(self.service.children[0])

    def _kill_worker(self, rng: random.Random) -> bool:
        try:
            if self.ask(_IN_DANGER, MOST_DEATHS)[0][0]:
                return False
        except psycopg.Error:  # the database is down: a good moment
            pass
        process = self.service.children[1].process
        if process is None or process.pid is None:
            return False
        with suppress(OSError):  # one of the lanes, or what they are forked from
            lanes = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            return _kill(rng.choice([process.pid, *map(int, lanes)]))
        return False

    def _kill_postmaster(self, rng: random.Random) -> bool:
        server = running_postmaster(self.settings.data_dir / "postgres" / "data")
        return server is not None and _kill(server.pid)

    def _kill_backend(self, rng: random.Random) -> bool:
        """PostgreSQL takes all others along and repairs itself."""
        try:
            backends = self.ask(_BACKENDS)
        except psycopg.Error:
            return False
        return bool(backends) and _kill(rng.choice(backends)[0])


@contextmanager
def disturbed(folder: Path) -> Iterator[Disturbed]:
    """Start it in ``folder`` and keep it running until the block ends."""
    settings = Settings(
        data_dir=folder / "data",
        access="open",
        port=0,
        worker_concurrency=WORKERS,
        heartbeat_interval_s=HEARTBEAT_S,
        stalled_after_s=STALLED_S,
        publish_every_s=PUBLISH_EVERY_S,
    )
    log = folder / "service.log"
    with open_cluster(settings) as cluster:
        service = Service(
            settings.model_copy(update={"database_url": cluster.url}), Diary(path=log), cluster=cluster
        )
        for child in service.children:
            # The shell becomes the child: signals reach it.
            child.command = ["/bin/sh", "-c", 'log=$0; exec "$@" >>"$log" 2>&1', str(log), *child.command]
        with service, _looked_after(service, cluster):
            yield Disturbed(service, cluster, log)


@contextmanager
def _looked_after(service: Service, cluster: EmbeddedPostgres) -> Iterator[None]:
    """As ``versant up`` does, in a thread."""
    over = threading.Event()

    def look() -> None:
        parts: tuple[Watched, ...] = (DatabaseWatch(cluster), *service.children)
        while not over.wait(_LOOK_EVERY_S):
            for part in parts:
                part.look_after(service.console)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _kill_child(child: Child) -> bool:
    process, child.pause_s = child.process, RESTART_S
    return process is not None and process.pid is not None and process.poll() is None and _kill(process.pid)


def _kill(pid: int) -> bool:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
        return True
    return False
