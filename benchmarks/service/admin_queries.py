"""How long operators' queries and heights of places take on a large map.

    PYTHONPATH=.:benchmarks python -m service.admin_queries [--drives 100000] [--segments 1000000] [--json FILE]

The database is filled by SQL: 10,000 of the drives wait, a million estimates belong to drives, and 100,000 passes are
rejected. Each query of ``/v1/admin`` is read eleven times on a warm server, what is kept after it was
made once; printed are the medians, and how long what is kept took to make, which a worker does. Heights: 512 places
beside roads, all in one request. Aims: each query under 100 ms.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from accuracy.arguments import parser_of
from accuracy.scoring import write_json
from app.core.db import Sessions
from app.embedded.cluster import EmbeddedPostgres
from app.map import figures
from app.map.heights.road_heights import heights_of, nearest
from app.map.heights.store import roads_near
from app.network.cells import raise_versions
from app.ops.admin.queries import QUERIES
from app.ops.admin.store import Parameters
from service.databases import new_database, vacuum

READS = 11
PLACES = 512
RADIUS_M = 25.0

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
    times_ms: dict[str, float] = {}
    for name in figures.KEPT:
        began = time.perf_counter()
        with sessions() as session:
            figures.make(session, name)
        times_ms[f"made: {name}"] = 1e3 * (time.perf_counter() - began)
    while figures.renew_one(sessions):
        pass
    for name, query in QUERIES.items():
        times_ms[name] = ms_of(sessions, lambda session: query.read(session, Parameters(days=366)))  # noqa: B023
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(8, 8.4, PLACES), 49 + 3e-4 * rng.integers(0, 1000, PLACES) + 5e-5])

    def heights(session: Session) -> None:
        near = roads_near(session, places, RADIUS_M)
        heights_of(
            session, [nearest(place, roads, RADIUS_M) for place, roads in zip(places, near, strict=True)]
        )

    times_ms[f"heights of {PLACES} places"] = ms_of(sessions, heights)
    return times_ms


def fill(sessions: Sessions, drives: int, segments: int) -> None:
    """Fill an empty database."""
    with sessions.begin() as session:
        for statement in (*_ROADS.split(";"), *_DRIVES.split(";")):
            session.execute(text(statement), {"drives": drives, "segments": segments})
        cells = list(session.execute(text("SELECT DISTINCT cell FROM segments")).scalars())
        raise_versions(session, cells)
    vacuum(sessions)
    with sessions.begin() as session:
        for statement in _MORE.split(";"):
            session.execute(text(statement))
    vacuum(sessions)


def main() -> None:
    """Measure, print a table, write JSON."""
    parser = parser_of(__doc__)
    parser.add_argument("--drives", type=int, default=100_000)
    parser.add_argument("--segments", type=int, default=1_000_000)
    chosen = parser.parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
        new_database(cluster, "filled") as sessions,
    ):
        fill(sessions, chosen.drives, chosen.segments)
        times_ms = measure(sessions)
    for name, took_ms in times_ms.items():
        print(f"{name:<28}{took_ms:10.1f} ms")
    write_json(chosen.json, json.loads(json.dumps(times_ms)))


if __name__ == "__main__":
    main()
