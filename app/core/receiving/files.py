"""The files of a request's body, on their way into a store piece by piece. Knows no store.

Nothing is held in memory but the pieces on their way. A store's blocking calls run in threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import anyio
from fastapi import Request
from starlette.concurrency import run_in_threadpool

from app.core.errors import BodyTooLargeError
from app.core.receiving.body import FIELD, Piece, UploadSource, upload_source

CHUNK_BYTES = 1024 * 1024
"""How much is handed to the store at a time: few hops between threads, little memory."""
CHUNK_PIECES = 1024
"""As many pieces at most, of a body that comes in crumbs."""

T_co = TypeVar("T_co", covariant=True)


class Keeper(Protocol[T_co]):
    """Takes files: ``finish`` keeps what was taken and returns what came of it, ``discard`` forgets it."""

    def take(self, pieces: list[Piece]) -> None:
        """The next pieces."""

    def finish(self) -> T_co:
        """All have come."""

    def discard(self) -> None:
        """Nothing of them stays."""


async def receive_files(
    request: Request, begin: Callable[[int], Keeper[T_co]], most_bytes: int, too_large: str
) -> T_co:
    """Have a keeper take the files of the body; what it returns at the end.

    ``begin`` is told how many bytes are announced, 0 where nobody says. Raises ``BodyTooLargeError`` with the sentence
    ``too_large`` as soon as the body is announced or found to be larger than ``most_bytes``, ``BadRequestError`` for a
    malformed one, what the keeper raises, and ``ClientDisconnect`` when the client goes away. All is discarded then.
    """
    source = upload_source(request.headers, request.query_params)
    announced = announced_bytes(request)
    if announced > most_bytes + source.envelope_bytes:
        raise BodyTooLargeError(too_large, field=FIELD)
    keeper = await run_in_threadpool(begin, announced)
    try:
        await _copy(request, source, keeper, most_bytes, too_large)
        return await run_in_threadpool(keeper.finish)
    except BaseException:
        with anyio.CancelScope(shield=True):  # also when this request is cancelled
            await run_in_threadpool(keeper.discard)
        raise


def announced_bytes(request: Request) -> int:
    """Length of the body by its header; 0 where it is not said."""
    announced = request.headers.get("content-length", "")
    return int(announced) if announced.isdigit() else 0


def least_bytes(request: Request) -> int:
    """Bytes that the files in the body have at least, by its header: without a form's own; 0 where it is not said."""
    return max(
        0, announced_bytes(request) - upload_source(request.headers, request.query_params).envelope_bytes
    )


async def _copy(
    request: Request, source: UploadSource, keeper: Keeper[object], most_bytes: int, too_large: str
) -> None:
    waiting: list[Piece] = []
    received = held = 0
    async for chunk in request.stream():
        pieces = source.feed(chunk)
        size = sum(len(piece.data) for piece in pieces)
        received, held = received + size, held + size
        if received > most_bytes:
            raise BodyTooLargeError(too_large, field=FIELD)
        waiting += pieces
        if held >= CHUNK_BYTES or len(waiting) >= CHUNK_PIECES:
            await run_in_threadpool(keeper.take, waiting)
            waiting, held = [], 0
    source.finish()
    await run_in_threadpool(keeper.take, waiting)
