"""The way of an upload: its body piece by piece into one blob (``receiving``), then row and job (``intake``).

Nothing is held on disk but the blob. Knows neither formats of bodies nor SQL.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from app.access.quotas import Quotas
from app.core.blobs import BlobStore
from app.core.errors import BadRequestError, QuotaError
from app.core.http import QUOTA_HEADERS, BaseUrl, ServiceDep, problems, quota_used_up
from app.core.messages import say
from app.core.receiving.files import least_bytes, receive_files
from app.core.settings import Settings
from app.drives.documents import drive_address
from app.drives.method_choice import (
    MethodRequest,
    asked_columns,
    asked_positioning,
    check_options,
    default_method,
    with_positioning,
)
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.sorting import Sorted, SortedUpload
from app.drives.receiving.upload_bundle import UploadBundle
from app.drives.receiving.zips import MAX_FILES
from app.drives.uploaded import UploadAccepted, register_drives
from fusion.formats.grouping import Rule

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_BINARY = {"type": "string", "format": "binary"}
_BODY: dict[str, Any] = {
    "required": True,
    "description": "The log, plain or gzipped, as a form field or as the body itself; or several files, as several "
    "fields or as one zip: those that belong together, such as observations and navigation data, become one drive, "
    "others drives of their own (`grouping`).",
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
                        "description": "The log, or each of several files.",
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
    grouping: Rule = Field(
        Rule.AUTO,
        description="How several files become drives. `auto`: files whose times overlap, and files in which a recorder "
        "goes on, are one drive, others are drives of their own; `apart`: what is not sure to be one drive is several; "
        "`one`: all of them are one drive.",
    )
    sports: list[str] = Field(
        [],
        description="What was recorded as another sport is left out, by what the files say of it (`session` of FIT, "
        "`Sport` of TCX, `type` of GPX, Strava's list of activities): `roads` are cycling, driving and motorcycling; "
        "other sports by their names, such as `jogging`. May be repeated; without it everything is taken. What tells "
        "no sport always is.",
        examples=[["roads"]],
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
    responses={
        200: {
            "model": UploadAccepted,
            "description": "Content that the owner has already: its drives.",
            "headers": _LOCATION | QUOTA_HEADERS,
        },
        202: {"description": "Stored and queued.", "headers": _LOCATION | QUOTA_HEADERS},
        **problems(403, 413, 415, 422, 503, 507),
        **quota_used_up(
            "You may upload 100 drives a day: 100 were uploaded today, this is 1 more. The count begins anew at "
            "2026-11-28 00:00 UTC. Send it again then.",
            QUOTA_HEADERS,
        ),
    },
    openapi_extra={"requestBody": _BODY},
)
async def upload_drive(
    request: Request,
    response: Response,
    service: ServiceDep,
    base: BaseUrl,
    query: Annotated[UploadRequest, Query()],
) -> UploadAccepted:
    """Store a log and queue it. The answer comes as soon as it is stored; follow the drive at `Location`.

    Several files become as many drives as they are (`grouping`), which `drives` lists; `Location` names the first. A
    drive of several files is kept as one zip. `left_out` says of each file that came to nothing why. The drives
    belong to the owner of the key. The same content again from the same owner, in whatever gzip, zip or order,
    answers 200 with the drive that it already is, unchanged, whatever the method: use `reprocess` to compute it anew.
    A key of scope `upload` follows what it sent last. Where the service had lost that drive's file, this one takes
    its place. What is no log is refused, as far as its first bytes tell: 415 if they are of no known kind, 422 if a
    header lacks what a log must have. Where as much was uploaded today as may be in a day, 429 says when to come
    again, before the body is read where its length is said. A log that is refused, or that is a drive already, counts
    nothing; a drive that fails or is removed later counts.
    """
    settings = service.settings
    estimator, wanted_options, sports = asked_of(query, settings)
    look = FirstLook(wanted_options.get("columns"))
    quotas = Quotas(settings)

    def refused(error: QuotaError) -> None:
        request.app.state.metrics.refused(error.quota)

    try:
        await run_in_threadpool(quotas.look, service.sessions, least_bytes(request))
    except QuotaError as error:
        refused(error)
        raise
    files = await receive_upload(request, service.blobs, settings, look, query.grouping, sports)
    uploaded = await run_in_threadpool(
        register_drives,
        service.sessions,
        service.blobs,
        files,
        method=estimator,
        options=wanted_options,
        count=quotas.count,
        refused=refused,
    )
    response.status_code = 202 if uploaded.any_created else 200
    first = uploaded.drives[0].drive
    response.headers.update({"Location": drive_address(base, first), **quotas.headers})
    return uploaded.document(base)


def asked_of(query: UploadRequest, settings: Settings) -> tuple[str, dict[str, Any], frozenset[str] | None]:
    """The estimator, its options, and which sports are taken; raises what is wrong with them."""
    estimator = query.method or default_method(settings)
    positioning = asked_positioning(query.gnss, query.gnss_option)
    wanted_options = with_positioning(query.asked_options() or {}, positioning)
    wanted_options |= asked_columns(query.columns)
    check_options(estimator, wanted_options)
    return estimator, wanted_options, _asked_sports(query.sports)


def _asked_sports(names: Sequence[str]) -> frozenset[str] | None:
    """Which sports are taken; None: every one. Raises ``BadRequestError``."""
    if not names:
        return None
    # with the formats, which are loaded where something is uploaded
    from fusion.formats.archives.sports import ROADS, SPORTS, chosen  # noqa: PLC0415

    try:
        return chosen(names)
    except ValueError as error:
        raise BadRequestError(
            say("upload.no_sport", name=str(error), known=[ROADS, *SPORTS]), field="sports"
        ) from None


async def receive_upload(
    request: Request,
    blobs: BlobStore,
    settings: Settings,
    look: FirstLook,
    rule: Rule = Rule.AUTO,
    sports: Collection[str] | None = None,
) -> Sorted:
    """Store the files of the request's body as a blob for each drive that they are.

    Raises what ``receive_files`` does, ``StorageFullError`` as soon as there is no room for it, ``BadRequestError`` for
    an empty file, ``LogError`` where no file is a log, and what ``UploadBundle`` raises else. Nothing stays in the
    store then.
    """
    begin = sorting_of(blobs, settings, look, rule, sports)
    most = settings.max_upload_bytes
    too_large = say("upload.too_large", most=most)
    return await receive_files(request, begin, most, too_large)


def sorting_of(
    blobs: BlobStore, settings: Settings, look: FirstLook, rule: Rule, sports: Collection[str] | None
) -> Callable[[int], SortedUpload]:
    """Begins to take an upload of so many announced bytes, within the service's limits."""
    limits = {"keep_free_bytes": settings.min_free_bytes, "max_content_bytes": settings.max_log_bytes}

    def begin(announced_bytes: int) -> SortedUpload:
        bundle = UploadBundle(blobs, expected_bytes=announced_bytes, look=look, **limits)
        return SortedUpload(
            bundle, partial(blobs.writer, **limits), blobs, settings.max_log_bytes, rule, look.columns, sports
        )

    return begin
