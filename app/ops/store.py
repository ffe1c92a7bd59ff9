"""Figures for operators out of the database: drives, the queue, the map, the database itself.

Each statement stands once, whoever asks for its figure; what is made of them is in ``stats.py``, ``metrics.py`` and
``health.py``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

# Drives are counted as they change (``drive_counts``): the sum over its rows is what there is, however many drives.
_BY_STATUS = text(
    "SELECT status, sum(drives) FROM drive_counts GROUP BY status HAVING sum(drives) > 0 ORDER BY status"
)

# Days of the upload, UTC.
_BY_DAY = text(
    """
    SELECT day, status, sum(drives) AS drives FROM drive_counts
    WHERE day >= CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    GROUP BY day, status HAVING sum(drives) > 0 ORDER BY day, status
    """
)

_FAILURES = text(
    """
    SELECT failure_kind, sum(drives) FROM drive_counts WHERE status = 'failed'
    GROUP BY failure_kind HAVING sum(drives) > 0 ORDER BY 2 DESC, 1
    """
)

# The oldest is the first entry of the index on queued_at.
_QUEUE = text(
    """
    SELECT (SELECT coalesce(sum(drives), 0) FROM drive_counts WHERE status = 'queued'),
           extract(epoch FROM clock_timestamp() - (SELECT min(queued_at) FROM drives WHERE status = 'queued'))
    """
)

# These two read all that is published.
_SEGMENTS_DRIVEN = text("SELECT count(*) FROM segment_slopes WHERE drives > 0")
_DRIVEN_KM = text(
    """
    SELECT s.highway, sum(s.length_m) / 1000
    FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
    WHERE a.drives > 0
    GROUP BY s.highway ORDER BY 2 DESC
    """
)

# The roads are as the last import left them. Code from before it noted their length may still have made it.
_TOTALS = text(
    """
    SELECT coalesce(roads.segments, 0) AS segments,
           coalesce(roads.length_m, (SELECT sum(length_m) FROM segments), 0) / 1000 AS network_km,
           counted.drives, counted.driven_distance_km, counted.uploaded_bytes,
           (SELECT max(id) FROM dem_versions WHERE active) AS dem_version_id
    FROM (SELECT coalesce(sum(drives), 0) AS drives,
                 greatest(coalesce(sum(distance_m), 0), 0) / 1000 AS driven_distance_km,
                 coalesce(sum(size_bytes), 0) AS uploaded_bytes FROM drive_counts) AS counted
        LEFT JOIN (SELECT segments, length_m FROM road_versions ORDER BY id DESC LIMIT 1) AS roads ON true
    """
)

_HAS_REVISION = text("SELECT to_regclass('alembic_version') IS NOT NULL")
_REVISION = text("SELECT version_num FROM alembic_version")


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


def schema_revision(session: Session) -> str | None:
    """The migration that the database is at, or None where none was applied."""
    if not session.execute(_HAS_REVISION).scalar_one():
        return None
    revision = session.execute(_REVISION).scalar()
    return None if revision is None else str(revision)


def _pairs(session: Session, query: TextClause) -> dict[str, Any]:
    return {row[0]: row[1] for row in session.execute(query)}
