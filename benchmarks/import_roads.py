"""How fast `versant import-roads` is, end to end, and what it costs a service with drives that goes on meanwhile.

    python benchmarks/import_roads.py FILE [--runs 5] [--json FILE]
    python benchmarks/import_roads.py FILE --beside 200 [--json FILE]

Each run of the first imports FILE into an empty database of an embedded cluster with the settings of `versant up` (a
commit is on disk when it returns), then once more into the same database, where every segment is kept. Printed are the
medians. Aim: at least 20,000 segments per second for the first import on two cores (Heidelberg extract).

The second uploads so many drives of 10 km to a service on FILE and imports FILE beside it with one node in 200 moved by
1 m and one in 1,000 by 30 m, while a process of its own asks for four routes ten times a second each. It ends when the
drives that this touches are done again. Aims: what a trial run foretells comes true; no segment whose nodes moved by
1 m or not at all loses what was measured, but for those that a drive which was computed again has not gone over after
all (``lost_by_new_runs``); no answer takes longer than 200 ms.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import osmium
import psycopg

from accuracy.scoring import show_progress, write_json
from app.core import databases, migrate
from app.core.db import make_engine, session_factory
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from app.roads.imports import import_roads
from fusion.frames import METRES_PER_DEGREE
from fusion.roads.osm import read_roads
from service.logs import make_logs
from service.probing import probing
from service.processes import Service

HERE = Path(__file__).resolve().parents[1]
ROUTES = ["/healthz", "/v1/drives", "/tiles/14/8579/5613.mvt", "/collections/segments/items?limit=100"]
WARM_UP_S = 3.0


def seconds(work: Callable[[], object]) -> float:
    """Wall-clock time that ``work`` takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(cluster: EmbeddedPostgres, file: Path, folder: Path, runs: int) -> dict[str, list[float]]:
    """Seconds of reading alone, of a first import and of a re-import, one value per run."""
    out: dict[str, list[float]] = {"read_s": [], "first_s": [], "again_s": []}
    for run in range(runs):
        name = f"import_{run}"
        databases.ensure_database(cluster.url, name)
        migrate.upgrade(cluster.url_of(name))
        engine = make_engine(cluster.url_of(name))
        sessions = session_factory(engine)
        out["read_s"].append(seconds(lambda: read_roads(file)))
        for key in ("first_s", "again_s"):
            out[key].append(seconds(lambda: import_roads(sessions, file, folder / "dem")))  # noqa: B023
        engine.dispose()
        databases.drop_database(cluster.url, name)
    return out


def move_nodes(roads: Path, changed: Path) -> set[int]:
    """Write the map with nodes moved; those that moved far."""
    changed.unlink(missing_ok=True)
    far = set()
    with osmium.SimpleWriter(str(changed)) as writer:
        for thing in osmium.FileProcessor(str(roads)):
            if isinstance(thing, osmium.osm.Node) and (thing.id % 200 == 0 or thing.id % 1000 == 1):
                north_m = 1.0 if thing.id % 200 == 0 else 30.0
                far |= {thing.id} if north_m > 1 else set()
                place = (thing.location.lon, thing.location.lat + north_m / METRES_PER_DEGREE)
                writer.add(thing.replace(location=place))
            else:
                writer.add(thing)
    return far


Measured = dict[tuple[int, int, int], set[str]]
"""Way and nodes of a segment, and the drives that measured it."""

MEASURED = """
    SELECT s.osm_way_id, s.from_node, s.to_node, array_agg(DISTINCT CAST(p.drive_id AS text))
    FROM segments AS s JOIN drive_passes AS p ON p.segment_id = s.id GROUP BY s.id
"""
AGAIN = "SELECT CAST(id AS text) FROM drives WHERE generation > 1"


def measured_by(connection: psycopg.Connection[Any]) -> Measured:
    """What is measured now."""
    return {(way, a, b): set(drives) for way, a, b, drives in connection.execute(MEASURED)}


def beside(cluster: EmbeddedPostgres, folder: Path, file: Path, drives: int) -> dict[str, Any]:
    """Figures of an import beside a service with so many drives."""
    far = move_nodes(file, folder / "moved.osm.pbf")
    databases.ensure_database(cluster.url, "beside")
    service = Service(HERE, libpq_url(cluster.url_of("beside")), folder / "data")
    service.command("migrate")
    service.command("import-roads", str(file), "--region", "map")
    again = ("import-roads", str(folder / "moved.osm.pbf"), "--region", "map", "--json")
    with (
        service.started("api", "--port", str(service.port)),
        service.started("worker"),
        psycopg.connect(service.url, autocommit=True) as connection,
    ):
        service.await_ready()
        for log in make_logs(file, drives, folder):
            service.send(log)
        service.await_done(lambda done: show_progress(f"{done} of {drives} drives"))
        before = measured_by(connection)
        service.command(*again, str(folder / "trial.json"), "--dry-run")
        with probing(service.port, ROUTES, folder / "probes") as probes:
            time.sleep(WARM_UP_S)
            began = time.time()
            service.command(*again, str(folder / "import.json"), "--yes")
            ended = time.time()
        after = measured_by(connection)
        service.await_done(lambda done: show_progress(f"{done} of {drives} drives, again"))
        computed_again = {drive for (drive,) in connection.execute(AGAIN)}
    trial, done = (json.loads((folder / name).read_text()) for name in ("trial.json", "import.json"))
    own = {"dry_run", "longest_hold_s", "seconds"}
    answers = probes.between(began, ended)
    lost = [one for one in before if one not in after and not far & {*one[1:]}]
    return {
        "import": done,
        "foretold": {k: v for k, v in trial.items() if k not in own}
        == {k: v for k, v in done.items() if k not in own},
        "measured": len(before),
        "lost_without_reason": sum(not before[one] <= computed_again for one in lost),
        "lost_by_new_runs": sum(before[one] <= computed_again for one in lost),
        "drives_again": len(computed_again),
        "slowest_ms": {one.route: one.max_ms for one in answers},
        "p99_ms": {one.route: one.p99_ms for one in answers},
        "not_2xx": {one.route: one.unlike_2xx for one in answers if one.unlike_2xx},
        "load_before": os.getloadavg()[0],
    }


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("file", type=Path, help="road map: .osm.pbf, .osm or .osm.gz")
    parser.add_argument("--runs", type=int, default=5, help="imports to take the median of (default 5)")
    parser.add_argument(
        "--beside", type=int, metavar="DRIVES", help="an import beside a service with drives instead"
    )
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    chosen = parser.parse_args()
    if chosen.beside:
        with (
            tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
            EmbeddedPostgres(Path(folder) / "cluster") as cluster,
        ):
            found = beside(cluster, Path(folder), chosen.file, chosen.beside)
        show_progress("")
        print(json.dumps(found, indent=2))
        write_json(chosen.json, found)
        return
    segments = len(read_roads(chosen.file))
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        times = measure(cluster, chosen.file, Path(folder), chosen.runs)
    median = {key: statistics.median(values) for key, values in times.items()}
    print(f"{chosen.file.name}: {segments} segments, median of {chosen.runs} runs")
    for key, label in (
        ("read_s", "reading alone"),
        ("first_s", "first import"),
        ("again_s", "same map again"),
    ):
        print(f"  {label:<15} {median[key]:7.2f} s  {segments / median[key]:9,.0f} segments/s")
    if chosen.json:
        figures = {"file": chosen.file.name, "segments": segments, "median": median, "runs": times}
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
