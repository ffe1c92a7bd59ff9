"""What a drive yielded, over HTTP: its track, its elevation profile, its estimates. Knows no SQL and draws nothing."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import replace
from threading import Lock
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from sqlalchemy.orm import Session

from app.core.errors import NotAcceptableError, NotFoundError
from app.core.http import (
    JSON,
    BaseUrl,
    ServiceDep,
    found,
    geojson_answer,
    geojson_response,
    link,
    preferred,
    problems,
)
from app.core.http import link_documents as documents
from app.core.text import GEO_JSON, SLOPE_DIGITS, rounded, utc_text
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive, drive_address
from app.drives.outputs.profile import (
    PROFILE_EXAMPLE,
    PROFILE_SCHEMA,
    Profile,
    RoadFacts,
    build_profile,
    profile_json,
)
from app.drives.outputs.track import TRACK_EXAMPLE, track_chunks
from app.drives.tracks import StoredTrack
from app.map.attribution import attribution
from app.map.segments import SEGMENT_EXAMPLE
from app.map.store import DriveSegmentRow, drive_segment_rows
from fusion.network.combine import NETWORK_ONLY
from fusion.types import DrawnMeasurements

PNG = "image/png"

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_drawing = Lock()  # matplotlib's font cache is shared by all figures


@router.get(
    "/{drive_id}/track",
    summary="A drive's track",
    response_class=StreamingResponse,
    responses={200: geojson_answer("The path, then a point per epoch.", TRACK_EXAMPLE), **problems(404, 503)},
)
def drive_track(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> StreamingResponse:
    """Where the vehicle was, with sigmas. The first feature is the path, interrupted where the recording was.

    Heights are those of the road's surface. Unknown is null.
    """
    with service.reading() as session:
        drive, stored = _drive_and_track(session, drive_id)
    links = documents([link(f"{drive_address(base, drive)}/track", "self", GEO_JSON)])
    chunks = track_chunks(stored.track, stored.segment_id, {"links": links})
    return StreamingResponse(_in_blocks(chunks), media_type=GEO_JSON)


@router.get(
    "/{drive_id}/profile",
    summary="A drive's elevation profile",
    response_class=Response,
    responses={
        200: {
            "description": "Columns over the distance driven, or a picture.",
            "content": {
                JSON: {"schema": PROFILE_SCHEMA, "example": PROFILE_EXAMPLE},
                PNG: {"schema": {"type": "string", "format": "binary"}},
            },
        },
        **problems(404, 406, 422, 503),
    },
)
def drive_profile(
    drive_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    f: Annotated[Literal["json", "png"] | None, Query(description="Overrides the Accept header.")] = None,
) -> Response:
    """Height, grade and segment slopes over the distance driven; slopes here are in the direction of travel.

    JSON, or a PNG where the Accept header prefers `image/png` or `f=png` asks for it.
    """
    wanted = {"json": JSON, "png": PNG}[f] if f else preferred(request.headers.get("accept"), (JSON, PNG))
    if wanted is None:
        raise NotAcceptableError(
            "A profile is application/json or image/png; Accept allows neither.", field="Accept"
        )
    with service.reading() as session:
        drive, stored = _drive_and_track(session, drive_id)
        estimates = drive_segment_rows(session, drive_id)
        measurements = tracks.read_measurements(session, drive_id) if wanted == PNG else None
    profile = _profile(stored, estimates)
    vary = {"Vary": "Accept"}
    if wanted == JSON:
        return JSONResponse({"drive_id": str(drive.id), **profile_json(profile)}, headers=vary)
    return Response(_picture(profile, drive.filename, measurements), media_type=PNG, headers=vary)


@router.get(
    "/{drive_id}/segments",
    summary="A drive's estimates",
    response_class=Response,
    responses={
        200: geojson_answer("In the order of driving.", SEGMENT_EXAMPLE),
        **problems(404, 503),
    },
)
def drive_segments(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> Response:
    """Slope and sigma of each segment **from this drive alone**, in the order of driving.

    Besides the usual properties: `passes`, `first_at`, `last_at`, `in_network` and `accepted` (as among a
    segment's observations), and what all drives together say:
    `combined_slope_percent`, `combined_slope_sigma_percent`, `combined_drives`. Empty before the first run.
    """
    with service.reading() as session:
        drive = found(drives.get_drive(session, drive_id), "drive", drive_id)
        estimates = drive_segment_rows(session, drive_id)
    links = documents([link(f"{drive_address(base, drive)}/segments", "self", GEO_JSON)])
    features = [_estimate_feature(estimate) for estimate in estimates]
    document = {
        "type": "FeatureCollection",
        "attribution": attribution(),
        "numberReturned": len(features),
        "links": links,
        "features": features,
    }
    return geojson_response(document)


def _drive_and_track(session: Session, drive_id: uuid.UUID) -> tuple[Drive, StoredTrack]:
    drive: Drive = found(drives.get_drive(session, drive_id), "drive", drive_id)
    stored = tracks.read_track(session, drive_id)
    if stored is None:
        reason = f" It failed: {drive.failure.reason}" if drive.failure else " Look again when it is done."
        raise NotFoundError(f"The drive {drive_id} is {drive.status} and has no track.{reason}")
    return drive, stored


def _profile(stored: StoredTrack, estimates: list[DriveSegmentRow]) -> Profile:
    slopes = {e.segment.stored_id: (e.slope_percent, e.slope_sigma_percent) for e in estimates}
    roads = {
        e.segment.stored_id: RoadFacts.between(
            *e.segment.coordinates, bridge=e.segment.bridge, tunnel=e.segment.tunnel
        )
        for e in estimates
    }
    return build_profile(stored.track, stored.segment_id, slopes, roads)


def _picture(profile: Profile, title: str, measurements: DrawnMeasurements | None) -> bytes:
    # Loading matplotlib takes half a second: a service that draws no picture starts without it.
    from app.drives.outputs.profile_picture import profile_png  # noqa: PLC0415

    with _drawing:
        return profile_png(profile, title, measurements)


def _estimate_feature(estimate: DriveSegmentRow) -> dict[str, Any]:
    combined = estimate.segment
    own = replace(
        combined,
        slope_percent=estimate.slope_percent,
        slope_sigma_percent=estimate.slope_sigma_percent,
        drives=1,
        observations=estimate.observations,
    ).geojson()
    own["properties"] |= {
        **dict.fromkeys(NETWORK_ONLY),
        "passes": estimate.passes,
        "first_at": utc_text(estimate.first_at),
        "last_at": utc_text(estimate.last_at),
        "in_network": estimate.in_network,
        "accepted": estimate.accepted,
        "combined_slope_percent": rounded(combined.slope_percent, SLOPE_DIGITS),
        "combined_slope_sigma_percent": rounded(combined.slope_sigma_percent, SLOPE_DIGITS),
        "combined_drives": combined.drives,
    }
    return own


def _in_blocks(chunks: Iterator[str], size: int = 256 * 1024) -> Iterator[str]:
    """The same text in larger pieces: each piece costs a hop between threads."""
    waiting: list[str] = []
    length = 0
    for chunk in chunks:
        waiting.append(chunk)
        length += len(chunk)
        if length >= size:
            yield "".join(waiting)
            waiting, length = [], 0
    yield "".join(waiting)
