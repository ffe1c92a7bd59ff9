"""The service on several machines, played by folders and ports.

PgBouncer stands before the primary, a hot standby follows it, two of three APIs read from that, and lanes have data
folders of their own. Logs and rasters are in folders that all reach. Commands run on the first machine.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import httpx
import psycopg

from app.cli.children import Child, Children, child_environment, versant, workers
from app.cli.console import Console
from app.cli.supervisor import DatabaseWatch, StartError, free_port
from app.core import migrate
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from service.watching import repeated
from soak.disturbed import Diary, Disturbed, Parts, log_into, looked_after, short_waits
from soak.servers import PgBouncer, find_pgbouncer, kill_server, make_primary, make_standby

LANES = 6
"""Of each machine."""
READS_STANDBY = (False, True, True)
"""For each API."""
SERVERS = 20
"""Connections of the pooler to the server."""
START_S = 120.0
AWAY_S = 1.0
"""After which what was killed is started again."""
LOOK_EVERY_S = 0.5

_KINDS = """
    SELECT application_name, count(*) FROM pg_stat_activity
    WHERE datname = current_database() AND backend_type = 'client backend' AND application_name <> '' GROUP BY 1
"""


@dataclass
class PoolerWatch:
    """Starts PgBouncer again when it has ended."""

    pooler: PgBouncer
    away_since_s: float | None = None

    def look_after(self, console: Console) -> None:
        """Look whether it is there."""
        if self.pooler.runs:
            self.away_since_s = None
        elif self.away_since_s is None:
            self.away_since_s = time.monotonic()
        elif time.monotonic() > self.away_since_s + AWAY_S:
            self.away_since_s = None
            done = "was" if self.pooler.launch() else "could not be"
            console.complain(f"PgBouncer {done} started again.")


@dataclass
class Machines(Children):
    """APIs and workers."""

    addresses: Sequence[str] = ()

    def await_ready(self) -> None:
        """Return once each API answers that it is."""
        ends = time.monotonic() + START_S
        for address in self.addresses:
            while not _is_ready(address):
                if time.monotonic() > ends:
                    raise StartError(f"The API at {address} was not ready within {START_S:.0f} s.")
                time.sleep(0.1)


def _is_ready(address: str) -> bool:
    with suppress(httpx.TransportError):
        return httpx.get(f"{address}/readyz", timeout=5.0, trust_env=False).is_success
    return False


@contextmanager
def fleet(folder: Path, machines: int) -> Iterator[Disturbed]:
    """Start it in ``folder`` and keep it running until the block ends."""
    program = find_pgbouncer()
    if program is None:
        raise StartError("PgBouncer is missing (Debian: apt-get install pgbouncer).")
    places = {name: folder / name for name in ("primary", "standby", "pooler", "shared")}
    for place in places.values():
        place.mkdir()
    log = folder / "service.log"
    with ExitStack() as stack:
        make_primary(places["primary"])
        primary = stack.enter_context(EmbeddedPostgres(places["primary"]))
        migrate.upgrade(primary.url, finish=True)
        standby = stack.enter_context(make_standby(primary, places["standby"]))
        pooler = PgBouncer(program, primary.url, SERVERS, places["pooler"])
        pooler.start()
        stack.callback(pooler.kill)
        parts = _parts(folder, places["shared"], primary.url, standby.url, pooler.url, machines)
        console = Diary(path=log)
        children = Machines(parts.settings, console, [*parts.apis, *parts.workers], addresses=parts.addresses)
        log_into(log, children)
        stack.enter_context(children)
        watches = DatabaseWatch(primary), DatabaseWatch(standby), PoolerWatch(pooler)
        stack.enter_context(looked_after(children, *watches))
        more = {"PgBouncer": lambda _: pooler.kill(), "standby": lambda _: kill_server(places["standby"])}
        yield Disturbed(parts, primary, log, more, Connections(primary.url, standby.url, pooler))


def _parts(folder: Path, shared: Path, primary: str, standby: str, pooler: str, machines: int) -> Parts:
    common = {
        "database_url": pooler,
        "database_pooled": True,
        "database_direct_url": primary,
        "blob_url": (shared / "blobs").as_uri(),
        "dem_url": (shared / "dem").as_uri(),
        "worker_concurrency": LANES,
    }
    every = [short_waits(data_dir=folder / f"machine {n + 1}", **common) for n in range(machines)]
    apis, addresses = [], []
    for n, reads in enumerate(READS_STANDBY):
        port = free_port(every[0])
        changed = {"port": port} | ({"database_read_url": standby} if reads else {})
        settings = every[n % machines].model_copy(update=changed)
        apis.append(Child(f"api {n + 1}", versant("api"), child_environment(settings)))
        addresses.append(f"http://127.0.0.1:{port}")
    return Parts(every[0], apis, addresses, [_lanes(one) for one in every])


def _lanes(settings: Settings) -> Child:
    child = workers(settings)
    child.name = f"workers of {settings.data_dir.name}"
    return child


class Connections:
    """Counts connections, by where they lead and by what they call themselves, while the block lasts."""

    def __init__(self, primary: str, standby: str, pooler: PgBouncer) -> None:
        self._servers = {"primary": libpq_url(primary), "standby": libpq_url(standby)}
        self._pooler = pooler
        self._counts: defaultdict[str, list[int]] = defaultdict(list)
        self._looks: defaultdict[str, int] = defaultdict(int)

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count within the block."""

        def look() -> None:
            with suppress(psycopg.Error):  # it was killed
                self._count(
                    "PgBouncer", dict(zip(("clients", "servers"), self._pooler.connections(), strict=True))
                )
            for server, url in self._servers.items():
                with (
                    suppress(psycopg.Error),
                    psycopg.connect(url, autocommit=True, connect_timeout=5) as there,
                ):
                    self._count(server, dict(there.execute(_KINDS.encode()).fetchall()))

        with repeated(look, LOOK_EVERY_S):
            yield

    def _count(self, where: str, kinds: dict[str, int]) -> None:
        self._looks[where] += 1
        for kind, count in {**kinds, "all": sum(kinds.values())}.items():
            self._counts[f"{where}, {kind}"].append(count)

    def rows(self) -> list[dict[str, float | str]]:
        """Mean and most of each kind, of the moments at which its server answered."""
        return [
            {"what": what, "mean": sum(counts) / self._looks[what.partition(",")[0]], "most": max(counts)}
            for what, counts in sorted(self._counts.items())
            if what != "PgBouncer, all"
        ]
