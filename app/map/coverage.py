"""What the stored map covers and whose data it is: what several routes say of it beside its segments."""

from __future__ import annotations

from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.http import Service
from app.roads.store import road_extent, road_tag
from app.terrain.store import current_dem


def cached_extent(service: Service, session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Read once per road import."""
    version = road_tag(session)
    if version not in service.extents:
        service.extents.clear()
        service.extents[version] = road_extent(session)
    return service.extents.get(version)


def dem_names(service: Service, session: Session) -> tuple[str, ...]:
    """The active elevation rasters, as attributions name them; empty without any."""
    active = current_dem(session, service.settings.dem_dir)
    return active.names if active else ()
