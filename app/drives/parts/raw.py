"""The sources of a drive over HTTP: its log as it was uploaded, and its sensors' measurements along it."""

from __future__ import annotations

import uuid
from typing import Any, BinaryIO

from fastapi import APIRouter, Request, Response

from app.core.errors import NotFoundError
from app.core.http import JSON, Service, ServiceDep, existing, not_modified, problems
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.outputs.measurements import MEASUREMENTS_EXAMPLE, MEASUREMENTS_SCHEMA
from app.drives.parts.reading import PointsQuery, attachment, measurements_answer, run_of_drive
from app.exports.ranges import file_answer

BYTES = "application/octet-stream"
BLOCK_BYTES = 2**20
"""Fetched of a bucket at once."""
ZIP = b"PK\x03\x04"

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_FILE: dict[str, Any] = {
    "content": {BYTES: {"schema": {"type": "string", "format": "binary"}, "example": "(the bytes)"}}
}


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
    drive_id: uuid.UUID, service: ServiceDep, points: PointsQuery = None
) -> Response:
    """What stands behind the profile: heights and grades as each sensor has them, placed on the profile's axis.

    `points` is of each sensor. Methods that tell of no measurements have none.
    """
    return await measurements_answer(service, run_of_drive(drive_id), points)


@router.get(
    "/{drive_id}/log",
    summary="A drive's log as it was uploaded",
    response_class=Response,
    responses={
        200: {"description": "The file.", **_FILE},
        206: {"description": "The part of it that `Range` asks for.", **_FILE},
        304: {"description": "Unchanged since the ETag."},
        **problems(404, 416, 503),
    },
)
def drive_log(drive_id: uuid.UUID, request: Request, service: ServiceDep) -> Response:
    """The bytes as they came, under their name; of several files the zip that they are kept as.

    Resumable: `Range` with `If-Range`. The ETag is the SHA-256 of the file.
    """
    with service.reading() as session:
        drive: Drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
    etag, size = f'"{drive.sha256}"', drive.size_bytes
    shared = {"ETag": etag, "Accept-Ranges": "bytes", "Cache-Control": "no-cache"}
    if unchanged := not_modified(request, shared):
        return unchanged

    def opened() -> tuple[BinaryIO, dict[str, str]]:
        file = _opened(service, drive)
        return file, shared | {
            "Content-Disposition": attachment(_name(drive, file)),
            "X-Content-Type-Options": "nosniff",
            "Content-Security-Policy": "sandbox",
        }

    return file_answer(request, etag, size, BYTES, opened)


def _opened(service: Service, drive: Drive) -> BinaryIO:
    try:
        return service.blobs.open(drive.blob_key, BLOCK_BYTES)
    except FileNotFoundError:
        raise NotFoundError(
            f"The uploaded file of drive {drive.id} is no longer in the service's storage. What was computed of it "
            "stays; upload the same file again, and the drive has it again."
        ) from None


def _name(drive: Drive, file: BinaryIO) -> str:
    """The name to keep the file under: several files are kept as one zip."""
    if ", " not in drive.filename or drive.filename.lower().endswith(".zip"):
        return drive.filename
    head = file.read(len(ZIP))
    file.seek(0)
    return f"{drive.filename}.zip" if head == ZIP else drive.filename
