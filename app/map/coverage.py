"""What the stored map covers and whose data it is: what several routes say of it beside its segments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.http import Service
from app.map.segment import Segment
from app.roads.store import road_extent, road_tag
from app.terrain.coverage import names_over, rasters_over
from app.terrain.store import current_dem


def cached_extent(service: Service, session: Session) -> Bounds | None:
    """West, south, east, north of all segments, degrees; None without any. Read once per road import."""
    version = road_tag(session)
    if version not in service.extents:
        service.extents.clear()
        service.extents[version] = road_extent(session)
    return service.extents.get(version)


def dem_names(service: Service, session: Session, shown: Sequence[Segment] | None = None) -> tuple[str, ...]:
    """The active elevation rasters that cover a segment that is shown, as attributions name them; None: any segment."""
    active = current_dem(session, service.settings.dem_dir)
    return rasters_over(session, active) if shown is None else names_over(active, [_box(s) for s in shown])


def dem_names_at(
    service: Service, session: Session, places: Iterable[tuple[float, float]]
) -> tuple[str, ...]:
    """The same of rasters that cover one of these places (longitude, latitude), which are looked at only if need be."""
    active = current_dem(session, service.settings.dem_dir)
    if active is None or not active.sources:
        return ()
    return names_over(active, [(lon, lat, lon, lat) for lon, lat in places])


def _box(segment: Segment) -> Bounds:
    (lon0, lat0), (lon1, lat1) = segment.coordinates
    return min(lon0, lon1), min(lat0, lat1), max(lon0, lon1), max(lat0, lat1)
