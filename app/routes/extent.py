"""The network's extent, read once per road import."""

from __future__ import annotations

from sqlalchemy.orm import Session

from app.routes.deps import Service
from app.store.http_extent import road_extent, road_version_id
from app.store.rows import Bounds


def cached_extent(service: Service, session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any."""
    version = road_version_id(session)
    if version not in service.extents:
        service.extents.clear()
        service.extents[version] = road_extent(session)
    return service.extents.get(version)
