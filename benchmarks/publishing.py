#!/usr/bin/env python3
"""How fast a real service publishes drives: many at once by some workers, one alone, and beside another checkout.

    python benchmarks/publishing.py [--roads FILE.osm.pbf] [--drives 200] [--workers 1,2,4] [--alone 5]
                                    [--before CHECKOUT] [--before-workers 2] [--json FILE]

Drives of 10 km wander over the map (default: Heidelberg, beside the repository) and log at 1 Hz what an ordinary
receiver with Doppler, pitch and specific force does (``profile_speed.record``), each at a time of its own. For each
number of workers a database is made in an embedded cluster with the settings of ``versant up``, the roads are imported,
an API and so many ``versant worker`` of one lane each are started as processes, which share the cores as the lanes of
one worker do, and one drive goes through them to warm up. Then all drives are uploaded while no worker runs, and the
workers started.

    drives/s    drives over the time from the first that was begun to the last that was done
    workers s   processor seconds of a drive in the processes of the workers, what they load at first (3 s) included
    database s  the same of PostgreSQL's processes
    longest s   from the beginning of a drive to its end, at most: solvers let cells wait while drives do
    alone s     of ``--alone`` further drives, one by one into the idle service: from upload to ``done``, median
    lock waits  of 100 ms and longer, as PostgreSQL logs them, and the longest
    settled     how far slopes are from what ``versant settle`` makes of the same drives: 99 % within, and all, sigmas

``--before`` runs the same, with as many drives, by the code of another checkout, as a rule the parent commit: how fast
it is depends on how many drives there are already.

Aims: 8 times the parent's rate with two workers; two workers 1.7 times one; alone 3 s; no lock waits; 99 % within 0.1.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import psycopg

from accuracy.arguments import REPOSITORY, add_roads, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.core import databases
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from service.logs import make_logs
from service.processes import Service
from service.processor import used_s

COLUMNS = {
    "code": ("code", ""),
    "workers": ("workers", "g"),
    "drives": ("drives", "g"),
    "rate": ("drives/s", ".2f"),
    "workers_s": ("workers s", ".2f"),
    "database_s": ("database s", ".2f"),
    "longest_s": ("longest s", ".1f"),
    "alone_s": ("alone s", ".2f"),
    "lock_waits": ("lock waits", "g"),
    "longest_wait_ms": ("longest ms", ".0f"),
    "settled_99": ("99 % within", ".3f"),
    "settled_all": ("all", ".3f"),
}


@dataclass(frozen=True)
class Result:
    """Figures of one run; None: not measured."""

    code: str
    workers: int
    drives: int
    rate: float
    workers_s: float
    database_s: float
    longest_s: float
    alone_s: float
    lock_waits: int
    longest_wait_ms: float
    settled_99: float | None
    settled_all: float | None


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--workers", default="1,2,4")
    parser.add_argument("--alone", type=int, default=5)
    parser.add_argument("--before", type=Path, metavar="CHECKOUT")
    parser.add_argument("--before-workers", default="2")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="versant-bench-") as folder:
        logs = make_logs(args.roads, args.drives + args.alone + 1, Path(folder))
        results = []
        if args.before is not None:
            for count in map(int, args.before_workers.split(",")):
                results.append(
                    run("before", args.before.resolve(), args, logs, args.drives, count, settle=False)
                )
        results += [
            run("now", REPOSITORY, args, logs, args.drives, count)
            for count in map(int, args.workers.split(","))
        ]
    show_progress("")
    rows = [asdict(result) for result in results]
    print(text_table(rows, COLUMNS))
    for line in ratios(results):
        print(line)
    write_json(args.json, rows)


def ratios(results: Sequence[Result]) -> list[str]:
    """The rates beside each other, a sentence each."""
    rate = {(r.code, r.workers): r.rate for r in results}
    pairs = [
        (("now", 2), ("now", 1)),
        (("now", 4), ("now", 2)),
        *((("now", n), ("before", n)) for n in (1, 2, 4)),
    ]
    return [
        f"{one[1]} workers {one[0]}: {rate[one] / rate[other]:.2f} times {other[1]} {other[0]}"
        for one, other in pairs
        if one in rate and other in rate
    ]


def run(
    code: str,
    checkout: Path,
    args: argparse.Namespace,
    logs: Sequence[bytes],
    drives: int,
    workers: int,
    *,
    settle: bool = True,
) -> Result:
    """One database, one API, so many workers."""
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        databases.ensure_database(cluster.url, "publishing")
        url = libpq_url(cluster.url_of("publishing"))
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute("ALTER DATABASE publishing SET log_lock_waits = on")
            connection.execute("ALTER DATABASE publishing SET deadlock_timeout = '100ms'")
        service = Service(checkout, url, Path(folder), threads=max(1, (os.cpu_count() or 1) // workers))
        show_progress(f"{code}, {workers} workers: roads")
        service.command("migrate")
        service.command("import-roads", str(args.roads))
        with service.started("api", "--port", str(service.port)):
            service.await_ready()
            with service.started(*service.worker):
                service.send(logs[-1])
                service.await_done()
            log_bytes = cluster.log_path.stat().st_size
            for log in logs[:drives]:
                service.send(log)
            server = postmaster_of(Path(folder))
            before_s = used_s([server])
            with started_all(service, workers) as pids:
                service.await_done(
                    lambda finished: show_progress(f"{code}, {workers} workers: {finished} of {drives}")
                )
                workers_s, database_s = used_s(pids), used_s([server]) - before_s
                rate, longest = service.throughput(drives)
                alone = [service.alone(log) for log in logs[drives : drives + args.alone]]
            waits = lock_waits(cluster.log_path, log_bytes)
        moved_99, moved = service.moved_by_settling() if settle else (None, None)
    return Result(
        code,
        workers,
        drives,
        rate,
        workers_s / drives,
        database_s / drives,
        longest,
        statistics.median(alone),
        len(waits),
        max(waits, default=0.0),
        moved_99,
        moved,
    )


@contextmanager
def started_all(service: Service, workers: int) -> Iterator[list[int]]:
    """So many workers; the numbers of their processes."""
    with ExitStack() as stack:
        yield [stack.enter_context(service.started(*service.worker)).pid for _ in range(workers)]


def postmaster_of(folder: Path) -> int:
    """The process of the cluster in the folder from which all others of it descend."""
    return int((folder / "postgres" / "data" / "postmaster.pid").read_text().split()[0])


def lock_waits(log: Path, from_byte: int) -> list[float]:
    """How long locks were waited for, ms, as the server's log has it from a place on."""
    with log.open("rb") as file:
        file.seek(from_byte)
        text = file.read().decode(errors="replace")
    return [float(ms) for ms in re.findall(r"acquired .* after ([\d.]+) ms", text)]


if __name__ == "__main__":
    main()
