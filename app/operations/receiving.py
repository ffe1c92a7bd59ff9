"""The file of an operation on its way from a request's body into the blob store, piece by piece."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import NamedTuple

import anyio
from fastapi import Request
from starlette.concurrency import run_in_threadpool

from app.core.blobs import BlobStore, BlobWriter, StoredBlob
from app.core.errors import BadRequestError, BodyTooLargeError
from app.core.receiving.body import DEFAULT_FILENAME, FIELD, UploadSource, upload_source
from app.core.settings import Settings

CHUNK_BYTES = 1024 * 1024
"""How much is handed to the blob store at a time."""
NAME_BYTES = 200
"""File systems take 255; suffixes come to it."""


class Received(NamedTuple):
    """A file that was stored."""

    blob: StoredBlob
    name: str


async def receive_file(request: Request, blobs: BlobStore, settings: Settings) -> Received:
    """Store the one file of the request's body.

    Raises ``BodyTooLargeError`` as soon as it is announced or found to be too large, ``StorageFullError`` where there
    is no room for it, ``BadRequestError`` for a body without a file, with an empty one or with several. Nothing stays
    in the store then, nor when the client goes away.
    """
    most = settings.max_import_bytes
    source = upload_source(request.headers, request.query_params)
    length = request.headers.get("content-length", "")
    announced = int(length) if length.isdigit() else 0
    if announced > most + source.envelope_bytes:
        raise _too_large(most)
    writer = await run_in_threadpool(
        blobs.writer, keep_free_bytes=settings.min_free_bytes, expected_bytes=announced, max_content_bytes=0
    )
    try:
        name = await _copy(request, source, writer, most)
        return Received(await run_in_threadpool(writer.finish), name)
    except BaseException:
        with anyio.CancelScope(shield=True):  # also when this request is cancelled
            await run_in_threadpool(writer.discard)
        raise


async def _copy(request: Request, source: UploadSource, writer: BlobWriter, most: int) -> str:
    name, waiting = "", bytearray()
    async for chunk in request.stream():
        for piece in source.feed(chunk):
            if piece.file:
                raise BadRequestError("An operation takes one file. Ask for one each.", field=FIELD)
            name = piece.name
            waiting += piece.data
        if writer.size_bytes + len(waiting) > most:
            raise _too_large(most)
        if len(waiting) >= CHUNK_BYTES:
            await run_in_threadpool(writer.write, bytes(waiting))
            waiting.clear()
    source.finish()
    if waiting:
        await run_in_threadpool(writer.write, bytes(waiting))
    if not writer.size_bytes:
        raise BadRequestError(
            f"There is no file in the body. Send it as the field {FIELD!r} (curl -F {FIELD}=@FILE), or as the body "
            "itself with its name in `filename`.",
            field=FIELD,
        )
    if name in {"", DEFAULT_FILENAME}:
        raise BadRequestError(
            "The file has no name, and its name tells its format. Give it as `filename` (karlsruhe.osm.pbf).",
            field="filename",
        )
    last = PurePosixPath(name).name  # so the worker calls the file, in a folder of its own
    if last in {"", ".", ".."} or not last.isprintable() or len(last.encode()) > NAME_BYTES:
        raise BadRequestError(
            f"{last[:40]!r} is no name for a file here: it must be printable, of {NAME_BYTES} bytes at most.",
            field="filename",
        )
    return name


def _too_large(most: int) -> BodyTooLargeError:
    return BodyTooLargeError(
        f"The file is larger than {most} bytes, the most that this service takes (VERSANT_MAX_IMPORT_BYTES). Import a "
        "smaller extract, or do it by `versant import-roads` and `versant import-dem` where the service runs.",
        field=FIELD,
    )
