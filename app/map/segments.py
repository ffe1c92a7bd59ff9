"""One segment, and the drives behind it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from app.core.http import (
    BaseUrl,
    ServiceDep,
    found,
    geojson_answer,
    geojson_response,
    link,
    link_documents,
    problems,
    with_query,
)
from app.core.text import GEO_JSON
from app.map import store as segments
from app.map.documents import Observation, ObservationList
from app.map.examples import FEATURE_EXAMPLE
from app.map.segment import feature_of

MAX_ID = 2**63 - 1

SegmentId = Annotated[int, Path(ge=1, le=MAX_ID, description="The segment's number.", examples=[17])]
GapsQuery = Annotated[
    bool | None,
    Query(description="With true, undriven segments between driven ones come with the slope that follows."),
]

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
        row = found(segments.get_segment(session, segment_id, gaps=bool(gaps)), "segment", segment_id)
    here = f"{base}/v1/segments/{segment_id}"
    item = f"{base}/collections/segments/items/{segment_id}"
    links = [
        link(with_query(here, gaps=gaps), "self", GEO_JSON),
        link(f"{here}/observations", "observations", title="The drives behind it"),
        link(with_query(item, gaps=gaps), "alternate", GEO_JSON),
    ]
    return geojson_response({**feature_of(row).geojson(), "links": link_documents(links)})


@router.get("/{segment_id}/observations", summary="The drives behind a segment", responses=problems(404, 503))
def segment_observations(segment_id: SegmentId, service: ServiceDep, base: BaseUrl) -> ObservationList:
    """What each drive says about the segment and how that estimate was made, latest drive first."""
    with service.reading() as session:
        found(segments.get_segment(session, segment_id), "segment", segment_id)
        rows = segments.segment_observations(session, segment_id)
    here = f"{base}/v1/segments/{segment_id}"
    return ObservationList(
        segment_id=segment_id,
        observations=[Observation.of(row) for row in rows],
        links=[link(f"{here}/observations", "self"), link(here, "up", GEO_JSON)],
    )
