"""Figures for operators out of the database: drives, the queue, the map, the database itself.

Each statement stands once, whoever asks for its figure; what is made of them is in ``stats.py``, ``metrics.py`` and
``health.py``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

from app.network.marks import PATIENCE

ALIVE_S = 60.0

# Drives are counted as they change (``drive_counts``): the sum over its rows is what there is, however many drives.
_BY_STATUS = text(
    "SELECT status, sum(drives) FROM drive_counts GROUP BY status HAVING sum(drives) > 0 ORDER BY status"
)

# Days of the upload, UTC.
_BY_DAY = text("""
    SELECT day, status, sum(drives) AS drives FROM drive_counts
    WHERE day >= CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    GROUP BY day, status HAVING sum(drives) > 0 ORDER BY day, status
""")

_FAILURES = text("""
    SELECT failure_kind, sum(drives) FROM drive_counts WHERE status = 'failed'
    GROUP BY failure_kind HAVING sum(drives) > 0 ORDER BY 2 DESC, 1
""")

# The oldest is the first entry of the index on queued_at.
_QUEUE = text("""
    SELECT (SELECT coalesce(sum(drives), 0) FROM drive_counts WHERE status = 'queued'),
           extract(epoch FROM clock_timestamp() - (SELECT min(queued_at) FROM drives WHERE status = 'queued'))
""")

# Each cell keeps its own sums.
_SEGMENTS_DRIVEN = text(
    "SELECT coalesce(sum(CAST(of_class.value ->> 0 AS bigint)), 0) FROM cells, jsonb_each(driven) AS of_class"
)
_DRIVEN_KM = text("""
    SELECT of_class.key, sum(CAST(of_class.value ->> 1 AS float8)) / 1000
    FROM cells, jsonb_each(driven) AS of_class GROUP BY of_class.key ORDER BY 2 DESC
""")

# The roads are as the last import left them. Code from before it noted their length may still have made it.
_TOTALS = text("""
    SELECT coalesce(roads.segments, 0) AS segments,
           coalesce(roads.length_m, (SELECT sum(length_m) FROM segments), 0) / 1000 AS network_km,
           counted.drives, counted.driven_distance_km, counted.uploaded_bytes,
           (SELECT max(id) FROM dem_versions WHERE active) AS dem_version_id
    FROM (SELECT coalesce(sum(drives), 0) AS drives,
                 greatest(coalesce(sum(distance_m), 0), 0) / 1000 AS driven_distance_km,
                 coalesce(sum(size_bytes), 0) AS uploaded_bytes FROM drive_counts) AS counted
        LEFT JOIN (SELECT segments, length_m FROM road_versions ORDER BY id DESC LIMIT 1) AS roads ON true
""")


# Cells that solvers have failed to solve, the longest waiting first. A mark may outlive its drive.
_UNSOLVED = text("""
    SELECT m.cell, max(m.tries) AS solvers, min(m.made_at) AS since, max(m.due_at) AS next_at,
           coalesce(array_agg(DISTINCT d.id) FILTER (WHERE d.id IS NOT NULL), '{}') AS drives
    FROM network_marks AS m LEFT JOIN drives AS d ON d.id = m.drive_id AND d.generation = m.generation
    WHERE m.tries > :patience
    GROUP BY m.cell ORDER BY since, m.cell LIMIT :limit
""")
_CELLS = text("""
    SELECT count(DISTINCT cell), count(DISTINCT cell) FILTER (WHERE tries > :patience) FROM network_marks
""")


# What ways and low zooms have not followed yet, changes beside which a transaction is open included: two looks at the
# ends of indexes.
_BEHIND = text("""
    SELECT (SELECT count(*) FROM cells_to_draw) AS cells,
           extract(epoch FROM clock_timestamp() - least(
               (SELECT min(since) FROM cells_to_draw),
               (SELECT (SELECT c.changed_at FROM segment_changes AS c
                        WHERE (c.xid, c.segment_id) > (u.xid, u.segment_id)
                        ORDER BY c.xid, c.segment_id LIMIT 1) FROM derived_upto AS u))) AS behind_s
""")

# The queue's own signs of life; a worker that has given none for long is put out by the next one that begins.
_WORKERS = text(
    "SELECT count(*) FROM procrastinate_workers WHERE last_heartbeat > now() - make_interval(secs => :alive_s)"
)


class Queue(NamedTuple):
    """The drives that wait: their number, and how long the first has waited, s; None while none does."""

    depth: int
    oldest_wait_s: float | None


class WaitingCells(NamedTuple):
    """How many cells wait to be solved, and how many of them solvers have failed to solve."""

    waiting: int
    unsolved: int


class Behind(NamedTuple):
    """How many cells wait to be drawn for low zooms, and how long the oldest change of a segment has waited for what
    is derived from segments, s; None while none waits."""

    cells: int
    behind_s: float | None


def drives_by_status(session: Session) -> dict[str, int]:
    """How many drives are in each status that any is in."""
    return _pairs(session, _BY_STATUS)


def drives_by_day(session: Session, days: int) -> list[dict[str, Any]]:
    """``{"day": date, "status": str, "drives": int}`` for each day and status of the last ``days`` days."""
    return [dict(row._mapping) for row in session.execute(_BY_DAY, {"days": days})]


def failures_by_kind(session: Session) -> dict[str, int]:
    """How many drives failed for each reason, the commonest first."""
    return _pairs(session, _FAILURES)


def queue(session: Session) -> Queue:
    """The drives that wait."""
    depth, oldest = session.execute(_QUEUE).one()
    return Queue(depth, None if oldest is None else max(0.0, float(oldest)))


def workers(session: Session) -> int:
    """How many processes take drives from the queue and have given a sign of life within ``ALIVE_S``."""
    return int(session.execute(_WORKERS, {"alive_s": ALIVE_S}).scalar_one())


def waiting_cells(session: Session) -> WaitingCells:
    """What waits to be published."""
    return WaitingCells(*session.execute(_CELLS, {"patience": PATIENCE}).one())


def behind(session: Session) -> Behind:
    """How far what is derived from segments, ways and low zooms, is behind them."""
    cells, behind_s = session.execute(_BEHIND).one()
    return Behind(cells, None if behind_s is None else max(0.0, float(behind_s)))


def unsolved_cells(session: Session, limit: int) -> list[Row[Any]]:
    """At most ``limit`` cells that more than ``PATIENCE`` solvers have begun, by the names in ``_UNSOLVED``."""
    return list(session.execute(_UNSOLVED, {"patience": PATIENCE, "limit": limit}))


def segments_driven(session: Session) -> int:
    """How many segments have an estimate that a drive stands behind. Reads all that is published."""
    return int(session.execute(_SEGMENTS_DRIVEN).scalar_one())


def driven_km_by_highway(session: Session) -> dict[str, float]:
    """Length of distinct segments with an estimate by road class, kilometres, the longest first.

    Reads all that is published.
    """
    return _pairs(session, _DRIVEN_KM)


def totals(session: Session) -> Row[Any]:
    """Of all drives and roads, by the names in ``_TOTALS``; lengths in kilometres.

    ``driven_distance_km`` is the sum over the drives: a road counts as often as it was driven.
    """
    return session.execute(_TOTALS).one()


def _pairs(session: Session, query: TextClause) -> dict[str, Any]:
    return {row[0]: row[1] for row in session.execute(query)}
