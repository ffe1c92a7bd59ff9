#!/usr/bin/env python3
"""What memory the lanes of a worker take, at rest and over a time of ordinary drives.

    PYTHONPATH=.:benchmarks python -m service.lane_memory [--minutes 8] [--lanes 2] [--roads FILE.osm.pbf]
        [--dem FILE.hgt] [--empty-cache] [--json FILE]

A worker on an embedded cluster, as ``versant worker`` starts it, computes drives of 10 km over a map (default:
Heidelberg with its elevations, beside the repository), each at a time of its own, in every lane for as long as asked.
With ``--empty-cache`` nothing has been compiled before (``NUMBA_CACHE_DIR`` names an empty folder).

    at rest            after the worker has begun, before the first drive
    PSS                of a lane: its own pages, and its share of those that several processes have
    own                of a lane: what it has and no other process

Aims: 100 MB (PSS) at rest, 600 MB at most, with and without what was compiled.
"""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psycopg

from accuracy.arguments import ELEVATIONS, REPOSITORY, add_roads, parser_of
from accuracy.logs import write_columns
from accuracy.scoring import show_progress, text_table, write_json
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from fusion.roads.osm import read_roads
from profile_speed import record
from service.logs import APART_S, HOURS, columns_of
from service.processes import Service
from service.watching import children, command_of, pages_kb, repeated

LOOK_EVERY_S = 0.25
AT_REST_S = 10.0
PATIENCE_S = 600.0
WAITING = 4
"""Drives that are not published yet, at any time: no lane waits for one, and no solver for dozens over one street."""
COLUMNS = {
    "when": ("", ""),
    "pss_mb": ("PSS MB", ".0f"),
    "own_mb": ("own MB", ".0f"),
}


@dataclass
class Lanes:
    """The most of any lane, MB."""

    worker: int
    pss_mb: float = 0.0
    own_mb: float = 0.0
    seen: set[int] = field(default_factory=set)

    def look(self) -> int:
        """Look once; how many lanes there are."""
        lanes = [pid for pid in lanes_of(self.worker) if began(pid)]
        for pid in lanes:
            if pages := pages_kb(pid):
                self.pss_mb = max(self.pss_mb, pages["Pss"] / 1024)
                self.own_mb = max(self.own_mb, (pages["Private_Clean"] + pages["Private_Dirty"]) / 1024)
                self.seen.add(pid)
        return len(lanes)


def lanes_of(worker: int) -> list[int]:
    """The children of the worker's child: those that a compiler or a database command has begun are others."""
    found: list[int] = []
    for nursery in children(worker):
        found += [pid for pid in children(nursery) if command_of(pid)[2:4] == ["app.cli", "worker"]]
    return found


def began(pid: int) -> bool:
    """Whether it has threads beside its first: those of the queue."""
    with suppress(OSError):
        return len(list(Path(f"/proc/{pid}/task").iterdir())) > 1
    return False


def main() -> None:
    """Measure, print and write."""
    parser = parser_of(__doc__)
    parser.add_argument("--minutes", type=float, default=8.0, help="of drives")
    parser.add_argument("--lanes", type=int, default=2)
    add_roads(parser)
    parser.add_argument("--dem", type=Path, default=ELEVATIONS)
    parser.add_argument("--empty-cache", action="store_true", help="nothing has been compiled before")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="versant-lanes-") as name:
        folder = Path(name)
        with EmbeddedPostgres(folder, durable=False) as cluster:
            service = Service(REPOSITORY, libpq_url(cluster.url), folder / "data")
            if args.empty_cache:
                service.environment = {**service.environment, "NUMBA_CACHE_DIR": str(folder / "compiled")}
            service.set_up(args.roads, args.dem)
            rows, figures = measured(service, args.roads, folder, args.minutes * 60, args.lanes)
    show_progress("")
    print(text_table(rows, COLUMNS))
    print(f"{figures['drives']:.0f} drives; {figures['lanes_begun']:.0f} processes were a lane in that time")
    write_json(args.json, {"rows": rows, **figures})


def measured(
    service: Service, roads: Path, folder: Path, lasting_s: float, lanes: int
) -> tuple[list[dict[str, float | str]], dict[str, float]]:
    """The table, and how many drives and processes there were."""
    table = read_roads(roads)
    with (
        service.started("api", "--port", str(service.port)),
        service.started("worker", "--concurrency", str(lanes)) as worker,
    ):
        service.await_ready()
        rest = Lanes(worker.pid)
        await_lanes(rest, lanes)
        time.sleep(AT_REST_S)
        rest = Lanes(worker.pid)
        rest.look()
        busy, drives, ends = Lanes(worker.pid), 0, time.monotonic() + lasting_s
        with repeated(busy.look, LOOK_EVERY_S):
            while time.monotonic() < ends:
                columns = columns_of(record(table, HOURS, drives)[0], drives * APART_S)
                service.send(write_columns(columns, folder / "drive.csv").read_bytes())
                drives += 1
                while waiting(service) >= WAITING and time.monotonic() < ends:
                    time.sleep(LOOK_EVERY_S)
                show_progress(f"{drives} drives, {busy.pss_mb:.0f} MB")
            service.await_done()
    rows: list[dict[str, float | str]] = [
        {"when": when, "pss_mb": one.pss_mb, "own_mb": one.own_mb}
        for when, one in (("at rest", rest), ("most", busy))
    ]
    return rows, {"drives": drives, "lanes_begun": len(busy.seen)}


def await_lanes(found: Lanes, count: int) -> None:
    """Until all have begun; the first start compiles."""
    ends = time.monotonic() + PATIENCE_S
    while found.look() < count:
        if time.monotonic() > ends:
            sys.exit("the lanes did not begin")
        time.sleep(LOOK_EVERY_S)


def waiting(service: Service) -> int:
    """Drives that are not published yet."""
    with psycopg.connect(service.url) as connection:
        row = connection.execute(
            "SELECT count(*) FROM drives WHERE status IN ('queued', 'running')"
        ).fetchone()
    return row[0] if row else 0


if __name__ == "__main__":
    main()
