"""Figures of the whole map: what reads every segment, or every rejected pass, is computed by a worker and stored.

How coverage grew is kept day by day. Stored vector tiles are counted by zoom, and how many are older than what they
show.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from sqlalchemy import Row, TextClause, text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.tiles.tiles import tag_of
from app.map.tiles.watch import Versions
from app.network.widenings import repeat_rows

_EPOCH = text("SELECT epoch || CAST(xmin AS text) FROM tile_epoch")
_CELLS = text("""
    SELECT id, version, drawn_version, CAST(extract(epoch FROM changed_at) * 1000000 AS bigint) FROM cells
""")
# A tile's tag names the zooms by which it was built last of all: from ".MIN.FULL" on.
_TILES = text("SELECT z, x, y, tag, size_bytes FROM stored_tiles")


def tiles_by_zoom(session: Session) -> list[dict[str, Any]]:
    """For each zoom with tiles: how many, their bytes, and how many would be built anew if they were asked for."""
    versions = Versions(str(session.execute(_EPOCH).scalar() or ""))
    versions.put([(row[0], row[1], row[2], row[3]) for row in session.execute(_CELLS)])
    rows: dict[int, dict[str, Any]] = {}
    for z, x, y, tag, size_bytes in session.execute(_TILES):
        row = rows.setdefault(z, {"zoom": z, "tiles": 0, "bytes": 0, "stale": 0})
        row["tiles"] += 1
        row["bytes"] += size_bytes
        row["stale"] += not _is_fresh(versions, z, x, y, tag)
    return [rows[z] for z in sorted(rows)]


def _is_fresh(versions: Versions, z: int, x: int, y: int, tag: str) -> bool:
    least, full = tag.rstrip('"').rsplit(".", 2)[-2:]
    if not (least.isdigit() and full.isdigit()):
        return False
    return tag == tag_of(versions, z, x, y, min_zoom=int(least), full_zoom=int(full))


LOOK_EVERY_S = 60.0
"""How often a worker looks."""
KEPT_S = 600.0
"""How old figures become before they are made again: a look at a million segments takes a second or two."""
MOST_ROWS = 500
"""Of a list of the worst; the rest is for nobody's eyes."""

LEAST_SIGMAS = 1.0
"""Of its own, by which a drive is off that disagrees."""

# A segment of two regions counts in both. Nobody's roads stand under no region.
COVERAGE = text("""
    SELECT coalesce(r.name, '') AS region, c.highway, c.segments, c.network_km, c.driven_segments, c.driven_km
    FROM (SELECT region_id, s.highway, count(*) AS segments, sum(s.length_m) / 1000 AS network_km,
                 count(a.segment_id) AS driven_segments,
                 coalesce(sum(s.length_m) FILTER (WHERE a.segment_id IS NOT NULL), 0) / 1000 AS driven_km
          FROM segments AS s
          CROSS JOIN LATERAL unnest(CASE WHEN s.regions = '{}' THEN ARRAY[CAST(NULL AS smallint)] ELSE s.regions END)
               AS region_id
          LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
          GROUP BY region_id, s.highway) AS c
    LEFT JOIN regions AS r ON r.id = c.region_id
    ORDER BY region, c.network_km DESC, c.highway
""")

# Classes of sigma as people read them, of drives in powers of two.
SIGMAS = text("""
    SELECT drives_from, sigma_from_percent, count(*) AS segments, sum(length_m) / 1000 AS km
    FROM (SELECT CAST(2 ^ floor(log(2, greatest(a.drives, 1))) AS integer) AS drives_from, s.length_m,
                 steps.percent[width_bucket(a.slope_sigma_percent, steps.percent)] AS sigma_from_percent
          FROM (SELECT CAST('{0,0.1,0.2,0.3,0.5,0.7,1,1.5,2,3,5,10}' AS float8[]) AS percent) AS steps,
               segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
          WHERE a.drives > 0) AS each
    GROUP BY drives_from, sigma_from_percent ORDER BY drives_from, sigma_from_percent
""")

# Drives disagree where passes are rejected; by how many, and how far apart they are. One that is rejected for what it
# says beside the segment, and agrees on it, is none of these.
# ``drives_unheard`` is the old name of ``drives_rejected``, for one version.
DISAGREEMENTS = text("""
    WITH worst AS (
        SELECT r.segment_id, count(DISTINCT r.drive_id) AS rejected
        FROM rejected_passes AS r GROUP BY r.segment_id ORDER BY rejected DESC, r.segment_id LIMIT 5 * :most
    )
    SELECT w.segment_id, s.osm_way_id, s.highway, s.name, a.slope_percent, a.slope_sigma_percent,
           coalesce(a.drives, 0) AS drives, w.rejected AS drives_rejected, w.rejected AS drives_unheard,
           e.lowest_percent, e.highest_percent, e.farthest_sigmas
    FROM worst AS w JOIN segments AS s ON s.id = w.segment_id
    LEFT JOIN segment_slopes AS a ON a.segment_id = w.segment_id
    CROSS JOIN LATERAL (
        SELECT min(d.slope_percent) AS lowest_percent, max(d.slope_percent) AS highest_percent,
               max(abs(d.slope_percent - a.slope_percent) / d.slope_sigma_percent) AS farthest_sigmas
        FROM drive_segments AS d WHERE d.segment_id = w.segment_id) AS e
    WHERE coalesce(e.farthest_sigmas, :least_sigmas) >= :least_sigmas
    ORDER BY w.rejected * least(coalesce(e.farthest_sigmas, 0), 100) DESC, w.segment_id LIMIT :most
""")

# On the open road, where both know something: elevation models know neither bridges nor tunnels. Tiles of zoom 12.
TERRAIN = text("""
    SELECT '12/' || (s.cell >> 16) || '/' || ((s.cell & 16383) >> 2) AS tile, count(*) AS segments,
           sum(s.length_m) / 1000 AS km,
           sum((s.dem_slope_percent - a.slope_percent) * s.length_m) / sum(s.length_m) AS mean_difference_percent,
           sqrt(sum((s.dem_slope_percent - a.slope_percent) ^ 2 * s.length_m) / sum(s.length_m))
               AS rms_difference_percent,
           sqrt(sum(a.slope_sigma_percent ^ 2 * s.length_m) / sum(s.length_m)) AS rms_sigma_percent
    FROM segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id
    WHERE a.drives > 0 AND s.dem_slope_percent IS NOT NULL AND NOT s.bridge AND NOT s.tunnel AND s.length_m > 0
    GROUP BY s.cell >> 16, (s.cell & 16383) >> 2
    ORDER BY rms_difference_percent DESC, tile LIMIT :most
""")

Rows = list[dict[str, Any]]


def _rows(statement: TextClause, session: Session) -> Rows:
    values = {"most": MOST_ROWS, "least_sigmas": LEAST_SIGMAS}
    return [dict(row._mapping) for row in session.execute(statement, values)]


KEPT: Mapping[str, Callable[[Session], Rows]] = {
    "coverage": partial(_rows, COVERAGE),
    "sigmas": partial(_rows, SIGMAS),
    "disagreements": partial(_rows, DISAGREEMENTS),
    "terrain": partial(_rows, TERRAIN),
    "repeats": repeat_rows,
    "tiles": tiles_by_zoom,
}
"""Name of figures -> how they are made."""

OF_NO_STATE = frozenset({"tiles"})
"""They change by themselves, whatever becomes of the map."""

# The last transaction that changed what any cell shows, the roads, and the rasters.
_STATE = text("""
    SELECT concat_ws('.', (SELECT max(changed_xid) FROM cells), (SELECT max(id) FROM road_versions),
                     (SELECT max(id) FROM dem_versions WHERE active))
""")
_READ = text("SELECT rows, made_at FROM kept_figures WHERE name = :name")
_DUE = text("""
    SELECT wanted.name FROM unnest(CAST(:names AS text[])) AS wanted (name)
    LEFT JOIN kept_figures AS k ON k.name = wanted.name
    WHERE k.name IS NULL OR (k.of_state <> :state AND k.made_at < clock_timestamp() - make_interval(secs => :age_s))
    ORDER BY k.made_at NULLS FIRST, wanted.name LIMIT 1
""")
_KEEP = text("""
    INSERT INTO kept_figures (name, rows, made_at, took_s, of_state)
    VALUES (:name, CAST(:rows AS jsonb), clock_timestamp(), :took_s, :state)
    ON CONFLICT (name) DO UPDATE
    SET rows = excluded.rows, made_at = excluded.made_at, took_s = excluded.took_s, of_state = excluded.of_state
""")


def make(session: Session, name: str) -> Rows:
    """The figures of this moment, JSON-serialisable."""
    return KEPT[name](session)


def kept(session: Session, name: str) -> Row[Any] | None:
    """The figures as they were made last: ``rows``, and ``made_at``."""
    return session.execute(_READ, {"name": name}).one_or_none()


def renew_one(sessions: Sessions) -> bool:
    """Make those figures again that are out of date the longest; whether there were any.

    Two workers may make the same at once; both are right.
    """
    with sessions() as session:
        # Of all that the figures are computed from but rejected passes, which come with slopes.
        state_then = str(session.execute(_STATE).scalar_one())
        values = {"names": sorted(KEPT), "state": state_then, "age_s": KEPT_S}
        name = session.execute(_DUE, values).scalar_one_or_none()
        if name is None:
            return False
        began = time.monotonic()
        rows = make(session, name)
        took_s = time.monotonic() - began
    of_state = "" if name in OF_NO_STATE else state_then
    with sessions.begin() as session:
        session.execute(_KEEP, {"name": name, "rows": json.dumps(rows), "took_s": took_s, "state": of_state})
    return True


NOTE_EVERY_S = 60.0
"""How often a worker notes how much is driven by now; the last note of a day stays."""

# Each cell keeps its own sums, so no segment is read.
_DRIVEN_NOW = """
    SELECT CAST(now() AT TIME ZONE 'UTC' AS date) AS day, of_class.key AS highway,
           CAST(sum(CAST(of_class.value ->> 0 AS bigint)) AS bigint) AS segments,
           sum(CAST(of_class.value ->> 1 AS float8)) AS length_m
    FROM cells, jsonb_each(driven) AS of_class WHERE driven <> '{}' GROUP BY of_class.key
"""
# Of two workers the later one is right. A class that is gone counts as none.
_NOTE = text(f"""
    WITH seen AS ({_DRIVEN_NOW}), gone AS (
        UPDATE driven_by_day SET segments = 0, length_m = 0
        WHERE day = CAST(now() AT TIME ZONE 'UTC' AS date) AND segments > 0
            AND highway NOT IN (SELECT highway FROM seen))
    INSERT INTO driven_by_day AS d (day, highway, segments, length_m)
    SELECT day, highway, segments, length_m FROM seen ORDER BY highway
    ON CONFLICT (day, highway) DO UPDATE SET segments = excluded.segments, length_m = excluded.length_m
    WHERE (d.segments, d.length_m) IS DISTINCT FROM (excluded.segments, excluded.length_m)
""")  # noqa: S608 - constants
_GROWTH = text("""
    SELECT day, highway, segments AS driven_segments, length_m / 1000 AS driven_km FROM driven_by_day
    WHERE day > CAST(now() AT TIME ZONE 'UTC' AS date) - CAST(:days AS integer)
    ORDER BY day, driven_km DESC, highway
""")


def note_today(sessions: Sessions) -> None:
    """Keep what is driven by now as that of today."""
    with sessions.begin() as session:
        session.execute(_NOTE)


def growth(session: Session, days: int) -> list[dict[str, Any]]:
    """What was driven at the end of each of so many days, by class of road; of today: when it was noted last."""
    return [dict(row._mapping) for row in session.execute(_GROWTH, {"days": days})]
