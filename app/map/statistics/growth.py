"""How coverage grew: what is driven of each class of roads, kept day by day by whoever works beside the drives."""

from __future__ import annotations

from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions

LOOK_EVERY_S = 600.0
"""How often a worker notes how much is driven by now; the last note of a day stays."""

# Each cell keeps its own sums, so no segment is read.
_NOW = """
    SELECT CAST(now() AT TIME ZONE 'UTC' AS date) AS day, of_class.key AS highway,
           CAST(sum(CAST(of_class.value ->> 0 AS bigint)) AS bigint) AS segments,
           sum(CAST(of_class.value ->> 1 AS float8)) AS length_m
    FROM cells, jsonb_each(driven) AS of_class WHERE driven <> '{}' GROUP BY of_class.key
"""
# Of two workers the later one is right. A class that is gone counts as none.
_NOTE = text(
    f"""
    WITH seen AS ({_NOW}), gone AS (
        UPDATE driven_by_day SET segments = 0, length_m = 0
        WHERE day = CAST(now() AT TIME ZONE 'UTC' AS date) AND segments > 0
            AND highway NOT IN (SELECT highway FROM seen))
    INSERT INTO driven_by_day AS d (day, highway, segments, length_m)
    SELECT day, highway, segments, length_m FROM seen ORDER BY highway
    ON CONFLICT (day, highway) DO UPDATE SET segments = excluded.segments, length_m = excluded.length_m
    WHERE (d.segments, d.length_m) IS DISTINCT FROM (excluded.segments, excluded.length_m)
    """  # noqa: S608 - constants
)
_READ = text(
    f"""
    SELECT day, highway, segments AS driven_segments, length_m / 1000 AS driven_km
    FROM (SELECT day, highway, segments, length_m FROM driven_by_day
          WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
              AND day < CAST(now() AT TIME ZONE 'UTC' AS date)
          UNION ALL {_NOW}) AS each
    ORDER BY day, length_m DESC, highway
    """  # noqa: S608 - constants
)


def note_today(sessions: Sessions) -> None:
    """Keep what is driven by now as that of today."""
    with sessions.begin() as session:
        session.execute(_NOTE)


def growth(session: Session, days: int) -> list[dict[str, Any]]:
    """What was driven at the end of each of so many days, by class of road; of today: now."""
    return [dict(row._mapping) for row in session.execute(_READ, {"days": days})]
