"""How long operators' queries and heights of places take on a large map.

    PYTHONPATH=.:benchmarks python -m service.admin_queries [--drives 100000] [--segments 1000000] [--json FILE]

A database as ``bulk.py`` fills it, besides with 10,000 drives that wait, a million estimates of drives and 100,000
verdicts against passes. Each query of ``/v1/admin`` is read eleven times on a warm server, what is kept after it was
made once; printed are the medians, and how long what is kept took to make, which a worker does. Heights: 512 places
beside roads, all in one request. Aims: each query under 100 ms.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from accuracy.scoring import write_json
from app.core.db import Sessions, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.map import figures
from app.map.heights.choice import nearest
from app.map.heights.road_heights import heights_of
from app.map.heights.store import roads_near
from app.ops.admin.queries import QUERIES, Parameters
from bulk import fill

READS = 11
PLACES = 512
RADIUS_M = 25.0

_MORE = """
    UPDATE drives SET status = 'queued'
        WHERE id IN (SELECT id FROM drives WHERE status = 'done' ORDER BY id LIMIT 10000);
    UPDATE drives SET started_at = queued_at + interval '3 s', computed_at = queued_at + interval '9 s',
        finished_at = queued_at + interval '10 s' WHERE status = 'done';
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations, passes,
                                first_at, last_at, provenance_id, in_network)
        SELECT d.id, s.id, 1.4, 0.5, 7, 1, now(), now(), p.id, true
        FROM (SELECT id, row_number() OVER (ORDER BY id) AS n FROM drives ORDER BY id LIMIT 10000) AS d
        JOIN provenances AS p ON p.drive_id = d.id
        CROSS JOIN LATERAL (SELECT id FROM segments WHERE id BETWEEN d.n * 90 AND d.n * 90 + 99) AS s;
    INSERT INTO rejected_passes (segment_id, pass_id, drive_id)
        SELECT segment_id, row_number() OVER (ORDER BY drive_id, segment_id), drive_id
        FROM drive_segments ORDER BY drive_id, segment_id LIMIT 100000
"""


def ms_of(sessions: Sessions, read: Callable[[Session], object]) -> float:
    """Median time of some reads after one that warms the server up, ms."""
    times = []
    for _ in range(READS + 1):
        began = time.perf_counter()
        with sessions() as session:
            read(session)
        times.append(1e3 * (time.perf_counter() - began))
    return statistics.median(times[1:])


def measure(sessions: Sessions) -> dict[str, float]:
    """Milliseconds by what was asked."""
    found: dict[str, float] = {}
    for name in figures.KEPT:
        began = time.perf_counter()
        with sessions() as session:
            figures.make(session, name)
        found[f"made: {name}"] = 1e3 * (time.perf_counter() - began)
    while figures.renew_one(sessions):
        pass
    for name, query in QUERIES.items():
        found[name] = ms_of(sessions, lambda session: query.read(session, Parameters(days=366)))  # noqa: B023
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(8, 8.4, PLACES), 49 + 3e-4 * rng.integers(0, 1000, PLACES) + 5e-5])

    def heights(session: Session) -> None:
        near = roads_near(session, places, RADIUS_M)
        heights_of(
            session, [nearest(place, roads, RADIUS_M) for place, roads in zip(places, near, strict=True)]
        )

    found[f"heights of {PLACES} places"] = ms_of(sessions, heights)
    return found


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--drives", type=int, default=100_000)
    parser.add_argument("--segments", type=int, default=1_000_000)
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    chosen = parser.parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
    ):
        fill(cluster, chosen.drives, chosen.segments)
        engine = make_engine(cluster.url_of("filled"))
        sessions = session_factory(engine)
        with sessions.begin() as session:
            for statement in _MORE.split(";"):
                session.execute(text(statement))
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("VACUUM ANALYZE"))
        found = measure(sessions)
        engine.dispose()
    for name, took_ms in found.items():
        print(f"{name:<28}{took_ms:10.1f} ms")
    write_json(chosen.json, json.loads(json.dumps(found)))


if __name__ == "__main__":
    main()
