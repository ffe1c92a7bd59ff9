"""Receiving an upload: from the socket to the blob store in constant memory."""

from __future__ import annotations

import anyio
from fastapi import Request
from starlette.concurrency import run_in_threadpool

from app.errors import BadRequestError, BodyTooLargeError
from app.multipart import UploadSource, upload_source
from app.store.blobs import BlobStore, BlobWriter, StoredBlob

CHUNK_BYTES = 1024 * 1024
"""How much is handed to the blob store at a time: few hops between threads, little memory."""


async def receive_upload(request: Request, blobs: BlobStore, max_bytes: int) -> tuple[StoredBlob, str]:
    """Store the file of the request's body; returns the blob and the file's name.

    Raises ``BodyTooLargeError`` as soon as the body is announced or found to be too large,
    ``BadRequestError`` for an empty file or a malformed body, ``ClientDisconnect`` when the client goes away.
    Nothing stays in the store then. The store's blocking calls run in threads.
    """
    source = upload_source(request.headers, request.query_params)
    _check_announced(request, max_bytes + source.envelope_bytes, max_bytes)
    writer = await run_in_threadpool(blobs.writer, max_bytes=max_bytes)
    try:
        await _copy(request, source, writer, max_bytes)
        return await run_in_threadpool(writer.finish), source.filename
    except BaseException:
        with anyio.CancelScope(shield=True):  # also when this request is cancelled
            await run_in_threadpool(writer.discard)
        raise


async def _copy(request: Request, source: UploadSource, writer: BlobWriter, max_bytes: int) -> None:
    waiting = bytearray()
    async for chunk in request.stream():
        waiting += source.feed(chunk)
        if writer.size_bytes + len(waiting) > max_bytes:
            raise _too_large(max_bytes)
        if len(waiting) >= CHUNK_BYTES:
            await run_in_threadpool(writer.write, bytes(waiting))
            waiting.clear()
    source.finish()
    await run_in_threadpool(writer.write, bytes(waiting))
    if not writer.size_bytes:
        raise BadRequestError(
            "The upload is empty: it holds no bytes. Send the log's contents.", field="file"
        )


def _check_announced(request: Request, most: int, max_bytes: int) -> None:
    announced = request.headers.get("content-length", "")
    if announced.isdigit() and int(announced) > most:
        raise _too_large(max_bytes)


def _too_large(max_bytes: int) -> BodyTooLargeError:
    return BodyTooLargeError(
        f"The upload is larger than {max_bytes} bytes, the most that this service takes. "
        "Compress it with gzip or split it into several drives.",
        field="file",
    )
