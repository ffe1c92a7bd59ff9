"""Uploading a log."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from app import ingest
from app.routes.deps import BaseUrl, ServiceDep, problems
from app.routes.drive_links import accepted, drive_address
from app.routes.options import MethodQuery, OptionQuery, OptionsQuery, asked_options, checked, default_method
from app.schemas import DriveAccepted
from app.uploads import receive_upload

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_BINARY = {"type": "string", "format": "binary"}
_BODY: dict[str, Any] = {
    "required": True,
    "description": "The log, plain or gzipped, as a form field or as the body itself.",
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["file"],
                "properties": {"file": {**_BINARY, "description": "The log."}},
            },
            "example": {"file": "monday.ubx"},
        },
        "application/octet-stream": {"schema": _BINARY, "example": "(the bytes of monday.ubx)"},
    },
}
_LOCATION = {"Location": {"description": "The drive.", "schema": {"type": "string", "format": "uri"}}}


@router.post(
    "",
    status_code=202,
    summary="Upload a log",
    response_model=DriveAccepted,
    responses={
        200: {
            "model": DriveAccepted,
            "description": "Known bytes: their drive.",
            "headers": _LOCATION,
        },
        202: {"description": "Stored and queued.", "headers": _LOCATION},
        **problems(403, 413, 415, 422, 503),
    },
    openapi_extra={"requestBody": _BODY},
)
async def upload_drive(
    request: Request,
    response: Response,
    service: ServiceDep,
    base: BaseUrl,
    method: MethodQuery = None,
    options: OptionsQuery = None,
    option: OptionQuery = [],  # noqa: B006 -- FastAPI copies the default
    filename: str | None = Query(
        None,
        description="Name of the file where the body is the log itself; also `X-Filename`.",
        examples=["monday.ubx"],
    ),
) -> DriveAccepted:
    """Store a log and queue it. The answer comes as soon as it is stored; follow the drive at `Location`.

    The same bytes again answer 200 with the drive that they already are, unchanged, whatever the method:
    use `reprocess` to compute it anew.
    """
    settings = service.settings
    wanted = method or default_method(settings)
    chosen = checked(wanted, asked_options(options, option) or {})
    blob, name = await receive_upload(request, service.blobs, settings.max_upload_bytes)
    row, created = await run_in_threadpool(
        ingest.register_upload,
        service.sessions,
        service.blobs,
        blob,
        filename=name,
        method=wanted,
        options=chosen,
    )
    response.status_code = 202 if created else 200
    response.headers["Location"] = drive_address(base, row)
    return accepted(base, row)
