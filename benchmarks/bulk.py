"""What many drives at once cost: all of them asked for anew, the first jobs fetched, progress and figures read.

    python benchmarks/bulk.py [--drives 100000] [--segments 1000000] [--json FILE]

An embedded cluster with the settings of `versant up` (a commit is on disk when it returns) is filled by SQL, not by
uploads and imports, and used twice: as the service does it, and as it was done before batches, when all drives came to
the client and went back as one statement (`--skip-before` leaves that out). Enqueuing runs in a process of its own, so
that its peak memory is its own, beside what it has once everything is imported. A fetch that is not answered within a
minute is given up: `inf`.

Aims with 100,000 drives and 1,000,000 segments: enqueued under 20 s and 200 MB, a fetch under 50 ms, progress and
figures under 100 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import procrastinate
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core import databases, migrate
from app.core.db import Sessions, make_engine, session_factory
from app.drives.batches import enqueuing
from app.drives.batches import store as bulk
from app.drives.batches.documents import Selection, Which
from app.drives.queue import BEHIND, TASK
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.task import QUEUE
from app.network.cells import raise_versions
from app.ops import store
from app.ops.metrics import read_gauges
from app.ops.stats import read_stats

FETCHES, READS, PATIENCE_MS = 40, 20, 60_000
METHOD = "dem"  # every drive of the benchmark is of another

# As after a road import: the indexes of geometries are made at the end, which takes a tenth of the time.
_ROADS = """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added, length_m)
        VALUES ('made', 'made', :segments, 0, 0, 0, :segments, 30.0 * :segments);
    DROP INDEX ix_segments_geom; DROP INDEX ix_segments_geom_3857;
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge, tunnel,
                          layer, road_version_id)
        SELECT k / 20, k, k + 1, line, ST_Transform(line, 3857), 30,
               (ARRAY['residential', 'track', 'primary'])[1 + k % 3], 0, false, false, 0,
               (SELECT max(id) FROM road_versions)
        FROM generate_series(1, :segments) AS k, LATERAL (SELECT ST_SetSRID(ST_MakeLine(
            ST_MakePoint(8 + k % 1000 * 4e-4, 49 + k / 1000 * 3e-4),
            ST_MakePoint(8 + (k % 1000 + 1) * 4e-4, 49 + k / 1000 * 3e-4)), 4326) AS line) AS made;
    CREATE INDEX ix_segments_geom ON segments USING gist (geom);
    CREATE INDEX ix_segments_geom_3857 ON segments USING gist (geom_3857);
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations)
        SELECT id, 1.5, 0.5, id % 4, 7 FROM segments WHERE id % 5 = 0
"""
# A year of uploads; a report of a kilobyte and a half, as `profile` makes them.
_DRIVES = """
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, report, bounds, distance_m,
                        progress, created_at, queued_at, drive_time, failure_kind, failure_reason)
        SELECT gen_random_uuid(), md5(CAST(k AS text)), k || '.ubx', 5000000, 'drives/' || k,
               CASE WHEN k % 20 = 0 THEN 'failed' ELSE 'done' END, 'raw', '{}',
               jsonb_build_object('noise', repeat(md5(CAST(k AS text)), 45)),
               ST_MakeEnvelope(8 + k % 100 * 4e-3, 49, 8.1 + k % 100 * 4e-3, 49.1, 4326), 10000, 1, uploaded, uploaded,
               uploaded, CASE WHEN k % 20 = 0 THEN 'no-match' END, CASE WHEN k % 20 = 0 THEN 'No road is near.' END
        FROM generate_series(1, :drives) AS k, LATERAL (
            SELECT now() - interval '1 year' * k / (:drives + 1) AS uploaded) AS made;
    INSERT INTO provenances (drive_id, method, options, code_version, road_version_id)
        SELECT id, method, '{}', 'before', (SELECT max(id) FROM road_versions) FROM drives
"""

# The way before batches, for comparison: the schema, the request, and what was read.
_SCHEMA_BEFORE = """
    DROP INDEX ix_procrastinate_jobs_lock; DROP INDEX ix_procrastinate_jobs_drive_id; DROP INDEX ix_drives_queued_at;
    DROP TRIGGER count_drives_insert ON drives; DROP TRIGGER count_drives_update ON drives;
    DROP TRIGGER count_drives_delete ON drives
"""
_LOCK_ALL = text("SELECT id FROM drives WHERE status IN ('done', 'failed') ORDER BY id FOR UPDATE")
_ASK_ALL = text(
    """
    UPDATE drives SET status = 'queued', progress = 0, generation = generation + 1, queued_at = now()
    WHERE id = ANY(CAST(:ids AS uuid[])) RETURNING id, generation
    """
)
_PROGRESS_BEFORE = text(
    """
    SELECT count(*), count(*) FILTER (WHERE status = 'queued'), avg(CASE WHEN status = 'queued' THEN 0 ELSE 1 END)
    FROM drives WHERE queued_at = (SELECT max(queued_at) FROM drives)
    """
)
_STATS_BEFORE = """
    SELECT status, count(*) FROM drives GROUP BY status;
    SELECT CAST(created_at AT TIME ZONE 'UTC' AS date), status, count(*) FROM drives
        WHERE created_at >= now() - interval '30 days' GROUP BY 1, 2;
    SELECT count(*), min(queued_at) FROM drives WHERE status = 'queued';
    SELECT failure_kind, count(*) FROM drives WHERE status = 'failed' GROUP BY 1;
    SELECT count(*), sum(length_m) FROM segments;
    SELECT count(*), sum(distance_m), sum(size_bytes) FROM drives
"""
_REGISTER = text("SELECT worker_id FROM procrastinate_register_worker_v1()")
_FETCH = text("SELECT id FROM procrastinate_fetch_job_v2(ARRAY[:queue], :worker)")


def enqueue(sessions: Sessions) -> int:
    """As the service does it, without its limit of time; the batch."""
    return enqueuing.reprocess_all(sessions, Selection(which=Which.OTHER), METHOD, for_s=math.inf)[0]


def enqueue_as_before(sessions: Sessions) -> int:
    """All drives to the client, and their jobs back in one statement, each with a lock of its own; no batch."""
    formatter = procrastinate.App(connector=procrastinate.SyncPsycopgConnector())
    with sessions.begin() as session:
        ids = list(session.execute(_LOCK_ALL).scalars())
        requests = [(row.id, row.generation) for row in session.execute(_ASK_ALL, {"ids": ids})]
        connection: Any = session.connection().connection.driver_connection
        jobs = [
            formatter.configure_task(TASK, queue=QUEUE, lock=str(drive), priority=BEHIND).make_new_job(
                drive_id=str(drive), generation=generation
            )
            for drive, generation in requests
        ]
        formatter.job_manager.batch_defer_jobs(jobs, connection=connection)
    return 0


WAYS: dict[str, Callable[[Sessions], int]] = {"now": enqueue, "before": enqueue_as_before}


def in_this_process(way: str, url: str) -> None:
    """Enqueue and print what it took: the part that runs in a process of its own."""
    engine = make_engine(url)
    sessions = session_factory(engine)
    with sessions() as session:
        session.execute(text("SELECT 1"))
    at_rest_mb, start = peak_mb(), time.perf_counter()
    batch = WAYS[way](sessions)
    took_s = time.perf_counter() - start
    print(json.dumps({"enqueue_s": took_s, "at_rest_mb": at_rest_mb, "peak_mb": peak_mb(), "batch": batch}))


def peak_mb() -> float:
    """The most memory that this process had so far (Linux; ``ru_maxrss`` would begin with the parent's)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def fetch_ms(sessions: Sessions) -> list[float]:
    """How long it took to fetch each of the first jobs, one transaction each; infinite where patience ended it."""
    times = []
    with sessions() as session:
        session.execute(text(f"SET statement_timeout = {PATIENCE_MS}"))
        worker = session.execute(_REGISTER).scalar_one()
        session.commit()
        for _ in range(FETCHES):
            try:
                times.append(milliseconds(lambda: _fetch(session, worker)))
            except OperationalError:
                return [*times, math.inf]
    return times


def _fetch(session: Session, worker: int) -> None:
    session.execute(_FETCH, {"queue": QUEUE, "worker": worker}).scalar_one()
    session.commit()


def milliseconds(work: Callable[[], object]) -> float:
    """Wall-clock time that ``work`` takes."""
    start = time.perf_counter()
    work()
    return 1000 * (time.perf_counter() - start)


def reads_ms(sessions: Sessions, reads: dict[str, Callable[[Session], object]]) -> dict[str, float]:
    """Medians over reads, each in a session of its own."""

    def once(read: Callable[[Session], object]) -> None:
        with sessions() as session:
            read(session)

    return {
        name: statistics.median(milliseconds(lambda: once(read)) for _ in range(READS))  # noqa: B023
        for name, read in reads.items()
    }


def _slopes(session: Session) -> None:
    """The two figures for which all that is published is read."""
    store.segments_driven(session)
    store.driven_km_by_highway(session)


def reads_now(batch: int) -> dict[str, Callable[[Session], object]]:
    """What people and Prometheus look at."""
    return {
        "progress_ms": lambda session: bulk.batch_progress(session, batch),
        "under_way_ms": bulk.batch_progress,
        "stats_ms": read_stats,
        "of_that_slopes_ms": _slopes,
        "of_that_drives_ms": lambda session: (
            store.drives_by_status(session),
            store.drives_by_day(session, 30),
            store.failures_by_kind(session),
            store.queue(session),
            store.totals(session),
        ),
        "metrics_ms": read_gauges,
    }


def reads_before() -> dict[str, Callable[[Session], object]]:
    """The same by the statements of before; the slopes' part is what it is now."""

    def stats(session: Session) -> None:
        for statement in _STATS_BEFORE.split(";"):
            session.execute(text(statement)).all()
        _slopes(session)

    return {"progress_ms": lambda session: session.execute(_PROGRESS_BEFORE).all(), "stats_ms": stats}


def measure(cluster: EmbeddedPostgres, way: str) -> dict[str, Any]:
    """One way on a fresh copy of the filled database."""
    databases.ensure_database(cluster.url, way, template="filled")
    url = cluster.url_of(way)
    if way == "before":
        make_before(url)
    command = [sys.executable, __file__, "--enqueue", way, url]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    engine = make_engine(url)
    sessions = session_factory(engine)
    times = fetch_ms(sessions)
    found |= {"first_fetch_ms": times[0], "fetch_p50_ms": statistics.median(times)}
    found["fetch_p95_ms"] = sorted(times)[math.ceil(0.95 * len(times)) - 1]
    batch = found.pop("batch")
    found |= reads_ms(sessions, reads_now(batch) if batch else reads_before())
    if batch:
        cancelled = time.perf_counter()
        enqueuing.cancel(sessions, batch, for_s=math.inf)
        found["cancel_s"] = time.perf_counter() - cancelled
    engine.dispose()
    return found


def make_before(url: str) -> None:
    """Take the migration's indexes and triggers away."""
    engine = make_engine(url)
    with session_factory(engine).begin() as session:
        for statement in _SCHEMA_BEFORE.split(";"):
            session.execute(text(statement))
    engine.dispose()


def fill(cluster: EmbeddedPostgres, drives: int, segments: int) -> None:
    """The database `filled`."""
    databases.ensure_database(cluster.url, "filled")
    migrate.upgrade(cluster.url_of("filled"))
    engine = make_engine(cluster.url_of("filled"))
    with session_factory(engine).begin() as session:
        for statement in (*_ROADS.split(";"), *_DRIVES.split(";")):
            session.execute(text(statement), {"drives": drives, "segments": segments})
        squares = list(session.execute(text("SELECT DISTINCT cell FROM segments")).scalars())
        raise_versions(session, squares)
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("VACUUM ANALYZE"))
    engine.dispose()


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--drives", type=int, default=100_000)
    parser.add_argument("--segments", type=int, default=1_000_000)
    parser.add_argument("--skip-before", action="store_true", help="only as it is done now")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("--enqueue", nargs=2, metavar=("WAY", "URL"), help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.enqueue:
        in_this_process(*chosen.enqueue)
        return
    found = {}
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        fill(cluster, chosen.drives, chosen.segments)
        for way in ("now",) if chosen.skip_before else WAYS:
            found[way] = measure(cluster, way)
    print(f"{chosen.drives} drives, {chosen.segments} segments")
    print(f"  {'':<18}" + "".join(f"{way:>12}" for way in found))
    for name in found["now"]:
        cells = (f"{of[name]:12.2f}" if name in of else f"{'-':>12}" for of in found.values())
        print(f"  {name:<18}" + "".join(cells))
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
