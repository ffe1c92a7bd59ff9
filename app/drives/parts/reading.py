"""What the routes of a drive's parts and of its trials' share: track and profile out of the database, and answers."""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Any, BinaryIO, Literal, NamedTuple
from urllib.parse import quote

import numpy as np
from fastapi import Query, Response
from fastapi.responses import StreamingResponse
from sqlalchemy import text
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from app.core.admission import PARTS
from app.core.db import fetch_binary
from app.core.errors import NotAcceptableError, NotFoundError
from app.core.http import JSON, Service, existing, geojson_answer
from app.core.messages import say
from app.core.text import GEO_JSON, collection_chunks, columns_text, dumps, preferred
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive
from app.drives.outputs.estimates import estimate_feature, estimates_csv
from app.drives.outputs.measurements import measurements_json
from app.drives.outputs.profile import Profile, RoadFacts, build_profile
from app.drives.outputs.profile_document import fewer, profile_csv, profile_json
from app.drives.outputs.ride import ride_json
from app.drives.outputs.thinning import LEAST, MOST
from app.drives.parts.without_ends import Ends, shown_measurements, shown_track
from app.map.segments import SEGMENT_EXAMPLE
from app.map.store import DriveSegmentRow
from fusion.types import DrawnMeasurements, Track

CSV = "text/csv"
ESTIMATES = {"geojson": GEO_JSON, "csv": CSV}
VARY = {"Vary": "Accept"}
OVERRIDES = "Overrides the Accept header."
EstimatesQuery = Literal["geojson", "csv"] | None
BLOCK_BYTES = 256 * 1024
LONGEST_NAME = 200
ZIP = b"PK\x03\x04"
"""Begins one."""
_NOT_PLAIN = re.compile(r'[^ -~]|["\\/%]')

_ROADS = """
    SELECT id, ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)),
           ST_Y(ST_EndPoint(geom)), bridge, tunnel, length_m, dem_heights_m, name
    FROM segments WHERE id = ANY(%(ids)s::bigint[])
"""
_SLOPES = text(
    "SELECT segment_id, slope_percent, slope_sigma_percent FROM drive_segments WHERE drive_id = :drive_id"
)

PointsQuery = Annotated[
    int | None,
    Query(
        ge=LEAST,
        le=MOST,
        description="At most so many points, of more: ends of gaps, and the highest and lowest of each of equal "
        "stretches, stay. Ends of gaps are never left out, however many there are. Unset: all.",
        examples=[4000],
    ),
]


def text_content(example: str) -> dict[str, Any]:
    """The OpenAPI description of a text."""
    return {"schema": {"type": "string"}, "example": example}


PROFILE_CSV = text_content("distance_m,time,alt_m,alt_sigma_m\r\n0.0,2026-11-20T07:55:10.000Z,143.21,0.9\r\n")
ESTIMATES_CONTENT = {
    **geojson_answer("", SEGMENT_EXAMPLE)["content"],
    CSV: text_content("id,osm_way_id,slope_percent,slope_sigma_percent\r\n17,23456789,6.8214,0.3127\r\n"),
}


class RunParts(NamedTuple):
    """A run of a drive that is done, its own last one or a trial of it: what its parts are made of.

    It is read while the session is open that it was found in.
    """

    ids: dict[str, str]
    """What its documents begin with."""
    stem: str
    """What the names of its files begin with."""
    profile: Callable[[], Profile]
    measurements: Callable[[], DrawnMeasurements | None]


FindRun = Callable[[Session], RunParts]
"""Finds a run; raises where there is none, or none that is done."""


def run_of_drive(drive_id: uuid.UUID, ends: Ends = None) -> FindRun:
    """Finds the last successful run of the drive."""

    def find(session: Session) -> RunParts:
        drive, track = drive_and_track(session, drive_id, ends)
        return RunParts(
            {"drive_id": str(drive.id)},
            stem_of(drive.filename),
            lambda: drive_profile(session, drive_id, track),
            lambda: shown_measurements(tracks.read_measurements(session, drive_id), track, ends),
        )

    return find


def drive_and_track(session: Session, drive_id: uuid.UUID, ends: Ends = None) -> tuple[Drive, Track]:
    """The drive and the track of its last successful run, perhaps without the ends of the trip.

    ``NotFoundError`` says why there is none.
    """
    drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
    track = tracks.read_track(session, drive_id)
    if track is None:
        reason = f" It failed: {drive.failure.reason}" if drive.failure else " Look again when it is done."
        raise NotFoundError(say("drives.no_track", id=drive_id, status=drive.status, reason=reason))
    return drive, shown_track(session, drive, track, ends)


def profile_of(session: Session, track: Track, slopes: Mapping[int, tuple[float, float]]) -> Profile:
    """The profile of a track with these slopes, and what the map knows of the roads that it is on.

    Of a road that an import dropped it knows nothing.
    """
    ids = np.unique(track.segment[track.segment >= 0])  # -1 is none
    facts = {
        number: RoadFacts((lon0, lat0), (lon1, lat1), bridge, tunnel, length_m, heights or (), name)
        for number, lon0, lat0, lon1, lat1, bridge, tunnel, length_m, heights, name in fetch_binary(
            session, _ROADS, {"ids": ids}
        )
    }
    return build_profile(track, track.segment, slopes, facts)


def drive_profile(session: Session, drive_id: uuid.UUID, track: Track) -> Profile:
    """The profile of a drive's track with its own slopes: those from the drive alone, from_node -> to_node."""
    rows = session.execute(_SLOPES, {"drive_id": drive_id})
    slopes = {row.segment_id: (row.slope_percent, row.slope_sigma_percent) for row in rows}
    return profile_of(session, track, slopes)


def form_of(f: str | None, accept: str | None, forms: Mapping[str, str]) -> str:
    """Which of ``forms``, name -> media type, is wanted: ``f`` if it is said, else what the Accept header prefers.

    A client that accepts JSON gets GeoJSON. Raises ``NotAcceptableError``.
    """
    if f is not None:
        return f
    names = {media_type: name for name, media_type in forms.items()}
    if JSON not in names and GEO_JSON in names:
        names[JSON] = names[GEO_JSON]
    media_type = preferred(accept, tuple(names))
    if media_type is None:
        raise NotAcceptableError(say("query.not_accepted", names=", ".join(forms.values())), field="Accept")
    return names[media_type]


def attachment(name: str) -> str:
    """The Content-Disposition of a file to be kept under that name, whatever characters it has (RFC 6266).

    Clients that do not know ``filename*`` (RFC 8187) get the name without characters beyond plain ASCII.
    """
    name = plain_name(name)
    header = f'attachment; filename="{_NOT_PLAIN.sub("_", name)}"'
    if _NOT_PLAIN.search(name) is None:
        return header
    return f"{header}; filename*=UTF-8''{quote(name.encode('utf-8', 'replace'), safe='')}"


def plain_name(name: str) -> str:
    """The name of a file without folders or control characters."""
    name = re.sub(r"[\x00-\x1f\x7f]", "_", name.replace("\\", "/").rsplit("/", 1)[-1]).strip(" .")
    return name[-LONGEST_NAME:] or "file"


def as_file(name: str) -> dict[str, str]:
    """Headers of an answer that depends on Accept and is a file to be kept."""
    return VARY | {"Content-Disposition": attachment(name)}


def stem_of(filename: str) -> str:
    """The name of a log without what says its format, for files that are made of it."""
    first = filename.split(", ", maxsplit=1)[0].replace("\\", "/").rsplit("/", 1)[-1]
    return first.removesuffix(".gz").rsplit(".", 1)[0] or "drive"


def log_name(filename: str, file: BinaryIO) -> str:
    """The name to keep a drive's log under: several files are kept as one zip."""
    if ", " not in filename or filename.lower().endswith(".zip"):
        return filename
    head = file.read(len(ZIP))
    file.seek(0)
    return f"{filename}.zip" if head == ZIP else filename


def in_blocks(chunks: Iterator[str]) -> Iterator[str]:
    """The same text in larger pieces: each piece costs a hop between threads."""
    waiting: list[str] = []
    length = 0
    for chunk in chunks:
        waiting.append(chunk)
        length += len(chunk)
        if length >= BLOCK_BYTES:
            yield "".join(waiting)
            waiting, length = [], 0
    yield "".join(waiting)


def profile_text(ids: Mapping[str, str], profile: Profile, points: int | None = None) -> bytes:
    """The profile of a run as JSON: what it is of, so many points of its columns, and the figures of all of it."""
    return columns_text({**ids, **profile_json(fewer(profile, points)), "ride": ride_json(profile)})


def measurements_text(
    ids: Mapping[str, str],
    profile: Profile,
    measurements: DrawnMeasurements | None,
    points: int | None = None,
) -> bytes:
    """The measurements of a run as JSON, which begins with what it is of."""
    document = measurements_json(profile, measurements, points)
    sensors = b",".join(columns_text(sensor) for sensor in document["sensors"])
    return dumps(dict(ids))[:-1].encode() + b',"sensors":[' + sensors + b"]}"


async def profile_answer(service: Service, find: FindRun, form: str, points: int | None) -> Response:
    """The profile of a run as a CSV file, or as JSON."""

    def answer() -> Response:
        with service.reading() as session:
            run = find(session)
            profile = run.profile()
        if form == "csv":
            headers = as_file(f"{run.stem}-profile.csv")
            return Response("".join(profile_csv(fewer(profile, points))), media_type=CSV, headers=headers)
        return Response(profile_text(run.ids, profile, points), media_type=JSON, headers=VARY)

    async with service.request_classes[PARTS].place():
        return await run_in_threadpool(answer)


async def measurements_answer(service: Service, find: FindRun, points: int | None) -> Response:
    """The measurements of a run as compact JSON, a part of a column at a time."""

    def answer() -> Response:
        with service.reading() as session:
            run = find(session)
            profile, measurements = run.profile(), run.measurements()
        return Response(measurements_text(run.ids, profile, measurements, points), media_type=JSON)

    async with service.request_classes[PARTS].place():
        return await run_in_threadpool(answer)


def estimates_answer(
    form: str, estimates: Sequence[DriveSegmentRow], members: dict[str, Any], stem: str
) -> StreamingResponse:
    """All estimates as a CSV file whose name begins with ``stem``, or as GeoJSON that begins with ``members``."""
    if form == "csv":
        chunks, headers = estimates_csv(estimates), as_file(f"{stem}-segments.csv")
    else:
        chunks, headers = collection_chunks(map(estimate_feature, estimates), members), VARY
    return StreamingResponse(in_blocks(chunks), media_type=ESTIMATES[form], headers=headers)


def opened_log(service: Service, drive: Drive, block_bytes: int) -> BinaryIO:
    """The file as it came, fetched in blocks of a bucket; ``NotFoundError`` where it is lost."""
    try:
        return service.blobs.open(drive.blob_key, block_bytes)
    except FileNotFoundError:
        raise NotFoundError(say("drives.file_gone", id=drive.id)) from None
