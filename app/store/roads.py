"""The road network: its import, and extracts around a drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.store import locks, slopes
from app.store.road_copy import copy_roads
from app.store.rows import Bounds, ImportCounts, RoadVersionRow
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints, Progress, no_progress

_LINE_HEADER_BYTES = 9  # WKB: byte order, type, number of points
_METRES_PER_DEGREE = 110_000.0  # a little less than any degree of latitude, so that boxes come out wider

_CURRENT = text(
    """
    SELECT id, source_name, sha256, imported_at, segments, kept, moved, dropped, added
    FROM road_versions ORDER BY id DESC LIMIT 1
    """
)
_NEW_VERSION = text(
    """
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added)
    VALUES (:source_name, :sha256, :segments, 0, 0, 0, 0) RETURNING id
    """
)
_SET_COUNTS = text(
    """
    UPDATE road_versions SET kept = :kept, moved = :moved, dropped = :dropped, added = :added WHERE id = :id
    """
)

# What the merge below takes away: segments with measured slopes that are gone or moved, and their drives.
_MEASURED_LOST = text(
    """
    SELECT count(DISTINCT e.segment_id), count(DISTINCT e.drive_id)
    FROM drive_segments AS e JOIN segments AS s ON s.id = e.segment_id
    LEFT JOIN road_import AS i
        ON i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
    WHERE i.osm_way_id IS NULL OR NOT s.geom = i.geom
    """
)

# The merge, in this order: drop what is gone, update what is there, add what is new. Each statement handles
# all segments at once. Estimates and aggregates of dropped segments go by their foreign keys.
_DROP = text(
    """
    DELETE FROM segments AS s WHERE NOT EXISTS (
        SELECT FROM road_import AS i
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node)
    """
)

# A segment between the same nodes whose course changed is another road as far as its slope goes: what was
# measured on the old course is dropped. (=) on geometries compares every coordinate bit for bit.
_MOVE = text(
    """
    WITH moved AS (
        UPDATE segments AS s
        SET geom = i.geom, geom_3857 = i.geom_3857, length_m = i.length_m, road_version_id = :version
        FROM road_import AS i
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
            AND NOT s.geom = i.geom
        RETURNING s.id
    ), estimates AS (
        DELETE FROM drive_segments USING moved WHERE segment_id = moved.id
    ), aggregates AS (
        DELETE FROM segment_slopes USING moved WHERE segment_id = moved.id
    )
    SELECT count(*) FROM moved
    """
)

# Only rows that differ are written: an unchanged row costs a comparison, a written one both of its indexes.
_UPDATE_TAGS = text(
    """
    UPDATE segments AS s
    SET highway = t.highway, name = t.name, oneway = i.oneway, bridge = i.bridge, tunnel = i.tunnel,
        layer = i.layer, dem_slope_percent = nullif(i.dem_slope_percent, 'NaN')
    FROM road_import AS i JOIN road_import_tags AS t USING (tag)
    WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node
        AND (s.highway, s.name, s.oneway, s.bridge, s.tunnel, s.layer, s.dem_slope_percent) IS DISTINCT FROM
            (t.highway, t.name, i.oneway, i.bridge, i.tunnel, i.layer, nullif(i.dem_slope_percent, 'NaN'))
    """
)

_ADD = text(
    """
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, name, oneway,
                          bridge, tunnel, layer, dem_slope_percent, road_version_id)
    SELECT i.osm_way_id, i.from_node, i.to_node, i.geom, i.geom_3857, i.length_m, t.highway, t.name, i.oneway,
           i.bridge, i.tunnel, i.layer, nullif(i.dem_slope_percent, 'NaN'), :version
    FROM road_import AS i JOIN road_import_tags AS t USING (tag)
    WHERE NOT EXISTS (
        SELECT FROM segments AS s
        WHERE i.osm_way_id = s.osm_way_id AND i.from_node = s.from_node AND i.to_node = s.to_node)
    """
)


# The planner must not go by the figures of an empty table until autovacuum comes round.
_ANALYZE = text("ANALYZE segments")


def current_road_version(session: Session) -> RoadVersionRow | None:
    """The last import, or None before the first."""
    row = session.execute(_CURRENT).one_or_none()
    return None if row is None else RoadVersionRow(**row._mapping)


def replace_roads(
    session: Session,
    table: RoadTable,
    source_name: str,
    sha256: str,
    progress: Progress = no_progress,
    *,
    dem_slope_percent: Floats | None = None,
) -> ImportCounts:
    """Make ``table`` the whole network: a segment that is not in it is dropped, wherever it lies.

    A segment whose (way, from, to) and geometry are unchanged is kept with its id and its estimates, and its
    tags are brought up to date; one whose geometry changed ("moved") keeps its id and loses its estimates.
    ``dem_slope_percent`` has shape (n,), NaN unknown; None: unknown everywhere. Waits for running writers of
    estimates and keeps new ones out until the caller commits.
    """
    locks.own_network(session)
    unknown = np.full(len(table), np.nan)
    copy_roads(session, table, unknown if dem_slope_percent is None else dem_slope_percent, progress)
    values: dict[str, Any] = {"source_name": source_name, "sha256": sha256, "segments": len(table)}
    version = int(session.execute(_NEW_VERSION, values).scalar_one())
    progress("merging", 0.0)
    measured_lost, drives_affected = session.execute(_MEASURED_LOST).one()
    dropped = _count(session.execute(_DROP))
    moved = int(session.execute(_MOVE, {"version": version}).scalar_one())
    progress("merging", 0.3)
    session.execute(_UPDATE_TAGS)
    progress("merging", 0.5)
    added = _count(session.execute(_ADD, {"version": version}))
    merged = {"kept": len(table) - moved - added, "moved": moved, "dropped": dropped, "added": added}
    session.execute(_SET_COUNTS, {"id": version, **merged})
    session.execute(_ANALYZE)
    slopes.bump_data_version(session)
    progress("merging", 1.0)
    return ImportCounts(
        **merged,
        measured_lost=measured_lost,
        drives_affected=drives_affected,
        skipped=dict(table.skipped),
    )


# --- extracts -----------------------------------------------------------------------------------------------

_COLUMNS = """
    SELECT s.id, s.osm_way_id, s.from_node, s.to_node, ST_AsBinary(s.geom, 'NDR') AS line, s.oneway, s.bridge,
           s.tunnel, s.layer, s.highway, s.name
    FROM segments AS s
"""
_BY_IDENTITY = " ORDER BY s.osm_way_id, s.from_node, s.to_node"
_ALL = text(_COLUMNS + _BY_IDENTITY)
_IN_BOX = text(
    _COLUMNS + "WHERE s.geom && ST_MakeEnvelope(:west, :south, :east, :north, 4326)" + _BY_IDENTITY
)


def roads_near(session: Session, bounds_deg: Bounds, margin_m: float = 250.0) -> tuple[RoadTable, Ints]:
    """The segments that ``RoadTable.near`` would select from the whole network, and their ids, shape (n,).

    Coordinates are bit for bit those that were imported, rows sorted as in every ``RoadTable``, so that the
    same log on the same roads gives the same numbers with and without a database.
    """
    west, south, east, north = bounds_deg
    lat_margin = margin_m / _METRES_PER_DEGREE
    farthest = min(max(abs(south), abs(north)) + lat_margin, 89.9)
    lon_margin = lat_margin / float(np.cos(np.radians(farthest)))
    wider, ids = roads_within(
        session, (west - lon_margin, south - lat_margin, east + lon_margin, north + lat_margin)
    )
    near = wider.near(bounds_deg, margin_m)
    return near, ids[rows_of(wider, near)]


def roads_within(session: Session, bounds_deg: Bounds) -> tuple[RoadTable, Ints]:
    """At least the segments whose bounding box meets ``bounds_deg``, and their ids, shape (n,).

    The index compares boxes in single precision, rounded outwards, so a few more may come along.
    """
    west, south, east, north = bounds_deg
    box = {"west": west, "south": south, "east": east, "north": north}
    return _table(list(session.execute(_IN_BOX, box)))


def all_roads(session: Session) -> tuple[RoadTable, Ints]:
    """The whole network and the segments' ids, shape (n,)."""
    return _table(list(session.execute(_ALL)))


def rows_of(table: RoadTable, part: RoadTable) -> Ints:
    """For each segment of ``part`` its row in ``table``, which holds them all; shape (len(part),)."""
    row = {identity: k for k, identity in enumerate(_identities(table))}
    return np.array([row[identity] for identity in _identities(part)], np.int64)


def _identities(table: RoadTable) -> Any:
    return zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)


def _table(rows: list[Row[Any]]) -> tuple[RoadTable, Ints]:
    """Rows of ``_COLUMNS`` as a table; they come sorted."""
    lines = b"".join(bytes(row.line)[_LINE_HEADER_BYTES:] for row in rows)
    lon0, lat0, lon1, lat1 = np.frombuffer(lines, "<f8").reshape(-1, 4).astype(np.float64).T.copy()
    table = RoadTable(
        osm_way_id=np.array([row.osm_way_id for row in rows], np.int64),
        from_node=np.array([row.from_node for row in rows], np.int64),
        to_node=np.array([row.to_node for row in rows], np.int64),
        lon0_deg=lon0,
        lat0_deg=lat0,
        lon1_deg=lon1,
        lat1_deg=lat1,
        oneway=np.array([row.oneway for row in rows], np.int8),
        bridge=np.array([row.bridge for row in rows], np.bool_),
        tunnel=np.array([row.tunnel for row in rows], np.bool_),
        layer=np.array([row.layer for row in rows], np.int8),
        highway=np.array([row.highway for row in rows], np.object_),
        name=np.array([row.name for row in rows], np.object_),
    )
    return table, np.array([row.id for row in rows], np.int64)


def _count(result: Any) -> int:
    return int(result.rowcount)
