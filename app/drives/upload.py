"""The way of an upload: its body piece by piece into one blob (``receiving``), then row and job (``intake``).

Nothing is held in memory but the piece on its way, nothing on disk but the blob. Knows neither formats of bodies nor
SQL.
"""

from __future__ import annotations

from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Query, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from app.core.blobs import BlobStore, StoredBlob
from app.core.errors import BodyTooLargeError
from app.core.http import BaseUrl, ServiceDep, problems
from app.core.receiving.body import Piece, UploadSource, upload_source
from app.core.settings import Settings
from app.drives import intake
from app.drives.documents import DriveAccepted, accepted, drive_address
from app.drives.method_choice import (
    MethodRequest,
    asked_columns,
    asked_positioning,
    check_options,
    default_method,
    with_positioning,
)
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.upload_bundle import UploadBundle
from app.drives.receiving.zips import MAX_FILES

CHUNK_BYTES = 1024 * 1024
"""How much is handed to the blob store at a time: few hops between threads, little memory."""
CHUNK_PIECES = 1024
"""As many pieces at most, of a body that comes in crumbs."""

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_BINARY = {"type": "string", "format": "binary"}
_BODY: dict[str, Any] = {
    "required": True,
    "description": "The log, plain or gzipped, as a form field or as the body itself; or files that belong together, "
    "such as observations and navigation data, as several fields or as one zip.",
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["file"],
                "properties": {
                    "file": {
                        "type": "array",
                        "minItems": 1,
                        "maxItems": MAX_FILES,
                        "items": _BINARY,
                        "description": "The log, or each of the files that belong together.",
                    }
                },
            },
            "example": {"file": ["monday.ubx"]},
        },
        "application/octet-stream": {"schema": _BINARY, "example": "(the bytes of monday.ubx)"},
    },
}
_LOCATION = {"Location": {"description": "The drive.", "schema": {"type": "string", "format": "uri"}}}


class UploadRequest(MethodRequest):
    """How a log is to be computed and read, as query parameters."""

    columns: list[str] = Field(
        [],
        description="One column of a CSV that is called otherwise, as `versant_name=name in the header`; may be "
        "repeated. Short for the option `columns` of every method.",
        examples=[["alt_msl_m=Altitude"]],
    )
    filename: str | None = Field(
        None,
        description="Name of the file where the body is the log itself; also `X-Filename`.",
        examples=["monday.ubx"],
    )


@router.post(
    "",
    status_code=202,
    summary="Upload a log",
    response_model=DriveAccepted,
    responses={
        200: {
            "model": DriveAccepted,
            "description": "Known content: its drive.",
            "headers": _LOCATION,
        },
        202: {"description": "Stored and queued.", "headers": _LOCATION},
        **problems(403, 413, 415, 422, 503, 507),
    },
    openapi_extra={"requestBody": _BODY},
)
async def upload_drive(
    request: Request,
    response: Response,
    service: ServiceDep,
    base: BaseUrl,
    query: Annotated[UploadRequest, Query()],
) -> DriveAccepted:
    """Store a log and queue it. The answer comes as soon as it is stored; follow the drive at `Location`.

    Several files are one drive, and are kept as one zip. The same content again, in whatever gzip, zip or order,
    answers 200 with the drive that it already is, unchanged, whatever the method: use `reprocess` to compute it anew.
    Where the service had lost that drive's file, this one takes its place. What is no log is refused, as far as its
    first bytes tell: 415 if they are of no known kind, 422 if a header lacks what a log must have.
    """
    settings = service.settings
    estimator = query.method or default_method(settings)
    positioning = asked_positioning(query.gnss, query.gnss_option)
    wanted_options = with_positioning(query.asked_options() or {}, positioning)
    wanted_options |= asked_columns(query.columns)
    check_options(estimator, wanted_options)
    look = FirstLook(wanted_options.get("columns"))
    blob, name = await receive_upload(request, service.blobs, settings, look)
    drive, created = await run_in_threadpool(
        intake.register_upload,
        service.sessions,
        service.blobs,
        blob,
        filename=name,
        method=estimator,
        options=wanted_options,
    )
    response.status_code = 202 if created else 200
    response.headers["Location"] = drive_address(base, drive)
    return accepted(base, drive)


async def receive_upload(
    request: Request, blobs: BlobStore, settings: Settings, look: FirstLook
) -> tuple[StoredBlob, str]:
    """Store the files of the request's body as one blob; returns the blob and its name.

    Raises ``BodyTooLargeError`` as soon as the body is announced or found to be too large, ``StorageFullError`` as soon
    as there is no room for it, ``BadRequestError`` for an empty file or a malformed body, ``LogError`` where no file is
    a log, what ``UploadBundle`` raises else, and ``ClientDisconnect`` when the client goes away. Nothing stays in the
    store then. The store's blocking calls run in threads.
    """
    max_bytes = settings.max_upload_bytes
    source = upload_source(request.headers, request.query_params)
    announced = _announced_bytes(request)
    if announced > max_bytes + source.envelope_bytes:
        raise _too_large(max_bytes)
    bundle = await run_in_threadpool(
        UploadBundle,
        blobs,
        keep_free_bytes=settings.min_free_bytes,
        expected_bytes=announced,
        max_content_bytes=settings.max_log_bytes,
        look=look,
    )
    try:
        await _copy(request, source, bundle, max_bytes)
        return await run_in_threadpool(bundle.finish)
    except BaseException:
        with anyio.CancelScope(shield=True):  # also when this request is cancelled
            await run_in_threadpool(bundle.discard)
        raise


async def _copy(request: Request, source: UploadSource, bundle: UploadBundle, max_bytes: int) -> None:
    waiting: list[Piece] = []
    received = held = 0
    async for chunk in request.stream():
        pieces = source.feed(chunk)
        size = sum(len(piece.data) for piece in pieces)
        received, held = received + size, held + size
        if received > max_bytes:
            raise _too_large(max_bytes)
        waiting += pieces
        if held >= CHUNK_BYTES or len(waiting) >= CHUNK_PIECES:
            await run_in_threadpool(bundle.take, waiting)
            waiting, held = [], 0
    source.finish()
    await run_in_threadpool(bundle.take, waiting)


def _announced_bytes(request: Request) -> int:
    """Length of the body by its header; 0 where it is not said."""
    announced = request.headers.get("content-length", "")
    return int(announced) if announced.isdigit() else 0


def _too_large(max_bytes: int) -> BodyTooLargeError:
    return BodyTooLargeError(
        f"The upload is larger than {max_bytes} bytes, the most that this service takes. "
        "Compress it with gzip or split it into several drives.",
        field="file",
    )
