"""Uploads of large files over bad links: tus 1.0.0, with creation, expiration, termination and checksums.

An upload whose connection breaks goes on where it stood. Its last byte makes of it what `POST /v1/drives` makes of the
same bytes, by the same way. tuspyserver was looked at: it keeps files in a folder of its own or in a bucket by a second
driver, knows no owners and no limits but sizes, serves what was uploaded to whoever has its address, and would be
wrapped in all its parts. Knows no SQL and no formats.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
from collections.abc import Iterator
from email.utils import format_datetime
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.access.quotas import Quotas
from app.core.caller import present_caller
from app.core.errors import (
    BadRequestError,
    BodyTooLargeError,
    ConflictingOffsetError,
    OtherProtocolError,
    QuotaError,
    SlowClientError,
    UnsupportedBodyError,
    WrongChecksumError,
)
from app.core.http import BaseUrl, Service, ServiceDep, json_answer, problems
from app.core.messages import say
from app.core.receiving.body import Piece, clean_filename
from app.core.receiving.files import CHUNK_BYTES
from app.drives.documents import drive_address
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.resumed import Asked, PartWriter, ResumedUploads
from app.drives.receiving.sorting import Sorted
from app.drives.upload import UploadRequest, asked_of, sorting_of
from app.drives.uploaded import Uploaded, register_drives
from fusion.errors import LogError
from fusion.formats.grouping import Rule

router = APIRouter(prefix="/v1/uploads", tags=["drives"])

VERSION = "1.0.0"
EXTENSIONS = "creation,expiration,termination,checksum"
ALGORITHMS = {"sha1": hashlib.sha1, "sha256": hashlib.sha256}
CONTENT_TYPE = "application/offset+octet-stream"
_RESUMABLE = {"Tus-Resumable": VERSION, "Cache-Control": "no-store"}
_HEADERS: dict[int | str, dict[str, Any]] = {
    201: {"description": "Begun: send its bytes to `Location`, by PATCH."},
}


@router.options("", status_code=204, summary="What of tus is spoken here")
async def tus_options(service: ServiceDep) -> Response:
    """Version, extensions and the largest upload, as headers."""
    told = {
        "Tus-Version": VERSION,
        "Tus-Extension": EXTENSIONS,
        "Tus-Max-Size": str(service.settings.max_upload_bytes),
        "Tus-Checksum-Algorithm": ",".join(ALGORITHMS),
    }
    return Response(status_code=204, headers=_RESUMABLE | told)


@router.post(
    "",
    status_code=201,
    response_class=Response,
    summary="Begin an upload that can be resumed",
    responses={**_HEADERS, **problems(409, 412, 413, 422, 507)},
)
async def begin_upload(
    request: Request, service: ServiceDep, base: BaseUrl, query: Annotated[UploadRequest, Query()]
) -> Response:
    """For large files over links that break: [tus 1.0.0](https://tus.io/protocols/resumable-upload), which clients in
    many languages speak. The query is that of `POST /v1/drives`; `Upload-Metadata` may have a `filename`. An owner has
    at most 16 under way, and each has to be over within a day (`Upload-Expires`)."""
    _require_version(request)
    size_bytes = _number(request, "Upload-Length")
    most = service.settings.max_upload_bytes
    if size_bytes > most:
        raise BodyTooLargeError(say("upload.too_large", most=most), field="Upload-Length")
    name = query.filename or _metadata(request.headers.get("upload-metadata", "")).get("filename", "")
    method, options, sports = asked_of(query, service.settings)
    asked = Asked(
        size_bytes,
        clean_filename(name),
        method,
        options,
        query.grouping.value,
        None if sports is None else sorted(sports),
    )
    await run_in_threadpool(Quotas(service.settings).look, service.sessions, size_bytes)
    upload = await run_in_threadpool(_uploads(service).begin, asked)
    headers = {"Location": f"{base}/v1/uploads/{upload}", "Upload-Expires": _http_time(asked)}
    return Response(status_code=201, headers=_RESUMABLE | headers)


@router.get(
    "/{upload_id}",
    response_class=Response,
    summary="How far an upload is",
    responses={
        200: json_answer(
            "`Upload-Offset`; when it is over, what came of it.", {"offset": 8388608, "length": 16777216}
        ),
        **problems(404),
    },
)
async def look_at_upload(upload_id: str, service: ServiceDep) -> Response:
    """Also by HEAD, as tus asks: bytes that have come, as a header. When it is over, the body is what `POST /v1/drives`
    answers."""
    return await run_in_threadpool(_look, _uploads(service), upload_id)


def _look(uploads: ResumedUploads, upload_id: str) -> Response:
    asked, answer = uploads.asked(upload_id), uploads.answer(upload_id)
    offset = asked.size_bytes if answer else uploads.offset(upload_id)
    headers = _RESUMABLE | {
        "Upload-Offset": str(offset),
        "Upload-Length": str(asked.size_bytes),
        "Upload-Expires": _http_time(asked),
    }
    if answer:
        headers["Content-Location"] = answer["location"]
    standing = {"offset": offset, "length": asked.size_bytes}
    return JSONResponse(answer["document"] if answer else standing, headers=headers)


@router.delete("/{upload_id}", status_code=204, summary="Give an upload up", responses={**problems(404, 412)})
async def end_upload(upload_id: str, request: Request, service: ServiceDep) -> Response:
    """What has come of it is removed; what it became stays."""
    uploads = _uploads(service)
    await run_in_threadpool(uploads.asked, upload_id)
    _require_version(request)
    await run_in_threadpool(uploads.remove, upload_id)
    return Response(status_code=204, headers=_RESUMABLE)


@router.patch(
    "/{upload_id}",
    status_code=204,
    summary="Send bytes of an upload",
    responses={**problems(404, 409, 412, 413, 415, 422, 429, 460, 503, 507)},
)
async def send_bytes(upload_id: str, request: Request, service: ServiceDep, base: BaseUrl) -> Response:
    """From `Upload-Offset` on. What came is kept when the connection breaks. The last byte makes drives of it:
    `Content-Location` names the first, a GET all of them. If that fails for now (429, 503, 507), send nothing from the
    same offset to have it tried again; a log that is refused is forgotten."""
    uploads = _uploads(service)
    asked = await run_in_threadpool(uploads.asked, upload_id)
    _require_version(request)
    if request.headers.get("content-type", "") != CONTENT_TYPE:
        raise UnsupportedBodyError(say("resumed.content_type", type=CONTENT_TYPE), field="Content-Type")
    start = _number(request, "Upload-Offset")
    answer = await run_in_threadpool(uploads.answer, upload_id)
    offset = asked.size_bytes if answer else await run_in_threadpool(uploads.offset, upload_id)
    if start != offset:
        raise ConflictingOffsetError(say("resumed.offset", offset=offset))
    if answer is None:
        offset += await _receive(request, uploads, upload_id, asked, start)
        if offset == asked.size_bytes:
            try:
                answer = await run_in_threadpool(_finish, service, uploads, upload_id, asked, base)
            except QuotaError as error:
                request.app.state.metrics.refused(error.quota)
                raise
    headers = {"Upload-Offset": str(offset), "Upload-Expires": _http_time(asked)}
    if answer:
        headers["Content-Location"] = answer["location"]
    return Response(status_code=204, headers=_RESUMABLE | headers)


async def _receive(
    request: Request, uploads: ResumedUploads, upload_id: str, asked: Asked, start: int
) -> int:
    """Keep the body from ``start`` on, as far as it comes; how many bytes that is."""
    wanted = _checksum(request)
    digest = wanted[0]() if wanted else None
    part = await run_in_threadpool(uploads.part, upload_id, start)
    waiting = bytearray()
    try:
        async for chunk in request.stream():
            waiting += chunk
            if start + part.size_bytes + len(waiting) > asked.size_bytes:
                raise BodyTooLargeError(say("resumed.too_much", most=asked.size_bytes), field="body")
            if len(waiting) >= CHUNK_BYTES:
                await run_in_threadpool(_write, part, bytes(waiting), digest)
                waiting.clear()
    except (ClientDisconnect, SlowClientError):
        if digest is None:  # of half of it nobody knows whether it is right
            await run_in_threadpool(_write, part, bytes(waiting), None)
            await run_in_threadpool(part.keep)
        else:
            await run_in_threadpool(part.drop)
        raise
    except BaseException:
        await run_in_threadpool(part.drop)
        raise
    await run_in_threadpool(_write, part, bytes(waiting), digest)
    if wanted and digest is not None and not hmac.compare_digest(digest.digest(), wanted[1]):
        await run_in_threadpool(part.drop)
        raise WrongChecksumError(say("resumed.checksum"))
    if not await run_in_threadpool(part.keep):
        raise ConflictingOffsetError(say("resumed.faster"))
    return part.size_bytes


def _write(part: PartWriter, data: bytes, digest: Any) -> None:
    part.write(data)
    if digest is not None:
        digest.update(data)


def _finish(
    service: Service, uploads: ResumedUploads, upload_id: str, asked: Asked, base: str
) -> dict[str, Any]:
    """Make drives of all bytes, by the way of any upload."""
    quotas = Quotas(service.settings)
    try:
        files = _sorted(service, uploads.data(upload_id), asked)
    except LogError:
        uploads.remove(upload_id)  # the same bytes are never a log
        raise
    uploaded: Uploaded = register_drives(
        service.sessions,
        service.blobs,
        files,
        method=asked.method,
        options=asked.options,
        count=quotas.count,
        refused=lambda error: None,
    )
    answer = {
        "location": drive_address(base, uploaded.drives[0].drive),
        "document": uploaded.document(base).model_dump(mode="json"),
    }
    uploads.end(upload_id, answer)
    return answer


def _sorted(service: Service, data: Iterator[bytes], asked: Asked) -> Sorted:
    look = FirstLook(asked.options.get("columns"))
    sports = None if asked.sports is None else frozenset(asked.sports)
    begin = sorting_of(service.blobs, service.settings, look, Rule(asked.grouping), sports)
    keeper = begin(asked.size_bytes)
    try:
        for piece in data:
            keeper.take([Piece(0, asked.filename, piece)])
        return keeper.finish()
    except BaseException:
        keeper.discard()
        raise


def _uploads(service: Service) -> ResumedUploads:
    settings = service.settings
    return ResumedUploads(settings.blob_store_url, present_caller().owner_id, settings.min_free_bytes)


def _require_version(request: Request) -> None:
    if request.headers.get("tus-resumable") != VERSION:
        raise OtherProtocolError(say("resumed.version", version=VERSION))


def _number(request: Request, name: str) -> int:
    text = request.headers.get(name, "")
    if not (text.isdigit() and len(text) <= 15):
        raise BadRequestError(say("resumed.number", name=name), field=name)
    return int(text)


def _metadata(header: str) -> dict[str, str]:
    """Names and values of ``Upload-Metadata``; what cannot be read of it is nobody's loss."""
    out = {}
    for pair in header.split(","):
        name, _, value = pair.strip().partition(" ")
        try:
            out[name] = base64.b64decode(value, validate=True).decode("utf-8", "replace")
        except (binascii.Error, ValueError):
            continue
    return out


def _checksum(request: Request) -> tuple[Any, bytes] | None:
    header = request.headers.get("upload-checksum")
    if header is None:
        return None
    name, _, value = header.partition(" ")
    try:
        return partial(ALGORITHMS[name], usedforsecurity=False), base64.b64decode(value, validate=True)
    except (KeyError, binascii.Error, ValueError):
        raise BadRequestError(
            say("resumed.checksum_form", names=list(ALGORITHMS)), field="Upload-Checksum"
        ) from None


def _http_time(asked: Asked) -> str:
    return format_datetime(asked.ends_at, usegmt=True)
