"""The file of an operation on its way from a request's body into the blob store, piece by piece."""

from __future__ import annotations

from functools import partial
from pathlib import PurePosixPath
from typing import NamedTuple

from fastapi import Request

from app.core.blobs import BlobStore, StoredBlob
from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.receiving.body import DEFAULT_FILENAME, FIELD, Piece, joined
from app.core.receiving.files import receive_files
from app.core.settings import Settings

NAME_BYTES = 200
"""File systems take 255; suffixes come to it."""


class Received(NamedTuple):
    """A file that was stored."""

    blob: StoredBlob
    name: str


async def receive_file(request: Request, blobs: BlobStore, settings: Settings) -> Received:
    """Store the one file of the request's body.

    Raises what ``receive_files`` does, ``StorageFullError`` where there is no room for it, ``BadRequestError`` for a
    body without a file, with an empty one or with several. Nothing stays in the store then.
    """
    most = settings.max_import_bytes
    too_large = say("operation.too_large", most=most)
    return await receive_files(request, partial(_OneFile, blobs, settings), most, too_large)


class _OneFile:
    """The file while it comes."""

    def __init__(self, blobs: BlobStore, settings: Settings, announced_bytes: int) -> None:
        self._writer = blobs.writer(
            keep_free_bytes=settings.min_free_bytes, expected_bytes=announced_bytes, max_content_bytes=0
        )
        self._name = ""
        self.discard = self._writer.discard

    def take(self, pieces: list[Piece]) -> None:
        """Write the next pieces; ``BadRequestError`` where another file begins."""
        for piece in joined(pieces):
            if piece.file:
                raise BadRequestError(say("operation.one_file"), field=FIELD)
            self._name = piece.name
            self._writer.write(piece.data)

    def finish(self) -> Received:
        """The file in the store; ``BadRequestError`` where it is empty or its name cannot be used."""
        if not self._writer.size_bytes:
            raise BadRequestError(
                say("operation.no_file", field=FIELD),
                field=FIELD,
            )
        if self._name in {"", DEFAULT_FILENAME}:
            raise BadRequestError(
                say("operation.no_name"),
                field="filename",
            )
        last = PurePosixPath(self._name).name  # so the worker calls the file, in a folder of its own
        if last in {"", ".", ".."} or not last.isprintable() or len(last.encode()) > NAME_BYTES:
            raise BadRequestError(
                say("operation.bad_name", name=last[:40], most=NAME_BYTES),
                field="filename",
            )
        return Received(self._writer.finish(), self._name)
