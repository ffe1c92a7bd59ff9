"""Figures for operators."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.store import roads
from app.store.rows import AdminStats
from app.store.version import data_version

_BY_STATUS = text("SELECT status, count(*) FROM drives GROUP BY status ORDER BY status")

# Days of the upload, UTC.
_BY_DAY = text(
    """
    SELECT CAST(created_at AT TIME ZONE 'UTC' AS date) AS day, status, count(*) AS drives
    FROM drives WHERE created_at >= now() - make_interval(days => :days)
    GROUP BY day, status ORDER BY day, status
    """
)

_QUEUE = text(
    """
    SELECT count(*), EXTRACT(EPOCH FROM clock_timestamp() - min(queued_at))
    FROM drives WHERE status = 'queued'
    """
)

_FAILURES = text(
    """
    SELECT failure_kind, count(*) FROM drives WHERE status = 'failed'
    GROUP BY failure_kind ORDER BY 2 DESC, 1
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


def admin_stats(session: Session, *, days: int = 30) -> AdminStats:
    """The figures of this moment; drives by day cover the last ``days`` days. Reads whole tables."""
    by_status: dict[str, int] = _pairs(session, _BY_STATUS)
    depth, oldest = session.execute(_QUEUE).one()
    totals = session.execute(_TOTALS).one()
    return AdminStats(
        drives_by_status=by_status,
        drives_by_day=[dict(row._mapping) for row in session.execute(_BY_DAY, {"days": days})],
        queue_depth=int(depth),
        queue_oldest_wait_s=None if oldest is None else max(0.0, float(oldest)),
        running=by_status.get("running", 0),
        failures_by_kind=_pairs(session, _FAILURES),
        driven_km_by_highway=_pairs(session, _DRIVEN_KM),
        network_km=float(totals.network_km),
        segments=totals.segments,
        segments_driven=totals.segments_driven,
        drives=totals.drives,
        driven_distance_km=float(totals.driven_distance_km),
        uploaded_bytes=int(totals.uploaded_bytes),
        data_version=data_version(session),
        road_version=roads.current_road_version(session),
        dem_version_id=totals.dem_version_id,
    )


def _pairs(session: Session, query: Any) -> dict[str, Any]:
    return {row[0]: row[1] for row in session.execute(query)}
