"""The log of a drive in the store."""

from __future__ import annotations

from typing import BinaryIO

from app.core.errors import NotFoundError
from app.core.http import Service
from app.drives.documents import Drive


def opened_log(service: Service, drive: Drive, block_bytes: int) -> BinaryIO:
    """The file as it came, fetched in blocks of a bucket; ``NotFoundError`` where it is lost."""
    try:
        return service.blobs.open(drive.blob_key, block_bytes)
    except FileNotFoundError:
        raise NotFoundError(
            f"The uploaded file of drive {drive.id} is no longer in the service's storage. What was computed of it "
            "stays; upload the same file again, and the drive has it again."
        ) from None
