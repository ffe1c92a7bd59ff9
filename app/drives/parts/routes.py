"""The parts of a drive over HTTP: track, elevation profile, estimates, what its sensors said, and its log as it came.

Knows no SQL and draws nothing.
"""

from __future__ import annotations

import uuid
from typing import Annotated, BinaryIO, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from app.core.http import (
    JSON,
    BaseUrl,
    ServiceDep,
    existing,
    file_answers,
    geojson_answer,
    geojson_response,
    link,
    not_modified,
    problems,
    with_query,
)
from app.core.http import link_documents as documents
from app.core.query import cursor_of, parse_cursor
from app.core.text import GEO_JSON, language_of
from app.drives import store as drives
from app.drives.documents import drive_address
from app.drives.outputs.drawing import Drawing
from app.drives.outputs.estimates import estimate_feature
from app.drives.outputs.measurements import MEASUREMENTS_EXAMPLE, MEASUREMENTS_SCHEMA
from app.drives.outputs.profile_document import PROFILE_EXAMPLE, PROFILE_SCHEMA
from app.drives.outputs.profile_marks import datum_words
from app.drives.outputs.track import TRACK_EXAMPLE, track_chunks
from app.drives.outputs.track_files import track_csv, track_gpx
from app.drives.parts.pictures import kept_picture, picture_of_its_own, picture_to_keep
from app.drives.parts.reading import (
    CSV,
    ESTIMATES,
    ESTIMATES_CONTENT,
    OVERRIDES,
    PROFILE_CSV,
    VARY,
    EstimatesQuery,
    PointsQuery,
    as_file,
    attachment,
    drive_and_track,
    estimates_answer,
    form_of,
    in_blocks,
    log_name,
    measurements_answer,
    opened_log,
    profile_answer,
    run_of_drive,
    stem_of,
    text_content,
)
from app.drives.parts.without_ends import EndsQuery, shown_estimates
from app.exports.ranges import file_answer
from app.map.segment import attribution
from app.map.segments import MAX_ID, CursorQuery
from app.map.store import drive_segment_rows

PNG = "image/png"
GPX = "application/gpx+xml"
BYTES = "application/octet-stream"
BLOCK_BYTES = 2**20
"""Fetched of a bucket at once."""
TRACKS = {"geojson": GEO_JSON, "csv": CSV, "gpx": GPX}
PROFILES = {"json": JSON, "png": PNG, "csv": CSV}

TRACK_CSV_EXAMPLE = (
    "time_s,lat_deg,lon_deg,alt_msl_m,h_acc_m,v_acc_m,speed_mps,heading_deg,pitch_deg,pitch_acc_deg\r\n"
    "1795161310.0,48.9912,8.4812,143.21,1.4,0.9,11.2,41.5,3.9,0.3\r\n"
)
_GPX_EXAMPLE = (
    '<gpx version="1.1" creator="Versant" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    '<trkpt lat="48.9912000" lon="8.4812000"><ele>143.21</ele><time>2026-11-20T07:55:10.000Z</time></trkpt>'
    "</trkseg></trk></gpx>"
)


router = APIRouter(prefix="/v1/drives", tags=["drives"])


@router.get(
    "/{drive_id}/track",
    summary="A drive's track",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "The path, then a point per epoch.",
            "content": {
                **geojson_answer("", TRACK_EXAMPLE)["content"],
                CSV: text_content(TRACK_CSV_EXAMPLE),
                GPX: text_content(_GPX_EXAMPLE),
            },
        },
        **problems(404, 406, 422, 503),
    },
)
def drive_track(
    drive_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    f: Annotated[Literal["geojson", "csv", "gpx"] | None, Query(description=OVERRIDES)] = None,
    ends: EndsQuery = None,
) -> StreamingResponse:
    """Where the vehicle was, with sigmas. The first feature is the path, interrupted where the recording was.

    Heights are those of the road's surface. Unknown is null. CSV has the columns of a log and can be uploaded again;
    GPX 1.1 has a track segment for each uninterrupted stretch. `ends=hidden` leaves out where the trip began, ended and
    stopped, for whom the file is handed on to.
    """
    form = form_of(f, request.headers.get("accept"), TRACKS)
    with service.reading() as session:
        drive, track = drive_and_track(session, drive_id, ends)
    report, stem = drive.report or {}, stem_of(drive.filename)
    if form == "csv":
        chunks, headers = track_csv(track, report.get("height_datum")), as_file(f"{stem}-track.csv")
    elif form == "gpx":
        chunks = track_gpx(track, drive.filename, datum_words(report))
        headers = as_file(f"{stem}-track.gpx")
    else:
        here = with_query(f"{drive_address(base, drive)}/track", ends=ends)
        links = documents([link(here, "self", GEO_JSON)])
        chunks, headers = track_chunks(track, track.segment, {"links": links}), VARY
    return StreamingResponse(in_blocks(chunks), media_type=TRACKS[form], headers=headers)


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
                CSV: PROFILE_CSV,
            },
        },
        **problems(404, 406, 422, 503),
    },
)
async def get_profile(
    drive_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    f: Annotated[Literal["json", "png", "csv"] | None, Query(description=OVERRIDES)] = None,
    points: PointsQuery = None,
    ends: EndsQuery = None,
) -> Response:
    """Height, grade and segment slopes over the distance driven; slopes here are in the direction of travel.

    JSON, or a PNG where the Accept header prefers `image/png` or `f=png` asks for it, or a CSV of the same columns.
    Pictures are drawn one at a time and kept; where many wait the answer is 503. `points` makes columns short enough to
    be drawn at once; a picture shows all. With `ends=hidden`, and in another language
    than English (Accept-Language), a picture is drawn anew each time.
    """
    form = form_of(f, request.headers.get("accept"), PROFILES)
    if form != "png":
        return await profile_answer(service, run_of_drive(drive_id, ends), form, points)
    language = language_of(request.headers.get("accept-language", ""))
    kept = ends is None and language == "en"
    picture = await run_in_threadpool(kept_picture, service, drive_id) if kept else None
    if picture is None:
        drawing: Drawing = request.app.state.drawing
        async with drawing.request_class.place():
            if kept:
                picture = await run_in_threadpool(picture_to_keep, service, drawing, drive_id)
            else:
                own = picture_of_its_own
                picture = await run_in_threadpool(own, service, drawing, drive_id, ends, language)
    return Response(picture, media_type=PNG, headers={"Vary": "Accept, Accept-Language"})


@router.get(
    "/{drive_id}/segments",
    summary="A drive's estimates",
    response_class=Response,
    responses={
        200: {
            "description": "One page, or all, in the order of driving.",
            "content": ESTIMATES_CONTENT,
        },
        **problems(404, 406, 422, 503),
    },
)
def drive_segments(
    drive_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    limit: Annotated[
        int | None,
        Query(ge=1, description="Segments per page; at most, and by default, the service's maximum."),
    ] = None,
    after: CursorQuery = None,
    f: Annotated[
        EstimatesQuery,
        Query(
            description="Overrides the Accept header, and asks for all segments at once unless `limit` is set."
        ),
    ] = None,
    ends: EndsQuery = None,
) -> Response:
    """Slope and sigma of each segment **from this drive alone**, in the order of driving.

    Besides the usual properties: `passes`, `first_at`, `last_at`, `in_network` and `accepted` (as among a
    segment's observations), and what all drives together say:
    `combined_slope_percent`, `combined_slope_sigma_percent`, `combined_drives`. Empty before the first run.
    Follow the `next` link until there is none; each segment comes once. `f`, and CSV in any case, give all that come
    after `after` in one answer, unless `limit` is set. `ends=hidden` leaves out a segment with any
    pass that it leaves out.
    """
    form = form_of(f, request.headers.get("accept"), ESTIMATES)
    place = None if after is None else parse_cursor(after, MAX_ID)
    size = min(limit or service.settings.items_limit_max, service.settings.items_limit_max)
    at_once = limit is None and (f is not None or form == "csv")
    with service.reading() as session:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
        most = None if at_once or ends else size + 1
        rows = drive_segment_rows(session, drive_id, limit=most, after=place)
        rows = shown_estimates(session, drive, rows, ends)
    shown = rows if at_once else rows[:size]
    here = f"{drive_address(base, drive)}/segments"
    links = [link(with_query(here, limit=limit, after=after, f=f, ends=ends), "self", GEO_JSON)]
    if len(rows) > len(shown):
        following = cursor_of(shown[-1].first_at, shown[-1].segment.stored_id)
        links.append(link(with_query(here, limit=limit, after=following, f=f, ends=ends), "next", GEO_JSON))
    members = {"attribution": attribution(), "numberReturned": len(shown), "links": documents(links)}
    if at_once or form == "csv":
        return estimates_answer(form, shown, members, stem_of(drive.filename))
    document = {"type": "FeatureCollection"} | members | {"features": map(estimate_feature, shown)}
    return geojson_response(document, VARY)


@router.get(
    "/{drive_id}/measurements",
    summary="What a drive's sensors said",
    response_class=Response,
    responses={
        200: {
            "description": "Columns over the distance driven, of each sensor.",
            "content": {JSON: {"schema": MEASUREMENTS_SCHEMA, "example": MEASUREMENTS_EXAMPLE}},
        },
        **problems(404, 422, 503),
    },
)
async def drive_measurements(
    drive_id: uuid.UUID, service: ServiceDep, points: PointsQuery = None, ends: EndsQuery = None
) -> Response:
    """What stands behind the profile: heights and grades as each sensor has them, placed on the profile's axis.

    `points` is of each sensor. Methods that tell of no measurements have none.
    """
    return await measurements_answer(service, run_of_drive(drive_id, ends), points)


@router.get(
    "/{drive_id}/log",
    summary="A drive's log as it was uploaded",
    response_class=Response,
    responses={
        **file_answers("(the bytes)"),
        **problems(404, 410, 416, 503),
    },
)
def drive_log(drive_id: uuid.UUID, request: Request, service: ServiceDep) -> Response:
    """The bytes as they came, under their name; of several files the zip that they are kept as.

    Resumable: `Range` with `If-Range`. The ETag is the SHA-256 of the file. 410 where the owner keeps logs no longer.
    """
    with service.reading() as session:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
    drive.require_log()
    etag, size = f'"{drive.sha256}"', drive.size_bytes
    shared = {"ETag": etag, "Accept-Ranges": "bytes", "Cache-Control": "no-cache"}
    if unchanged := not_modified(request, shared):
        return unchanged

    def opened() -> tuple[BinaryIO, dict[str, str]]:
        file = opened_log(service, drive, BLOCK_BYTES)
        return file, shared | {
            "Content-Disposition": attachment(log_name(drive.filename, file)),
            "X-Content-Type-Options": "nosniff",
            "Content-Security-Policy": "sandbox",
        }

    return file_answer(request, etag, size, BYTES, opened)
