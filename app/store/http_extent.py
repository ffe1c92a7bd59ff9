"""Where the road network lies, for the collection's and the tiles' bounds."""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.store.rows import Bounds

_ROAD_VERSION = text("SELECT coalesce(max(id), 0) FROM road_versions")
_EXTENT = text(
    "SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e) "
    "FROM (SELECT ST_Extent(geom) AS e FROM segments) AS x"
)


def road_version_id(session: Session) -> int:
    """Id of the newest road import, 0 before the first."""
    return int(session.execute(_ROAD_VERSION).scalar_one())


def road_extent(session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Reads the whole table."""
    west, south, east, north = session.execute(_EXTENT).one()
    return None if west is None else (float(west), float(south), float(east), float(north))
