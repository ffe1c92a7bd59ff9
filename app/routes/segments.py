"""One segment, and the drives behind it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Response

from app.outputs.features import GEO_JSON
from app.routes.deps import (
    BaseUrl,
    ServiceDep,
    feature_of,
    found,
    geojson_response,
    link,
    link_documents,
    problems,
)
from app.routes.examples import FEATURE_EXAMPLE, geojson_answer
from app.schemas import Observation, ObservationList
from app.store import segments

MAX_ID = 2**63 - 1

SegmentId = Annotated[int, Path(ge=1, le=MAX_ID, description="The segment's number.", examples=[17])]

router = APIRouter(prefix="/v1/segments", tags=["segments"])


@router.get(
    "/{segment_id}",
    summary="One segment",
    response_class=Response,
    responses={200: geojson_answer("The segment.", FEATURE_EXAMPLE), **problems(404, 503)},
)
def get_segment(segment_id: SegmentId, service: ServiceDep, base: BaseUrl) -> Response:
    """The segment with the slope that all its drives together give."""
    with service.reading() as session:
        row = found(segments.get_segment(session, segment_id), "segment", segment_id)
    here = f"{base}/v1/segments/{segment_id}"
    links = [
        link(here, "self", GEO_JSON),
        link(f"{here}/observations", "observations", title="The drives behind it"),
        link(f"{base}/collections/segments/items/{segment_id}", "alternate", GEO_JSON),
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
