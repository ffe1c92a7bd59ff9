"""The route to the heights along one segment: what was published of it, beside the elevation model."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from sqlalchemy.orm import Session

from app.core.http import BaseUrl, Link, ServiceDep, existing, link, problems, with_query
from app.core.text import GEO_JSON, LENGTH_DIGITS, rounded
from app.map.attribution import attribution
from app.map.heights.road_heights import measured_height
from app.map.heights.store import RoadHere, one_road
from app.map.segment import HEIGHT_DATUM
from app.map.segments import GapsQuery, SegmentId
from app.terrain.coverage import names_over
from app.terrain.store import current_dem
from fusion.network.curve import interval_count, knot_length
from fusion.types import Floats

PROFILE_EXAMPLE: dict[str, Any] = {
    "segment_id": 17,
    "length_m": 41.374,
    "along_m": [0.0, 12.5, 13.791, 27.583, 32.5, 41.374],
    "height_m": [151.204, 151.92, 152.022, 153.112, 153.501, 154.026],
    "height_sigma_m": [2.41, 2.41, 2.41, 2.41, 2.41, 2.41],
    "dem_height_m": [150.9, 151.5, 151.6, 152.3, 152.4, 152.6],
    "source": "drives",
    "datum": HEIGHT_DATUM,
    "attribution": attribution(),
    "links": [{"href": "http://127.0.0.1:8000/v1/segments/17", "rel": "up", "type": GEO_JSON}],
}

Metres = Annotated[float, BeforeValidator(lambda value: rounded(value, LENGTH_DIGITS))]
MaybeMetres = Annotated[float | None, BeforeValidator(lambda value: rounded(value, LENGTH_DIGITS))]


APART_M = 0.01
"""Places nearer to each other than this are one."""


class SegmentProfile(BaseModel):
    """Heights along a segment; all columns have one value for each place, null where it is unknown."""

    model_config = ConfigDict(json_schema_extra={"examples": [PROFILE_EXAMPLE]})

    segment_id: int
    length_m: Metres
    along_m: list[Metres] = Field(description="Metres from from_node, ascending, both ends among them.")
    height_m: list[MaybeMetres] = Field(
        description="Of the road, as published: those of its nodes, between which the grade is even but for the "
        "steepest stretch."
    )
    height_sigma_m: list[MaybeMetres] = Field(
        description="One standard deviation of each height by itself. Errors of neighbours go together, so heights "
        "differ far more surely than this; how surely, the slope's sigma says."
    )
    dem_height_m: list[MaybeMetres] = Field(
        description="Of the elevation model there: of the ground, also where the road is a bridge or tunnel."
    )
    source: Literal["drives", "neighbours"] | None = Field(
        description="What height_m rests on: drives over it, or (with gaps) those on both its sides; null: unknown."
    )
    datum: str = Field(description="What height_m refers to. The elevation model may have another.")
    attribution: str
    links: list[Link]


router = APIRouter(prefix="/v1/segments", tags=["segments"])


@router.get("/{segment_id}/profile", summary="The heights along a segment", responses=problems(404, 422, 503))
def segment_profile(
    segment_id: SegmentId, service: ServiceDep, base: BaseUrl, gaps: GapsQuery = None
) -> SegmentProfile:
    """Heights at the segment's ends and every 20 m or so between, measured and by the elevation model.

    Where nobody drove, `height_m` is null everywhere. With `gaps`, an undriven segment between driven ones has the
    heights that follow from the roads on both its sides; `source` says so.
    """
    with service.reading() as session:
        road, drives = existing(one_road(session, segment_id), "segment", segment_id)
        credit = _credit(session, service.settings.dem_dir, road)
    along_m = _places(road)
    source: Literal["drives", "neighbours"] | None = None
    if road.measured and (drives or gaps):
        source = "drives" if drives else "neighbours"
    height_m: list[float | None] = [None] * len(along_m)
    sigma_m = list(height_m)
    if source is not None:
        heights = [measured_height(road, share) for share in (along_m / road.length_m).tolist()]
        height_m = [one.height_m for one in heights]
        sigma_m = [None if road.height_sigma_m is None else one.sigma_m for one in heights]
    up = f"{base}/v1/segments/{segment_id}"
    return SegmentProfile(
        segment_id=segment_id,
        length_m=road.length_m,
        along_m=along_m.tolist(),
        height_m=height_m,
        height_sigma_m=sigma_m,
        dem_height_m=_of_model(road, along_m),
        source=source,
        datum=HEIGHT_DATUM,
        attribution=credit,
        links=[
            link(with_query(f"{up}/profile", gaps=gaps), "self"),
            link(with_query(up, gaps=gaps), "up", GEO_JSON),
        ],
    )


def _places(road: RoadHere) -> Floats:
    """Where the elevation model has heights of it, and where the steepest stretch begins and ends, m; shape (n,)."""
    knots = np.linspace(0.0, road.length_m, int(interval_count(knot_length(road.length_m))) + 1)
    bends = [at for at in (road.steepest_from_m, road.steepest_to_m) if at is not None]
    other = [at for at in bends if np.min(np.abs(knots - at)) > APART_M and 0.0 < at < road.length_m]
    return np.unique(np.r_[knots, other])


def _of_model(road: RoadHere, along_m: Floats) -> list[float | None]:
    heights = np.array(road.dem_heights_m or [], float)
    if not len(heights):
        return [None] * len(along_m)
    at = np.interp(along_m, np.linspace(0.0, road.length_m, len(heights)), heights)
    return [height if np.isfinite(height) else None for height in at.tolist()]


def _credit(session: Session, folder: Any, road: RoadHere) -> str:
    if not road.dem_heights_m:
        return attribution()
    ends = [(road.lon0_deg, road.lat0_deg), (road.lon1_deg, road.lat1_deg)]
    return attribution(names_over(current_dem(session, folder), [(*end, *end) for end in ends]))
