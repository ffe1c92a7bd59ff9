"""What a drive yielded, over HTTP: its track, its elevation profile, its estimates. Knows no SQL and draws nothing."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from app.core.errors import NotAcceptableError, NotFoundError
from app.core.http import (
    JSON,
    BaseUrl,
    Service,
    ServiceDep,
    found,
    geojson_answer,
    geojson_response,
    link,
    preferred,
    problems,
    with_query,
)
from app.core.http import link_documents as documents
from app.core.lanes import PARTS
from app.core.query import cursor_of, parse_cursor
from app.core.text import GEO_JSON, SLOPE_DIGITS, columns_text, rounded, utc_text
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive, drive_address
from app.drives.outputs.drawing import Drawing
from app.drives.outputs.profile import (
    PROFILE_EXAMPLE,
    PROFILE_SCHEMA,
    Profile,
    RoadFacts,
    build_profile,
    profile_json,
)
from app.drives.outputs.profile_marks import datum_words
from app.drives.outputs.track import TRACK_EXAMPLE, track_chunks
from app.drives.tracks import StoredTrack
from app.map.attribution import attribution
from app.map.segments import MAX_ID, SEGMENT_EXAMPLE, CursorQuery
from app.map.store import DriveSegmentRow, drive_segment_rows
from fusion.network.combine import NETWORK_ONLY

PNG = "image/png"

router = APIRouter(prefix="/v1/drives", tags=["drives"])

log = logging.getLogger(__name__)


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
async def drive_profile(
    drive_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    f: Annotated[Literal["json", "png"] | None, Query(description="Overrides the Accept header.")] = None,
) -> Response:
    """Height, grade and segment slopes over the distance driven; slopes here are in the direction of travel.

    JSON, or a PNG where the Accept header prefers `image/png` or `f=png` asks for it. Pictures are drawn one at a
    time and kept; where many wait the answer is 503.
    """
    wanted = {"json": JSON, "png": PNG}[f] if f else preferred(request.headers.get("accept"), (JSON, PNG))
    if wanted is None:
        raise NotAcceptableError(
            "A profile is application/json or image/png; Accept allows neither.", field="Accept"
        )
    vary = {"Vary": "Accept"}
    if wanted == JSON:
        async with service.lanes[PARTS].place():
            text = await run_in_threadpool(_profile_text, service, drive_id)
        return Response(text, media_type=JSON, headers=vary)
    picture = await run_in_threadpool(_kept_picture, service, drive_id)
    if picture is None:
        drawing: Drawing = request.app.state.drawing
        async with drawing.lane.place():
            picture = await run_in_threadpool(_picture, service, drawing, drive_id)
    return Response(picture, media_type=PNG, headers=vary)


@router.get(
    "/{drive_id}/segments",
    summary="A drive's estimates",
    response_class=Response,
    responses={
        200: geojson_answer("One page in the order of driving.", SEGMENT_EXAMPLE),
        **problems(404, 422, 503),
    },
)
def drive_segments(
    drive_id: uuid.UUID,
    service: ServiceDep,
    base: BaseUrl,
    limit: Annotated[
        int | None,
        Query(ge=1, description="Segments per page; at most, and by default, the service's maximum."),
    ] = None,
    after: CursorQuery = None,
) -> Response:
    """Slope and sigma of each segment **from this drive alone**, in the order of driving.

    Besides the usual properties: `passes`, `first_at`, `last_at`, `in_network` and `accepted` (as among a
    segment's observations), and what all drives together say:
    `combined_slope_percent`, `combined_slope_sigma_percent`, `combined_drives`. Empty before the first run.
    Follow the `next` link until there is none; each segment comes once.
    """
    place = None if after is None else parse_cursor(after, MAX_ID)
    size = min(limit or service.settings.items_limit_max, service.settings.items_limit_max)
    with service.reading() as session:
        drive = found(drives.get_drive(session, drive_id), "drive", drive_id)
        rows = drive_segment_rows(session, drive_id, limit=size + 1, after=place)
    shown = rows[:size]
    here = f"{drive_address(base, drive)}/segments"
    links = [link(with_query(here, limit=limit, after=after), "self", GEO_JSON)]
    if len(rows) > size:
        following = cursor_of(shown[-1].first_at, shown[-1].segment.stored_id)
        links.append(link(with_query(here, limit=limit, after=following), "next", GEO_JSON))
    document = {
        "type": "FeatureCollection",
        "attribution": attribution(),
        "numberReturned": len(shown),
        "links": documents(links),
        "features": map(_estimate_feature, shown),
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


def _profile_text(service: Service, drive_id: uuid.UUID) -> bytes:
    with service.reading() as session:
        drive, stored = _drive_and_track(session, drive_id)
        estimates = drive_segment_rows(session, drive_id)
    return columns_text({"drive_id": str(drive.id), **profile_json(_profile(stored, estimates))})


def _kept_picture(service: Service, drive_id: uuid.UUID) -> bytes | None:
    """The picture of the drive as it is now, where it was drawn already."""
    with service.reading() as session:
        drive = found(drives.get_drive(session, drive_id), "drive", drive_id)
        return tracks.read_picture(session, drive)


def _picture(service: Service, drawing: Drawing, drive_id: uuid.UUID) -> bytes:
    # Whoever waited for the same picture finds it.
    if kept := _kept_picture(service, drive_id):
        return kept
    with service.reading() as session:
        drive, stored = _drive_and_track(session, drive_id)
        estimates = drive_segment_rows(session, drive_id)
        measurements = tracks.read_measurements(session, drive_id)
    datum = datum_words(drive.report or {})
    picture = drawing.profile(_profile(stored, estimates), drive.filename, measurements, datum)
    try:
        with service.sessions.begin() as session:
            tracks.keep_picture(session, drive, picture, service.settings.pictures_kept)
    except SQLAlchemyError as error:  # it is a picture nevertheless
        log.warning("the picture of drive %s is not kept: %s", drive_id, error)
    return picture


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
