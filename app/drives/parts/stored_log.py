"""The log of a drive in the store."""

from __future__ import annotations

from typing import BinaryIO

from app.core.errors import NotFoundError
from app.core.http import Service
from app.core.messages import say
from app.drives.documents import Drive


def opened_log(service: Service, drive: Drive, block_bytes: int) -> BinaryIO:
    """The file as it came, fetched in blocks of a bucket; ``NotFoundError`` where it is lost."""
    try:
        return service.blobs.open(drive.blob_key, block_bytes)
    except FileNotFoundError:
        raise NotFoundError(say("drives.file_gone", id=drive.id)) from None
