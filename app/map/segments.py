"""Routes to one segment, to the drives behind it and to the heights along it, with their documents.

What the other routes of the map have in common with these is here as well: parameters and examples.
"""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Response
from pydantic import BaseModel, BeforeValidator, Field

from app.core.caller import present_caller
from app.core.http import (
    EXAMPLE_ID,
    BaseUrl,
    Link,
    OfTheMap,
    ServiceDep,
    existing,
    geojson_answer,
    geojson_response,
    link,
    link_documents,
    problems,
    with_query,
)
from app.core.query import cursor_of, parse_cursor
from app.core.standby.use import MapRoute
from app.core.text import GEO_JSON, LENGTH_DIGITS, SLOPE_DIGITS, Moment, rounded
from app.map import store as segments
from app.map.heights.road_heights import measured_height
from app.map.heights.store import RoadHere, one_road
from app.map.segment import HEIGHT_DATUM, Segment, attribution
from app.terrain.coverage import names_over
from app.terrain.store import current_dem
from fusion.network.curve import interval_count, knot_length
from fusion.types import Floats

MAX_ID = 2**63 - 1

SegmentId = Annotated[int, Path(ge=1, le=MAX_ID, description="The segment's number.", examples=[17])]
GapsQuery = Annotated[
    bool | None,
    Query(description="With true, undriven segments between driven ones come with the slope that follows."),
]
CursorQuery = Annotated[
    str | None, Query(description="Where the page begins; only `next` links know what to write here.")
]
OBSERVATIONS_PER_PAGE = 100

EXAMPLE_ADDRESS = "http://127.0.0.1:8000/collections/segments/items"
FEATURE_EXAMPLE = Segment(
    id=17,
    osm_way_id=23_456_789,
    from_node=1001,
    to_node=1002,
    length_m=41.374,
    highway="residential",
    name="Turmbergstraße",
    oneway=0,
    bridge=False,
    tunnel=False,
    slope_percent=6.8214,
    slope_sigma_percent=0.3127,
    drives=3,
    observations=24,
    dem_slope_percent=4.1,
    updated_at=datetime(2026, 11, 20, 9, 13, 2, 4000, UTC),
    coordinates=((8.4812345, 48.9912345), (8.4815678, 48.9915432)),
    height_from_m=151.204,
    height_to_m=154.026,
    height_sigma_m=2.41,
    steepest_percent=7.9037,
    steepest_from_m=12.5,
    steepest_to_m=32.5,
    driven_share=1.0,
).geojson()

SEGMENT_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "attribution": attribution(),
    "height_datum": HEIGHT_DATUM,
    "numberReturned": 1,
    "links": [{"href": EXAMPLE_ADDRESS, "rel": "self", "type": GEO_JSON}],
    "features": [FEATURE_EXAMPLE],
}
OBSERVATION_EXAMPLE: dict[str, Any] = {
    "drive_id": EXAMPLE_ID,
    "drive_time": "2026-11-20T07:55:10.000Z",
    "slope_percent": 6.75,
    "slope_sigma_percent": 0.41,
    "observations": 8,
    "passes": 1,
    "first_at": "2026-11-20T07:55:31.000Z",
    "last_at": "2026-11-20T07:55:38.000Z",
    "in_network": True,
    "accepted": True,
    "weight": 0.5316,
    "method": "profile",
    "options": {"doppler": True, "match_radius_m": 50.0},
    "code_version": "0.1.0",
    "road_version_id": 2,
    "dem_version_id": 1,
    "estimated_at": "2026-11-20T09:13:02.004Z",
}

Percent = Annotated[float, BeforeValidator(lambda value: rounded(value, SLOPE_DIGITS))]
Share = Annotated[float, BeforeValidator(lambda value: rounded(value, 4))]


class Observation(BaseModel):
    """What one drive says about a segment, and how that estimate was made."""

    drive_id: uuid.UUID
    drive_time: Moment | None
    slope_percent: Percent
    slope_sigma_percent: Percent
    observations: int = Field(description="Epochs used.")
    passes: int = Field(description="How often the drive went over the segment.")
    first_at: Moment
    last_at: Moment
    in_network: bool = Field(description="Solved together with all drives, rather than averaged with them.")
    accepted: bool | None = Field(
        description="Whether the drive is accepted here, or contradicts the others; null unless in_network."
    )
    weight: Share = Field(
        description="Its share in the segment's slope, 0..1, by the inverse variance of its own estimate."
    )
    method: str
    options: dict[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None
    estimated_at: Moment


_OBSERVATIONS_EXAMPLE = {"segment_id": 17, "observations": [OBSERVATION_EXAMPLE], "links": []}


class ObservationList(BaseModel, json_schema_extra={"examples": [_OBSERVATIONS_EXAMPLE]}):
    """One page of the drives behind a segment's slope, the one that came there last first."""

    segment_id: int
    observations: list[Observation]
    links: list[Link] = Field(description="`next` is missing on the last page.")


router = APIRouter(prefix="/v1/segments", tags=["segments"], route_class=MapRoute)
behind = APIRouter(
    prefix="/v1/segments", tags=["segments"]
)  # names drives, which may have been removed just now


@router.get(
    "/{segment_id}",
    summary="One segment",
    response_class=Response,
    responses={200: geojson_answer("The segment.", FEATURE_EXAMPLE), **problems(404, 422, 503)},
)
def get_segment(
    segment_id: SegmentId, service: ServiceDep, base: BaseUrl, gaps: GapsQuery = None
) -> Response:
    """The segment with the slope that all its drives together give.

    With `gaps` an undriven segment between driven ones has the slope that follows from the roads on both its sides,
    and 0 drives.
    """
    with service.reading() as session:
        row = existing(segments.get_segment(session, segment_id, gaps=bool(gaps)), "segment", segment_id)
        note = service.edition_note(session)
    here = f"{base}/v1/segments/{segment_id}"
    item = f"{base}/collections/segments/items/{segment_id}"
    observations = [link(f"{here}/observations", "observations", title="The drives behind it")]
    if not present_caller().may("own"):
        observations = []
    links = [
        link(with_query(here, gaps=gaps), "self", GEO_JSON),
        *observations,
        link(with_query(f"{here}/profile", gaps=gaps), "related", title="The heights along it"),
        link(with_query(item, gaps=gaps), "alternate", GEO_JSON),
    ]
    return geojson_response({**row.geojson(), **note, "links": link_documents(links)})


@behind.get(
    "/{segment_id}/observations", summary="The drives behind a segment", responses=problems(404, 422, 503)
)
def segment_observations(
    segment_id: SegmentId,
    service: ServiceDep,
    base: BaseUrl,
    limit: Annotated[int, Query(ge=1, le=1000, description="Drives per page.")] = OBSERVATIONS_PER_PAGE,
    after: CursorQuery = None,
) -> ObservationList:
    """What each drive says about the segment and how that estimate was made, the latest there first.

    With a key of scope `own` these are the drives of its owner, with `operate` all. `weight` is the share among all.
    Follow the `next` link until there is none; each drive comes once.
    """
    place = None
    if after is not None:
        moment, number = parse_cursor(after)
        place = moment, uuid.UUID(int=number)
    with service.reading() as session:
        existing(segments.get_segment(session, segment_id), "segment", segment_id)
        rows = segments.segment_observations(session, segment_id, limit=limit + 1, after=place)
    shown, more = rows[:limit], len(rows) > limit
    up = f"{base}/v1/segments/{segment_id}"
    here = f"{up}/observations"
    own = {} if limit == OBSERVATIONS_PER_PAGE else {"limit": limit}
    links = [link(with_query(here, **own, after=after), "self"), link(up, "up", GEO_JSON)]
    if more:
        following = cursor_of(shown[-1].first_at, shown[-1].drive_id.int)
        links.append(link(with_query(here, **own, after=following), "next"))
    return ObservationList(
        segment_id=segment_id, observations=[Observation(**row._mapping) for row in shown], links=links
    )


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


class SegmentProfile(OfTheMap, json_schema_extra={"examples": [PROFILE_EXAMPLE]}):
    """Heights along a segment; all columns have one value for each place, null where it is unknown."""

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


@router.get(
    "/{segment_id}/profile",
    summary="The heights along a segment",
    response_model_exclude_unset=True,
    responses=problems(404, 422, 503),
)
def segment_profile(
    segment_id: SegmentId, service: ServiceDep, base: BaseUrl, gaps: GapsQuery = None
) -> SegmentProfile:
    """Heights at the segment's ends and every 20 m or so between, measured and by the elevation model.

    Where nobody drove, `height_m` is null everywhere. With `gaps`, an undriven segment between driven ones has the
    heights that follow from the roads on both its sides; `source` says so.
    """
    with service.reading() as session:
        road, drives = existing(one_road(session, segment_id), "segment", segment_id)
        rasters: tuple[str, ...] = ()
        if road.dem_heights_m:
            ends = [(road.lon0_deg, road.lat0_deg), (road.lon1_deg, road.lat1_deg)]
            active = current_dem(session, service.settings.dem_dir)
            rasters = names_over(active, [(*end, *end) for end in ends])
        note = service.edition_note(session)
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
        **note,
        segment_id=segment_id,
        length_m=road.length_m,
        along_m=along_m.tolist(),
        height_m=height_m,
        height_sigma_m=sigma_m,
        dem_height_m=_of_model(road, along_m),
        source=source,
        datum=HEIGHT_DATUM,
        attribution=attribution(rasters),
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
