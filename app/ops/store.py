"""Figures for operators out of the database: drives, the queue, the map, the database itself.

Each statement stands once, whoever asks for its figure; what is made of them is in ``stats.py``, ``metrics.py`` and
``health.py``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

# Answered from the index on (status, created_at, id), as is the queue below.
_BY_STATUS = text("SELECT status, count(*) FROM drives GROUP BY status ORDER BY status")

# Days of the upload, UTC.
_BY_DAY = text(
    """
    SELECT CAST(created_at AT TIME ZONE 'UTC' AS date) AS day, status, count(*) AS drives
    FROM drives WHERE created_at >= now() - make_interval(days => :days)
    GROUP BY day, status ORDER BY day, status
    """
)

_FAILURES = text(
    """
    SELECT failure_kind, count(*) FROM drives WHERE status = 'failed'
    GROUP BY failure_kind ORDER BY 2 DESC, 1
    """
)

_QUEUE = text(
    """
    SELECT count(*), extract(epoch FROM clock_timestamp() - min(queued_at))
    FROM drives WHERE status = 'queued'
    """
)

_DRIVEN_KM = text(
    """
    SELECT s.highway, sum(s.length_m) / 1000
    FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
    WHERE a.drives > 0
    GROUP BY s.highway ORDER BY 2 DESC
    """
)

_TOTALS = text(
    """
    SELECT (SELECT count(*) FROM segments) AS segments,
           (SELECT coalesce(sum(length_m), 0) / 1000 FROM segments) AS network_km,
           (SELECT count(*) FROM segment_slopes WHERE drives > 0) AS segments_driven,
           (SELECT count(*) FROM drives) AS drives,
           (SELECT coalesce(sum(distance_m), 0) / 1000 FROM drives) AS driven_distance_km,
           (SELECT coalesce(sum(size_bytes), 0) FROM drives) AS uploaded_bytes,
           (SELECT max(id) FROM dem_versions WHERE active) AS dem_version_id
    """
)


class Queue(NamedTuple):
    """The drives that wait: their number, and how long the first has waited, s; None while none does."""

    depth: int
    oldest_wait_s: float | None


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


def driven_km_by_highway(session: Session) -> dict[str, float]:
    """Length of distinct segments with an estimate by road class, kilometres, the longest first."""
    return _pairs(session, _DRIVEN_KM)


def totals(session: Session) -> Row[Any]:
    """What is counted over whole tables, by the names in ``_TOTALS``; lengths in kilometres.

    ``driven_distance_km`` is the sum over the drives: a road counts as often as it was driven.
    """
    return session.execute(_TOTALS).one()


def _pairs(session: Session, query: TextClause) -> dict[str, Any]:
    return {row[0]: row[1] for row in session.execute(query)}
