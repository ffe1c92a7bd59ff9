#!/usr/bin/env python3
"""Whether a real service goes on answering while everything is asked of it at once.

    PYTHONPATH=.:benchmarks python -m service.load [--roads FILE.osm.pbf] [--drives 60] [--streams 600]
                                                   [--keep DIR] [--json FILE]

A map (default: Heidelberg, beside the repository) is imported into an embedded cluster with the settings of ``versant
up``, and twice ``--drives`` drives of 10 km are uploaded and published. Then API and workers run as ``versant up``
starts them, and at once come

- an ``import-roads`` of the same map without every two-hundredth way, so that there is something to merge and to solve,
- the removal of one half of the drives and a picture of the profile of each other one,
- so many event streams of a drive that tells its progress twice a second,
- ten vector and ten GeoJSON tiles of zoom 8, whose clients leave after a third of a second.

It lasts until the import has ended, all is answered and the last removed drive has left the map. A process of its own
asks meanwhile for four routes, each ten times a second on a new connection, whatever the others take; before that, for
some seconds, of the idle service (``idle``). The load's clients, the workers, the import and PostgreSQL share the
machine's cores with the API, and so does whatever else the machine does: its load before the start is printed.

    median, p99, max   ms of the answers to the prober
    not 2xx            its answers of another status
    memory             of the API and the process in which it draws: the sum of what each had at most (VmHWM), and the
                       most that both had resident at once

Aims: ``/healthz`` under 50 ms, the others under 1 s, throughout; 400 MB.

``--keep`` leaves the published drives in a folder, from which a further run begins.
"""

from __future__ import annotations

import itertools
import math
import os
import shutil
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import osmium
import psycopg

from accuracy.arguments import REPOSITORY, add_roads, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core import databases
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from service.crowd import Asked, ask_and_leave, following
from service.logs import make_logs
from service.memory import watched
from service.probing import Answers, probing
from service.processes import Service
from service.watching import repeated

FILLED = "filled"
REGION = "load"

IDLE_S, WARM_UP_S = 10.0, 5.0
"""The workers start beside the API, and load for some seconds."""
WIDE_TILES, LEAVE_AFTER_S = 10, 0.3
TELL_EVERY_S = 0.5
IMPORT_AHEAD_S = 1.0
"""The import has begun to work when the rest comes."""
LONGEST_S = 600.0
LEFT_OUT = 200
"""One in so many ways is not in the map that is imported beside."""

COLUMNS = {
    "phase": ("", ""),
    "route": ("route", ""),
    "asked": ("asked", "g"),
    "median_ms": ("median", ".1f"),
    "p99_ms": ("p99", ".1f"),
    "max_ms": ("max ms", ".1f"),
    "others": ("not 2xx", ""),
}


@dataclass(frozen=True)
class Load:
    """What was asked for, and how it went."""

    load_before: float
    """Of the machine, the average of the minute before."""
    lasted_s: float
    import_s: float
    streams: dict[str, int]
    """By status."""
    most_streams: int
    fewest_events: int
    answers: dict[str, dict[str, int]]
    memory_at_rest_mb: float
    memory_mb: float
    memory_at_once_mb: float
    processes_mb: list[float]


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--drives", type=int, default=60, help="to be removed, and as many to be drawn")
    parser.add_argument("--streams", type=int, default=600)
    parser.add_argument("--keep", type=Path, metavar="DIR")
    args = parser.parse_args()
    with ExitStack() as held:
        folder = args.keep or Path(held.enter_context(tempfile.TemporaryDirectory(prefix="versant-load-")))
        folder.mkdir(parents=True, exist_ok=True)
        cluster = held.enter_context(EmbeddedPostgres(folder / "cluster"))
        if not (folder / "ready").exists():
            fill(cluster, folder, args.roads, 2 * args.drives)
        idle, busy, load = run(cluster, folder, args.drives, args.streams)
    show_progress("")
    rows = [_row("idle", answers) for answers in idle] + [_row("load", answers) for answers in busy]
    print(text_table(rows, COLUMNS))
    for line in sentences(load):
        print(line)
    write_json(args.json, {"routes": rows, **asdict(load)})


def fill(cluster: EmbeddedPostgres, folder: Path, roads: Path, drives: int) -> None:
    """The database of which every run has a copy, and the map that is imported in it."""
    logs = make_logs(roads, drives, folder)
    without_some(roads, folder / "changed.osm.pbf")
    databases.ensure_database(cluster.url, FILLED)
    service = Service(REPOSITORY, libpq_url(cluster.url_of(FILLED)), folder / FILLED)
    show_progress("roads")
    service.command("migrate")
    service.command("import-roads", str(roads), "--region", REGION)
    with service.started("api", "--port", str(service.port)), service.started("worker"):
        service.await_ready()
        for log in logs:
            service.send(log)
        service.await_done(lambda finished: show_progress(f"{finished} of {drives} drives"))
    with psycopg.connect(service.url, autocommit=True) as connection:
        connection.execute("VACUUM ANALYZE")
    (folder / "ready").touch()


def without_some(roads: Path, changed: Path) -> None:
    """Write the map again without one in ``LEFT_OUT`` ways."""
    changed.unlink(missing_ok=True)
    with osmium.SimpleWriter(str(changed)) as writer:
        for thing in osmium.FileProcessor(str(roads)):
            if not (isinstance(thing, osmium.osm.Way) and thing.id % LEFT_OUT == 0):
                writer.add(thing)


def run(
    cluster: EmbeddedPostgres, folder: Path, drives: int, streams: int
) -> tuple[list[Answers], list[Answers], Load]:
    """The idle service, then the load; on a copy of what ``folder`` holds."""
    with tempfile.TemporaryDirectory(prefix="versant-load-") as scratch:
        name = f"run_{uuid.uuid4().hex[:8]}"
        databases.ensure_database(cluster.url, name, template=FILLED)
        shutil.copytree(folder / FILLED, Path(scratch) / "data")
        service = Service(REPOSITORY, libpq_url(cluster.url_of(name)), Path(scratch) / "data")
        # All of it comes from one address, which would else be one client among others.
        service.environment = {
            **service.environment,
            "VERSANT_EVENTS_MAX": str(2 * streams),
            "VERSANT_EVENTS_PER_CLIENT": str(streams),
            "VERSANT_CONNECTIONS_MAX": str(4 * streams + 1000),
            "VERSANT_CONNECTIONS_PER_CLIENT": str(2 * streams + 500),
        }
        load_before = os.getloadavg()[0]
        with (
            service.started("api", "--port", str(service.port)) as api,
            service.started("worker"),
            watched(api.pid) as memory,
        ):
            service.await_ready()
            z8, z14 = tiles_of(service.url)
            routes = ["/healthz", "/readyz", "/v1/drives", f"/tiles/{z14}.mvt"]
            with probing(service.port, routes, Path(scratch) / "probes") as probes:
                time.sleep(WARM_UP_S + IDLE_S)
                began, at_rest_mb = time.time(), memory.now_mb
                figures = make_load(service, folder / "changed.osm.pbf", drives, streams, z8)
                ended = time.time()
            idle = probes.between(began - IDLE_S, began)
            busy = probes.between(began, ended)
        load = Load(
            load_before=load_before,
            lasted_s=ended - began,
            memory_at_rest_mb=at_rest_mb,
            memory_mb=memory.sum_mb,
            memory_at_once_mb=memory.at_once_mb,
            processes_mb=sorted(memory.own_mb.values(), reverse=True),
            **figures,
        )
        databases.drop_database(cluster.url, name)
    return idle, busy, load


def make_load(service: Service, changed: Path, drives: int, streams: int, z8: str) -> dict[str, Any]:
    """Ask for everything at once; what came of it."""
    show_progress("load")
    with psycopg.connect(service.url, autocommit=True) as connection:
        ids = [
            row[0]
            for row in connection.execute(
                "SELECT id FROM drives WHERE status = 'done' ORDER BY id"
            ).fetchall()
        ]
        removed, drawn = ids[:drives], ids[drives : 2 * drives]
        with telling(service.url) as listeners:
            begin = time.monotonic()
            importing = service.begin("import-roads", str(changed), "--region", REGION, "--yes")
            time.sleep(IMPORT_AHEAD_S)
            with following(service.port, f"/v1/drives/{listeners}/events", streams) as followers:
                asked = Asked(
                    service.address,
                    [("DELETE", f"/v1/drives/{one}") for one in removed]
                    + [("GET", f"/v1/drives/{one}/profile?f=png") for one in drawn],
                )
                wide = [f"/tiles/{z8}.{form}" for form in ("mvt", "geojson") for _ in range(WIDE_TILES)]
                ask_and_leave(service.port, wide, LEAVE_AFTER_S)
                answers = asked.await_all()
                if importing.wait(LONGEST_S):
                    sys.exit("the import failed")
                import_s = time.monotonic() - begin
                await_removed(connection)
    return {
        "import_s": import_s,
        "streams": followers.statuses,
        "most_streams": followers.most_at_once,
        "fewest_events": followers.fewest_events,
        "answers": answers,
    }


def await_removed(connection: psycopg.Connection[Any]) -> None:
    """Until no removed drive is left on the map."""
    ends = time.monotonic() + LONGEST_S
    while time.monotonic() < ends:
        (left,) = connection.execute("SELECT count(*) FROM drives WHERE status = 'cancelled'").fetchone() or (
            0,
        )
        if not left:
            return
        show_progress(f"{left} drives to be removed")
        time.sleep(0.2)
    sys.exit(f"drives were not removed within {LONGEST_S:.0f} s")


@contextmanager
def telling(url: str) -> Iterator[uuid.UUID]:
    """A drive that seems to be computed for as long as the block lasts, and tells its progress."""
    channel, steps = uuid.uuid4(), itertools.count(1)
    insert = """
        INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, stage, method, options)
        VALUES (%s, 'told', 'told', 1, 'told', 'running', 'estimating', 'raw', '{}')
    """

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(insert, (channel,))

        def tell() -> None:
            share = next(steps) % 100 / 100
            connection.execute("UPDATE drives SET progress = %s WHERE id = %s", (share, channel))

        with repeated(tell, TELL_EVERY_S):
            yield channel


def tiles_of(url: str) -> tuple[str, str]:
    """The tiles of zoom 8 and 14, as z/x/y, in which the middle of a drive lies."""
    middle = (
        "SELECT ST_X(c), ST_Y(c) FROM (SELECT ST_Centroid(bounds) AS c FROM drives ORDER BY id LIMIT 1) AS d"
    )
    with psycopg.connect(url) as connection:
        lon, lat = connection.execute(middle).fetchone() or (0.0, 0.0)
    x = (lon + 180) / 360
    y = (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2
    return f"8/{int(x * 2**8)}/{int(y * 2**8)}", f"14/{int(x * 2**14)}/{int(y * 2**14)}"


def _row(phase: str, answers: Answers) -> dict[str, Any]:
    return {
        "phase": phase,
        "route": answers.route,
        "asked": len(answers.took_ms),
        "median_ms": answers.median_ms,
        "p99_ms": answers.p99_ms,
        "max_ms": answers.max_ms,
        "others": counted(answers.unlike_2xx) or "none",
    }


def sentences(load: Load) -> list[str]:
    """What the table does not say."""
    processes = " + ".join(f"{mb:.0f}" for mb in load.processes_mb)
    return [
        f"The machine's load was {load.load_before:.1f} before. It lasted {load.lasted_s:.1f} s, the import "
        f"{load.import_s:.1f} s.",
        f"Event streams: {counted(load.streams)}; at once {load.most_streams}; each that was accepted received at "
        f"least {load.fewest_events} events.",
        *(f"{method}: {counted(statuses)}." for method, statuses in load.answers.items()),
        f"Memory: {processes} = {load.memory_mb:.0f} MB, at once {load.memory_at_once_mb:.0f} MB; "
        f"at rest {load.memory_at_rest_mb:.0f} MB.",
    ]


def counted(statuses: dict[str, int]) -> str:
    """Statuses with how often each came."""
    return ", ".join(f"{count} x {status}" for status, count in sorted(statuses.items()))


if __name__ == "__main__":
    main()
