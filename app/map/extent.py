"""The network's extent, read once per road import."""

from __future__ import annotations

from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.http import Service
from app.roads.store import road_extent, road_version_id


def cached_extent(service: Service, session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any."""
    version = road_version_id(session)
    if version not in service.extents:
        service.extents.clear()
        service.extents[version] = road_extent(session)
    return service.extents.get(version)
