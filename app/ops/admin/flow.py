"""How drives flowed over time, and which versions of everything there are."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.schema import schema_state
from app.core.version import code_version

HOURLY_DAYS = 2
"""So many days at most are told by the hour."""
SAMPLED = 6000
"""Of how many drives at most medians are told, an equal part of each hour or day, the latest in it."""
LEAST_SAMPLED = 20

# Counts by the index on the end, which holds all that they need; medians of the latest drives of each bucket alone.
_THROUGHPUT = text(
    """
    WITH counted AS (
        SELECT date_trunc(:unit, finished_at, 'UTC') AS at, count(*) FILTER (WHERE status = 'done') AS done,
               count(*) FILTER (WHERE status = 'failed') AS failed,
               coalesce(sum(distance_m) FILTER (WHERE status = 'done'), 0) / 1000 AS km
        FROM drives
        WHERE finished_at >= date_trunc(:unit, now() - make_interval(days => CAST(:days AS integer)), 'UTC')
            AND finished_at IS NOT NULL
        GROUP BY 1
    )
    SELECT c.at, c.done, c.failed, c.km, m.waited_p50_s, m.computed_p50_s, m.published_p50_s
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
    """
)
_SERVER = text("SELECT current_setting('server_version'), postgis_lib_version()")
_ROADS = text("SELECT id, region, source_name, imported_at FROM road_versions ORDER BY id DESC LIMIT 1")
_ELEVATION = text(
    "SELECT id, datum, imported_at, jsonb_array_length(sources) AS rasters FROM dem_versions WHERE active"
)


def throughput(session: Session, days: int) -> list[dict[str, Any]]:
    """What ended in each hour, or, of more than ``HOURLY_DAYS`` days, on each day, by the clock of UTC."""
    values = {"unit": "hour" if days <= HOURLY_DAYS else "day", "days": days}
    rows = session.execute(_THROUGHPUT, {**values, "sampled": SAMPLED, "least": LEAST_SAMPLED})
    return [dict(row._mapping) for row in rows]


def versions(session: Session) -> list[dict[str, Any]]:
    """Of the program, the schema, the server, roads and elevation: ``what``, ``version``, ``detail``."""
    state = schema_state(session)
    server, postgis = session.execute(_SERVER).one()
    return [
        _version("code", code_version()),
        _version("schema", state.revision, f"serves programs from {state.oldest_program} on"),
        _version("postgresql", server),
        _version("postgis", postgis),
        *_imports(session),
    ]


def _imports(session: Session) -> list[dict[str, Any]]:
    roads = session.execute(_ROADS).one_or_none()
    elevation = session.execute(_ELEVATION).one_or_none()
    return [
        _version("roads", None, "none")
        if roads is None
        else _version("roads", roads.id, f"{roads.source_name}, {roads.imported_at:%Y-%m-%d %H:%M} UTC"),
        _version("elevation", None, "none")
        if elevation is None
        else _version(
            "elevation",
            elevation.id,
            f"{elevation.rasters} raster(s), heights above {elevation.datum}, "
            f"{elevation.imported_at:%Y-%m-%d %H:%M} UTC",
        ),
    ]


def _version(what: str, version: object, detail: str | None = None) -> dict[str, Any]:
    return {"what": what, "version": None if version is None else str(version), "detail": detail}
