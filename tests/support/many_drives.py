"""Drives by the hundred, made by SQL: of method ``raw``, done or failed, with estimates of code version 1.0."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text

from app.core.db import Sessions

_ROADS = text(
    """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added, length_m)
    SELECT 'x', 'y', 0, 0, 0, 0, 0, 0 WHERE NOT EXISTS (SELECT FROM road_versions)
    """
)
# Every fourth failed; each lies a hundredth of a degree east of the one before, and is a day younger.
_DRIVES = text(
    """
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, progress, created_at,
                        queued_at, started_at, finished_at, drive_time, bounds, failure_kind, failure_reason, stage)
    SELECT gen_random_uuid(), gen_random_uuid(), 'log ' || k, 7, 'k',
           CASE WHEN k % 4 = 3 THEN 'failed' ELSE 'done' END, 'raw', '{"min_epochs": 4}', 1, day, day, day,
           day + interval '1 minute', day - interval '10 days',
           ST_MakeEnvelope(8 + k * 0.01, 49, 8.001 + k * 0.01, 49.001, 4326),
           CASE WHEN k % 4 = 3 THEN 'no-match' END, CASE WHEN k % 4 = 3 THEN 'No road.' END,
           CASE WHEN k % 4 = 3 THEN 'match' END
    FROM generate_series(0, :n - 1) AS k,
        LATERAL (SELECT CAST('2026-01-01Z' AS timestamptz) + k * interval '1 day' * :days AS day) AS made
    """
)
_PROVENANCES = text(
    """
    INSERT INTO provenances (drive_id, method, options, code_version, road_version_id)
    SELECT id, method, CAST(:options AS jsonb), '1.0', (SELECT max(id) FROM road_versions) FROM drives
    """
)


def make_drives(sessions: Sessions, n: int, options: str = "{}", days: float = 1.0) -> None:
    """``n`` drives that are over, named ``log 0``, ``log 1`` ... in the order of their uploads."""
    with sessions.begin() as session:
        session.execute(_ROADS)
        session.execute(_DRIVES, {"n": n, "days": days})
        session.execute(_PROVENANCES, {"options": options})


def rows(sessions: Sessions, query: str, **values: Any) -> list[tuple[Any, ...]]:
    """What a query answers."""
    with sessions() as session:
        return [tuple(row) for row in session.execute(text(query), values)]


def execute(sessions: Sessions, statement: str, **values: Any) -> None:
    """One statement in a transaction of its own."""
    with sessions.begin() as session:
        session.execute(text(statement), values)


def waiting(sessions: Sessions) -> list[int]:
    """The numbers of the drives in the queue, in its order."""
    query = """
        SELECT CAST(split_part(filename, ' ', 2) AS integer) FROM procrastinate_jobs AS j
        JOIN drives AS d ON CAST(d.id AS text) = args ->> 'drive_id'
        WHERE d.generation = CAST(args ->> 'generation' AS integer) AND d.status = 'queued' AND j.status = 'todo'
        ORDER BY priority DESC, j.id
    """
    return [row[0] for row in rows(sessions, query)]
