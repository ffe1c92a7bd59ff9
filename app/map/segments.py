"""Routes to one segment and to the drives behind it, with their documents.

What the other routes of the map have in common with these is here as well: parameters and examples.
"""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from app.core.http import (
    EXAMPLE_ID,
    BaseUrl,
    Link,
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
from app.core.text import GEO_JSON, SLOPE_DIGITS, Moment, rounded
from app.map import store as segments
from app.map.attribution import attribution
from app.map.segment import HEIGHT_DATUM, Segment
from app.map.store import ObservationRow

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

    @classmethod
    def of(cls, row: ObservationRow) -> Observation:
        """Build from what the store returns."""
        return cls(**vars(row))


class ObservationList(BaseModel):
    """One page of the drives behind a segment's slope, the one that came there last first."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"segment_id": 17, "observations": [OBSERVATION_EXAMPLE], "links": []}]
        }
    )

    segment_id: int
    observations: list[Observation]
    links: list[Link] = Field(description="`next` is missing on the last page.")


router = APIRouter(prefix="/v1/segments", tags=["segments"])


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
    here = f"{base}/v1/segments/{segment_id}"
    item = f"{base}/collections/segments/items/{segment_id}"
    links = [
        link(with_query(here, gaps=gaps), "self", GEO_JSON),
        link(f"{here}/observations", "observations", title="The drives behind it"),
        link(with_query(f"{here}/profile", gaps=gaps), "related", title="The heights along it"),
        link(with_query(item, gaps=gaps), "alternate", GEO_JSON),
    ]
    return geojson_response({**row.geojson(), "links": link_documents(links)})


@router.get(
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

    Follow the `next` link until there is none; each drive comes once.
    """
    place = None if after is None else _place(after)
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
        segment_id=segment_id, observations=[Observation.of(row) for row in shown], links=links
    )


def _place(cursor: str) -> tuple[datetime, uuid.UUID]:
    moment, number = parse_cursor(cursor)
    return moment, uuid.UUID(int=number)
