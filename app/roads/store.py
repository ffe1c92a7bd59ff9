"""Which roads are stored: the import that brought them, and how far they reach.

The roads themselves are read by ``app.network.extracts``, and written by ``app.roads.imports``.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds

_EXTENT = text("""
    SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e) FROM (SELECT ST_Extent(geom) AS e FROM segments) AS x
""")

_CROWDED = text("SELECT cell, count(*) FROM segments GROUP BY cell")


def road_extent(session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Reads the whole table."""
    west, south, east, north = session.execute(_EXTENT).one()
    return None if west is None else (float(west), float(south), float(east), float(north))


def road_crowds(session: Session) -> dict[int, int]:
    """How many segments have their middle in each cell of the map that has any."""
    return {int(cell): int(count) for cell, count in session.execute(_CROWDED)}


@dataclass(frozen=True)
class RoadVersionRow:
    """One import of the road network."""

    id: int
    source_name: str
    sha256: str
    imported_at: datetime
    segments: int
    kept: int
    moved: int
    dropped: int
    added: int


# The whole network is as it was until the import has ended.
_BEGIN = text("""
    INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added, length_m, region)
    SELECT :source_name, :sha256, coalesce(last.segments, 0), 0, 0, 0, 0,
           CASE WHEN last.id IS NULL THEN 0 ELSE last.length_m END, :region
    FROM (SELECT 1) AS one LEFT JOIN (SELECT * FROM road_versions ORDER BY id DESC LIMIT 1) AS last ON true
    RETURNING id, imported_at
""")
_END = text("""
    UPDATE road_versions
    SET kept = :kept, moved = :moved, dropped = :dropped, added = :added, imported_at = clock_timestamp(),
        segments = whole.segments, length_m = whole.length_m
    FROM (SELECT count(*) AS segments, coalesce(sum(length_m), 0) AS length_m FROM segments) AS whole
    WHERE id = :id
""")
# The planner must not go by the figures of an empty table until autovacuum comes round.
_ANALYZE = text("ANALYZE segments")
_ROAD_VERSION = text("SELECT coalesce(max(id), 0) FROM road_versions")
_ROAD_TAG = text("SELECT max(id), max(imported_at) FROM road_versions")
_CURRENT = text("""
    SELECT id, source_name, sha256, imported_at, segments, kept, moved, dropped, added
    FROM road_versions ORDER BY id DESC LIMIT 1
""")


def road_version_id(session: Session) -> int:
    """Id of the newest road import, 0 before the first."""
    return int(session.execute(_ROAD_VERSION).scalar_one())


def current_road_version(session: Session) -> RoadVersionRow | None:
    """The last import, or None before the first."""
    row = session.execute(_CURRENT).one_or_none()
    return None if row is None else RoadVersionRow(**row._mapping)


def road_tag(session: Session) -> tuple[object, ...]:
    """Is another when an import has begun, and another again when it has ended."""
    return tuple(session.execute(_ROAD_TAG).one())


def begin_version(session: Session, source_name: str, sha256: str, region: str) -> tuple[int, datetime]:
    """Note that an import begins; its number, and when that was by the database's clock."""
    values = {"source_name": source_name, "sha256": sha256, "region": region}
    row = session.execute(_BEGIN, values).one()
    return int(row.id), row.imported_at


def end_version(session: Session, version_id: int, **counts: int) -> None:
    """Note what the import did (``kept``, ``moved``, ``dropped``, ``added``), and how large the network is now.

    Reads the whole table.
    """
    session.execute(_END, {"id": version_id, **counts})
    session.execute(_ANALYZE)
