"""Which roads are stored: the import that brought them, and how far they reach.

The roads themselves are read by ``app.network.extracts``, and written by ``app.roads.imports``.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds

_EXTENT = text(
    """
    SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e) FROM (SELECT ST_Extent(geom) AS e FROM segments) AS x
    """
)


def road_extent(session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Reads the whole table."""
    west, south, east, north = session.execute(_EXTENT).one()
    return None if west is None else (float(west), float(south), float(east), float(north))


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


_ROAD_VERSION = text("SELECT coalesce(max(id), 0) FROM road_versions")
_CURRENT = text(
    """
    SELECT id, source_name, sha256, imported_at, segments, kept, moved, dropped, added
    FROM road_versions ORDER BY id DESC LIMIT 1
    """
)


def road_version_id(session: Session) -> int:
    """Id of the newest road import, 0 before the first."""
    return int(session.execute(_ROAD_VERSION).scalar_one())


def current_road_version(session: Session) -> RoadVersionRow | None:
    """The last import, or None before the first."""
    row = session.execute(_CURRENT).one_or_none()
    return None if row is None else RoadVersionRow(**row._mapping)
