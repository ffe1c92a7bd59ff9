"""The statements of operators' queries that are answered from the tables as they stand."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

LATEST_DRIVES = 5000
"""Of how many drives the times are told: the latest."""

_BY_DAY = text(
    """
    SELECT day, status, CAST(sum(drives) AS bigint) AS drives, greatest(sum(distance_m), 0) / 1000 AS km,
           CAST(sum(size_bytes) AS bigint) AS uploaded_bytes
    FROM drive_counts WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    GROUP BY day, status HAVING sum(drives) > 0 ORDER BY day DESC, status
    """
)

# The reason of one of them, by the index on status and upload: the latest that failed so.
_FAILURES = text(
    """
    SELECT f.kind, f.drives, f.drives / nullif(f.uploaded, 0) AS share, d.failure_reason AS latest_reason,
           d.created_at AS latest_at, d.id AS latest_drive
    FROM (SELECT failure_kind AS kind, CAST(sum(drives) AS bigint) AS drives,
                 (SELECT CAST(sum(drives) AS float8) FROM drive_counts
                  WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)) AS uploaded
          FROM drive_counts
          WHERE status = 'failed' AND day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
          GROUP BY failure_kind HAVING sum(drives) > 0) AS f
    LEFT JOIN LATERAL (
        SELECT id, failure_reason, created_at FROM (
            SELECT id, failure_reason, created_at, failure_kind FROM drives WHERE status = 'failed'
            ORDER BY created_at DESC, id DESC LIMIT :latest) AS late
        WHERE late.failure_kind IS NOT DISTINCT FROM f.kind ORDER BY created_at DESC LIMIT 1) AS d ON true
    ORDER BY f.drives DESC, f.kind
    """
)

# Waiting, computing, publishing: the three things that a drive's time goes into.
_TIMES = text(
    """
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
    """
)

# Through the queue's own indexes; what runs is few.
_QUEUE = text(
    """
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
    """
)

_LOGS = text(
    """
    SELECT 'uploaded logs' AS name, CAST(coalesce(sum(drives), 0) AS bigint) AS rows_about,
           CAST(coalesce(sum(size_bytes), 0) AS bigint) AS table_bytes, 0 AS index_bytes
    FROM drive_counts
    """
)

# Parts of a partitioned table count as that; the table of a queue is the queue's.
_STORAGE = text(
    """
    SELECT coalesce(p.relname, c.relname) AS name, CAST(sum(greatest(c.reltuples, 0)) AS bigint) AS rows_about,
           CAST(sum(pg_table_size(c.oid)) AS bigint) AS table_bytes,
           CAST(sum(pg_indexes_size(c.oid)) AS bigint) AS index_bytes
    FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace
    LEFT JOIN pg_inherits AS i ON i.inhrelid = c.oid LEFT JOIN pg_class AS p ON p.oid = i.inhparent
    WHERE c.relkind = 'r' AND n.nspname = current_schema()
    GROUP BY 1 ORDER BY sum(pg_total_relation_size(c.oid)) DESC, 1
    """
)


def drives_by_day(session: Session, days: int) -> list[dict[str, Any]]:
    """Drives by day of the upload and status."""
    return _rows(session, _BY_DAY, days=days)


def failures(session: Session, days: int) -> list[dict[str, Any]]:
    """Failed drives by reason."""
    return _rows(session, _FAILURES, days=days, latest=LATEST_DRIVES)


def times(session: Session) -> list[dict[str, Any]]:
    """What drives' time went into, by method."""
    return _rows(session, _TIMES, latest=LATEST_DRIVES)


def queue(session: Session) -> list[dict[str, Any]]:
    """What waits and what runs."""
    return _rows(session, _QUEUE)


def storage(session: Session) -> list[dict[str, Any]]:
    """The logs, then tables and their indexes, the largest first."""
    logs = [{"kind": "logs", **row} for row in _rows(session, _LOGS)]
    return logs + [{"kind": "table", **row} for row in _rows(session, _STORAGE)]


def _rows(session: Session, query: Any, **values: Any) -> list[dict[str, Any]]:
    return [dict(row._mapping) for row in session.execute(query, values)]
