"""The statements of operators' queries that are answered from the tables as they stand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.schema import schema_state
from app.core.version import code_version
from app.drives.store import WAITS_FOR_ROADS
from app.roads.store import current_road_version

LATEST_DRIVES = 5000
"""Of how many drives the times are told: the latest."""
HOURLY_DAYS = 2
"""So many days at most are told by the hour."""
SAMPLED = 6000
"""Of how many drives at most medians are told, an equal part of each hour or day, the latest in it."""
LEAST_SAMPLED = 20

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Parameters:
    """The parameters of a request that queries use."""

    days: int = 30
    free_bytes: int | None = None
    """Room for logs; None: nothing tells."""
    least_bytes: int = 0
    """So much of it is to stay free."""


Read = Callable[[Session, Parameters], Rows]


def _by(query: str) -> Read:
    """The rows of a statement, which may name the days that are asked for and the constants above."""
    statement = text(query)

    def read(session: Session, parameters: Parameters) -> Rows:
        values = {
            "days": parameters.days,
            "unit": "hour" if parameters.days <= HOURLY_DAYS else "day",
            "latest": LATEST_DRIVES,
            "sampled": SAMPLED,
            "least": LEAST_SAMPLED,
        }
        return [dict(row._mapping) for row in session.execute(statement, values)]

    return read


drives_by_day = _by(f"""
    SELECT day, status, CAST(sum(drives) AS bigint) AS drives, greatest(sum(distance_m), 0) / 1000 AS km,
           CAST(sum(size_bytes) AS bigint) AS uploaded_bytes,
           CASE WHEN status = 'failed' THEN (
               SELECT count(*) FROM drives AS d WHERE {WAITS_FOR_ROADS}
                   AND d.created_at >= CAST(day AS timestamp) AT TIME ZONE 'UTC'
                   AND d.created_at < CAST(day + 1 AS timestamp) AT TIME ZONE 'UTC') ELSE 0 END AS waiting
    FROM drive_counts WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    GROUP BY day, status HAVING sum(drives) > 0 ORDER BY day DESC, status
""")  # noqa: S608 - a constant
"""Drives by day of the upload and status."""

# The reason of one of them, by the index on status and upload: the latest that failed so.
failures = _by(f"""
    SELECT f.kind, f.drives, f.drives / nullif(f.uploaded, 0) AS share, d.failure_reason AS latest_reason,
           d.failure_said -> 'reason' AS latest_said,
           d.created_at AS latest_at, d.id AS latest_drive, (
               SELECT count(*) FROM drives AS d WHERE d.failure_kind = f.kind AND {WAITS_FOR_ROADS}
                   AND d.created_at >= date_trunc('day', now(), 'UTC')
                       - make_interval(days => CAST(:days AS integer) - 1)) AS waiting
    FROM (SELECT failure_kind AS kind, CAST(sum(drives) AS bigint) AS drives,
                 (SELECT CAST(sum(drives) AS float8) FROM drive_counts
                  WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)) AS uploaded
          FROM drive_counts
          WHERE status = 'failed' AND day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
          GROUP BY failure_kind HAVING sum(drives) > 0) AS f
    LEFT JOIN LATERAL (
        SELECT id, failure_reason, failure_said, created_at FROM (
            SELECT id, failure_reason, failure_said, created_at, failure_kind FROM drives WHERE status = 'failed'
            ORDER BY created_at DESC, id DESC LIMIT :latest) AS late
        WHERE late.failure_kind IS NOT DISTINCT FROM f.kind ORDER BY created_at DESC LIMIT 1) AS d ON true
    ORDER BY f.drives DESC, f.kind
""")  # noqa: S608 - a constant
"""Failed drives by reason."""

# Waiting, computing, publishing: the three things that a drive's time goes into.
times = _by("""
    SELECT method, count(*) AS drives,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY waited) AS waited_p50_s,
           percentile_cont(0.95) WITHIN GROUP (ORDER BY waited) AS waited_p95_s,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY computed) AS computed_p50_s,
           percentile_cont(0.95) WITHIN GROUP (ORDER BY computed) AS computed_p95_s,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY published) AS published_p50_s,
           percentile_cont(0.95) WITHIN GROUP (ORDER BY published) AS published_p95_s,
           percentile_cont(0.5) WITHIN GROUP (ORDER BY computed / nullif(km, 0)) AS computed_p50_s_per_km
    FROM (SELECT method, extract(epoch FROM started_at - queued_at) AS waited,
                 extract(epoch FROM coalesce(computed_at, finished_at) - started_at) AS computed,
                 extract(epoch FROM finished_at - computed_at) AS published, distance_m / 1000 AS km
          FROM drives WHERE status = 'done' ORDER BY created_at DESC, id DESC LIMIT :latest) AS late
    GROUP BY method ORDER BY drives DESC, method
""")
"""What drives' time went into, by method."""

# Through the queue's own indexes; what runs is few.
queue = _by("""
    SELECT kind, count(*) AS jobs, extract(epoch FROM clock_timestamp() - min(since)) AS oldest_s FROM (
        SELECT 'drive, uploaded or asked for' AS kind, d.queued_at AS since FROM drives AS d
        WHERE d.status = 'queued' AND d.batch_id IS NULL
        UNION ALL SELECT 'drive, in a batch', d.queued_at FROM drives AS d
        WHERE d.status = 'queued' AND d.batch_id IS NOT NULL
        UNION ALL SELECT 'drive, running', d.started_at FROM drives AS d WHERE d.status = 'running'
        UNION ALL SELECT 'drive, being removed', d.finished_at FROM drives AS d WHERE d.status = 'cancelled'
        UNION ALL SELECT 'cell to be solved', made_at FROM (
            SELECT cell, min(made_at) AS made_at FROM network_marks GROUP BY cell) AS m) AS waiting
    GROUP BY kind ORDER BY kind
""")
"""What waits and what runs."""

# Counts by the index on the end, which holds all that they need; medians of the latest drives of each bucket alone.
throughput = _by(f"""
    WITH counted AS (
        SELECT date_trunc(:unit, finished_at, 'UTC') AS at, count(*) FILTER (WHERE status = 'done') AS done,
               count(*) FILTER (WHERE status = 'failed') AS failed,
               coalesce(sum(distance_m) FILTER (WHERE status = 'done'), 0) / 1000 AS km
        FROM drives
        WHERE finished_at >= date_trunc(:unit, now() - make_interval(days => CAST(:days AS integer)), 'UTC')
            AND finished_at IS NOT NULL
        GROUP BY 1
    )
    SELECT c.at, c.done, c.failed, c.km, m.waited_p50_s, m.computed_p50_s, m.published_p50_s, (
        SELECT count(*) FROM drives AS d WHERE {WAITS_FOR_ROADS}
            AND d.finished_at >= c.at AND d.finished_at < c.at + CAST('1 ' || :unit AS interval)) AS waiting
    FROM counted AS c CROSS JOIN LATERAL (
        SELECT percentile_cont(0.5) WITHIN GROUP (ORDER BY waited) AS waited_p50_s,
               percentile_cont(0.5) WITHIN GROUP (ORDER BY computed) AS computed_p50_s,
               percentile_cont(0.5) WITHIN GROUP (ORDER BY published) AS published_p50_s
        FROM (SELECT extract(epoch FROM started_at - queued_at) AS waited,
                     extract(epoch FROM coalesce(computed_at, finished_at) - started_at) AS computed,
                     extract(epoch FROM finished_at - computed_at) AS published
              FROM (SELECT * FROM drives
                    WHERE finished_at >= c.at AND finished_at < c.at + CAST('1 ' || :unit AS interval)
                    ORDER BY finished_at DESC LIMIT greatest(:least, :sampled / (SELECT count(*) FROM counted)))
                   AS late
              WHERE status = 'done') AS each) AS m
    WHERE c.done + c.failed > 0
    ORDER BY c.at
""")  # noqa: S608 - a constant
"""What ended in each hour, or, of more than ``HOURLY_DAYS`` days, on each day, by the clock of UTC."""

_logs = _by("""
    SELECT 'uploaded logs' AS name, CAST(coalesce(sum(drives), 0) AS bigint) AS rows_about,
           CAST(coalesce(sum(size_bytes), 0) AS bigint) AS table_bytes, 0 AS index_bytes
    FROM drive_counts
""")

# Parts of a partitioned table count as that; the table of a queue is the queue's.
_tables = _by("""
    SELECT coalesce(p.relname, c.relname) AS name, CAST(sum(greatest(c.reltuples, 0)) AS bigint) AS rows_about,
           CAST(sum(pg_table_size(c.oid)) AS bigint) AS table_bytes,
           CAST(sum(pg_indexes_size(c.oid)) AS bigint) AS index_bytes
    FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace
    LEFT JOIN pg_inherits AS i ON i.inhrelid = c.oid LEFT JOIN pg_class AS p ON p.oid = i.inhparent
    WHERE c.relkind = 'r' AND n.nspname = current_schema()
    GROUP BY 1 ORDER BY sum(pg_total_relation_size(c.oid)) DESC, 1
""")

_SERVER = text("SELECT current_setting('server_version'), postgis_lib_version()")
_ELEVATION = text(
    "SELECT id, datum, imported_at, jsonb_array_length(sources) AS rasters FROM dem_versions WHERE active"
)


def storage(session: Session, parameters: Parameters) -> Rows:
    """The logs, then tables and their indexes, the largest first."""
    logs = [{"kind": "logs", **row} for row in _logs(session, parameters)]
    return logs + [{"kind": "table", **row} for row in _tables(session, parameters)]


def versions(session: Session, _parameters: Parameters) -> Rows:
    """Of the program, the schema, the server, roads and elevation: ``what``, ``version``, ``detail``."""
    state = schema_state(session)
    server, postgis = session.execute(_SERVER).one()
    roads = current_road_version(session)
    elevation = session.execute(_ELEVATION).one_or_none()
    shown = (
        ("code", code_version(), None),
        ("schema", state.revision, f"serves programs from {state.oldest_program} on"),
        ("postgresql", server, None),
        ("postgis", postgis, None),
        ("roads", None, "none")
        if roads is None
        else ("roads", str(roads.id), f"{roads.source_name}, {roads.imported_at:%Y-%m-%d %H:%M} UTC"),
        ("elevation", None, "none")
        if elevation is None
        else (
            "elevation",
            str(elevation.id),
            f"{elevation.rasters} raster{'s' * (elevation.rasters != 1)}, heights above {elevation.datum}, "
            f"{elevation.imported_at:%Y-%m-%d %H:%M} UTC",
        ),
    )
    return [{"what": what, "version": version, "detail": detail} for what, version, detail in shown]
