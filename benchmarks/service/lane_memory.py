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

import argparse
import re
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psycopg

from accuracy.logs import write_columns
from accuracy.scoring import show_progress, text_table, write_json
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from fusion.roads.osm import read_roads
from profile_speed import record
from service.logs import APART_S, HOURS, columns_of
from service.processes import Service

HERE = Path(__file__).resolve().parents[2]
SHARED = HERE.parent / "shared/data"
HEIDELBERG = SHARED / "maps/heidelberg-2024-09.test.osm.pbf"
ELEVATIONS = SHARED / "karlsruhe/N49E008.hgt"
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
            with suppress(OSError, IndexError):
                told = Path(f"/proc/{pid}/smaps_rollup").read_text()
                figures = {
                    k: float(v) / 1024 for k, v in re.findall(r"^(\w+):\s+(\d+) kB", told, re.MULTILINE)
                }
                self.pss_mb = max(self.pss_mb, figures["Pss"])
                self.own_mb = max(self.own_mb, figures["Private_Clean"] + figures["Private_Dirty"])
                self.seen.add(pid)
        return len(lanes)


def lanes_of(worker: int) -> list[int]:
    """The children of the worker's child: those that a compiler or a database command has begun are others."""
    found: list[int] = []
    for nursery in children_of(worker):
        found += [pid for pid in children_of(nursery) if b"app.cli\0worker" in command_of(pid)]
    return found


def children_of(pid: int) -> list[int]:
    """Processes that it has started and that run."""
    with suppress(OSError):
        return list(map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))
    return []


def command_of(pid: int) -> bytes:
    """Its arguments, each ended by a zero."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def began(pid: int) -> bool:
    """Whether it has threads beside its first: those of the queue."""
    with suppress(OSError):
        return len(list(Path(f"/proc/{pid}/task").iterdir())) > 1
    return False


@contextmanager
def watched(lanes: Lanes) -> Iterator[None]:
    """Look again and again until the block ends."""
    over = threading.Event()

    def watch() -> None:
        while not over.wait(LOOK_EVERY_S):
            lanes.look()

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--minutes", type=float, default=8.0, help="of drives")
    parser.add_argument("--lanes", type=int, default=2)
    parser.add_argument("--roads", type=Path, default=HEIDELBERG)
    parser.add_argument("--dem", type=Path, default=ELEVATIONS)
    parser.add_argument("--empty-cache", action="store_true", help="nothing has been compiled before")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="versant-lanes-") as name:
        folder = Path(name)
        with EmbeddedPostgres(folder, durable=False) as cluster:
            service = Service(HERE, libpq_url(cluster.url), folder / "data")
            if args.empty_cache:
                service.environment = {**service.environment, "NUMBA_CACHE_DIR": str(folder / "compiled")}
            for command in (("migrate",), ("import-roads", str(args.roads)), ("import-dem", str(args.dem))):
                service.command(*command)
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
        with watched(busy):
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
