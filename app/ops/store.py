"""What the store returns: plain frozen rows, detached from any session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.network.versions import data_version
from app.roads import store as roads
from app.roads.store import RoadVersionRow


@dataclass(frozen=True)
class AdminStats:
    """Figures for operators. Days are UTC dates of the upload, oldest first."""

    drives_by_status: dict[str, int]
    drives_by_day: list[dict[str, Any]]
    """``{"day": date, "status": str, "drives": int}`` for each day and status of the last ``days`` days."""
    queue_depth: int
    queue_oldest_wait_s: float | None
    running: int
    failures_by_kind: dict[str, int]
    driven_km_by_highway: dict[str, float]
    """Length of distinct segments with an estimate, kilometres."""
    network_km: float
    segments: int
    segments_driven: int
    drives: int
    driven_distance_km: float
    """Sum over the drives, counting a road as often as it was driven."""
    uploaded_bytes: int
    data_version: int
    road_version: RoadVersionRow | None
    dem_version_id: int | None


# Both are answered from the index on (status, created_at, id).
_DRIVES_BY_STATUS = text("SELECT status, count(*) FROM drives GROUP BY status")
_OLDEST = text(
    "SELECT extract(epoch FROM clock_timestamp() - min(queued_at)) FROM drives WHERE status = 'queued'"
)
_VERSION = text("SELECT version FROM data_version")


@dataclass(frozen=True)
class Gauges:
    """Figures of one moment."""

    drives_by_status: dict[str, int]
    queue_depth: int
    oldest_wait_s: float
    data_version: int


def read_gauges(session: Session) -> Gauges:
    """The figures of this moment."""
    by_status = {str(status): int(count) for status, count in session.execute(_DRIVES_BY_STATUS)}
    oldest = session.execute(_OLDEST).scalar()
    return Gauges(
        drives_by_status=by_status,
        queue_depth=by_status.get("queued", 0),
        oldest_wait_s=max(0.0, float(oldest or 0.0)),
        data_version=int(session.execute(_VERSION).scalar_one()),
    )


_HAS_TABLE = text("SELECT to_regclass('alembic_version') IS NOT NULL")
_REVISION = text("SELECT version_num FROM alembic_version")


def schema_revision(session: Session) -> str | None:
    """The migration that the database is at, or None where none was applied."""
    if not session.execute(_HAS_TABLE).scalar_one():
        return None
    revision = session.execute(_REVISION).scalar()
    return None if revision is None else str(revision)


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
