"""Where a page of drives begins, as the opaque text of ``next`` links.

It holds the place itself and not only a drive's id, so that the drive may be deleted meanwhile.
"""

from __future__ import annotations

import base64
import re
import struct
import uuid
from datetime import UTC, datetime, timedelta

from app.errors import BadRequestError
from app.store.rows import DrivePlace

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_PLACE = struct.Struct(">q16s")  # microseconds since the epoch, the id
_CURSOR = re.compile(r"[A-Za-z0-9_-]{32}")


def cursor_of(place: DrivePlace) -> str:
    """The text that ``parse_cursor`` takes; microseconds, the database's resolution, are kept."""
    moment_us = (place.created_at - _EPOCH) // timedelta(microseconds=1)
    return base64.urlsafe_b64encode(_PLACE.pack(moment_us, place.id.bytes)).decode("ascii")


def parse_cursor(text: str) -> DrivePlace:
    """The place in the list; ``BadRequestError`` for a text that ``cursor_of`` did not make."""
    try:
        if not _CURSOR.fullmatch(text):
            raise ValueError(text)
        moment_us, key = _PLACE.unpack(base64.urlsafe_b64decode(text))
        return DrivePlace(_EPOCH + timedelta(microseconds=moment_us), uuid.UUID(bytes=key))
    except (ValueError, OverflowError):
        raise BadRequestError(
            "after: this is no place in the list. Take it from a next link, or begin again without after.",
            field="after",
        ) from None
