"""What the slopes stand on, over HTTP: the regions of the road network and the elevation rasters. Knows no SQL."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.core.caller import present_caller
from app.core.db import Bounds
from app.core.http import BaseUrl, Link, OfTheMap, ServiceDep, link, problems
from app.core.text import Moment
from app.map import figures
from app.roads.store import all_regions, driven_by_region
from app.terrain.store import current_dem, rasters_came

FEW_SEGMENTS = 200_000
"""In all regions together: so many are looked at for who asks. Of more it is told what a worker found last."""

_REGION: dict[str, Any] = {
    "name": "karlsruhe",
    "source_name": "karlsruhe.osm.pbf",
    "imported_at": "2026-11-20T09:12:44.120Z",
    "segments": 141_793,
    "measured": 5_120,
    "bbox": [8.27, 48.94, 8.54, 49.09],
}
_REGIONS = {"regions": [_REGION], "measured_at": "2026-11-20T10:00:00.000Z", "links": []}
_RASTER: dict[str, Any] = {
    "name": "N49E008.hgt",
    "priority": 0,
    "resolution_m": 30.9,
    "bbox": [7.999861, 48.999861, 9.000139, 50.000139],
    "imported_at": "2026-11-20T09:14:02.500Z",
    "source": "Copernicus DEM GLO-30, © DLR and Airbus",
    "licence": "CC BY 4.0",
    "with_quality": False,
}
_RASTERS = {"rasters": [_RASTER], "datum": "EGM96", "links": []}

router = APIRouter(prefix="/v1", tags=["operation"])


class RegionSeen(BaseModel, json_schema_extra={"examples": [_REGION]}):
    """Roads that came from one file and are updated by the next of that name."""

    name: str
    source_name: str = Field(description="The file that it was imported from last.")
    imported_at: Moment
    segments: int
    measured: int = Field(description="Segments with a slope that a drive stands behind.")
    bbox: Bounds | None = Field(
        description="West, south, east, north of its roads, degrees; null: not known."
    )


class RegionList(OfTheMap, json_schema_extra={"examples": [_REGIONS]}):
    """All regions, by name."""

    regions: list[RegionSeen]
    measured_at: Moment | None = Field(
        description="Of which moment `measured` is: on a large map a worker counts every ten minutes; null: of now."
    )
    links: list[Link]


class RasterSeen(BaseModel, json_schema_extra={"examples": [_RASTER]}):
    """An elevation raster that is in use."""

    name: str
    priority: int = Field(
        description="Where rasters lie over each other the highest counts, of one the finest."
    )
    resolution_m: float | None = Field(
        description="Distance of its posts, the larger of rows and columns; null: imported before it was noted."
    )
    bbox: Bounds | None = Field(description="West, south, east, north, degrees; null: not known.")
    imported_at: Moment | None
    source: str | None = Field(description="Whose data it is, as was said at the import; null: nobody said.")
    licence: str | None = Field(description="Its licence; null: nobody said.")
    with_quality: bool = Field(
        description="Whether a quality layer tells how many scenes stand behind each post."
    )


class RasterList(BaseModel, json_schema_extra={"examples": [_RASTERS]}):
    """All elevation rasters that are in use."""

    rasters: list[RasterSeen]
    datum: str | None = Field(description="What heights refer to; null without any raster.")
    links: list[Link]


@router.get(
    "/regions",
    summary="Regions of the road network",
    response_model_exclude_unset=True,
    responses=problems(503),
)
def list_regions(service: ServiceDep, base: BaseUrl) -> RegionList:
    """The regions by name: what each was imported from, how many segments it has, and where it lies."""
    with service.reading() as session:
        regions = all_regions(session)
        measured, at = _measured(session, sum(one.segments for one in regions))
        note = service.edition_note(session)
    seen = [
        RegionSeen.model_validate({**vars(one), "measured": measured.get(one.name, 0), "bbox": one.bounds})
        for one in regions
    ]
    here = f"{base}/v1/regions"
    return RegionList(
        **note,
        regions=seen,
        measured_at=at,
        links=[link(here, "self"), link(f"{base}/v1/admin/coverage", "related", title="By road class")],
    )


@router.get("/rasters", summary="Elevation rasters", responses=problems(503))
def list_rasters(service: ServiceDep, base: BaseUrl) -> RasterList:
    """The rasters that give heights and slopes where none were measured. No file is opened."""
    with service.reading() as session:
        active = current_dem(session, service.settings.dem_dir)
        came = rasters_came(session)
    rasters = [
        RasterSeen(
            name=source.name,
            priority=source.priority,
            resolution_m=source.posting_m,
            bbox=source.bounds_deg,
            imported_at=came.get(source.uri),
            source=source.source,
            licence=source.licence,
            with_quality=source.with_quality,
        )
        for source in (active.sources if active else ())
    ]
    links = [
        link(f"{base}/v1/rasters", "self"),
        link(f"{base}/v1/admin/terrain", "related", title="Against drives, by tile"),
    ]
    return RasterList(rasters=rasters, datum=active.datum if active else None, links=links)


def _measured(session: Session, segments: int) -> tuple[dict[str, int], datetime | None]:
    """Driven segments by region, and of which moment; None: of this. What a worker counts is of the live map."""
    is_kept = segments > FEW_SEGMENTS and present_caller().sees == "live"
    coverage = figures.kept(session, "coverage") if is_kept else None
    if coverage is None:
        return driven_by_region(session), None
    driven_segments: dict[str, int] = {}
    for row in coverage.rows:
        driven_segments[row["region"]] = driven_segments.get(row["region"], 0) + int(row["driven_segments"])
    return driven_segments, coverage.made_at
