"""Files that are fetched whole or in parts (RFC 9110, section 14): which bytes, and the headers."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

CHUNK_BYTES = 256 * 1024
_ONE_RANGE = re.compile(r"bytes\s*=\s*(\d*)\s*-\s*(\d*)", re.IGNORECASE | re.ASCII)
MOST_DIGITS = 18


@dataclass(frozen=True)
class Part:
    """Bytes of a file, the last one included."""

    first: int
    last: int

    @property
    def size(self) -> int:
        """How many."""
        return self.last - self.first + 1


class NoSuchRangeError(Exception):
    """The file ends before the range."""


def part_of(range_header: str | None, if_range: str | None, etag: str, size: int) -> Part | None:
    """The part of a file of ``size`` bytes that is asked for; None: the whole one.

    Several ranges at once, another unit and what is no range are answered by the whole file, as the standard allows,
    and so is a range of what the client has of another file (``if_range``). Raises ``NoSuchRangeError``.
    """
    if range_header is None or (if_range is not None and if_range.strip() != etag):
        return None
    match = _ONE_RANGE.fullmatch(range_header.strip())
    if match is None or not any(match.groups()) or any(len(n) > MOST_DIGITS for n in match.groups()):
        return None
    first, last = match.groups()
    if not first:
        length = min(int(last), size)
        if length == 0:
            raise NoSuchRangeError
        return Part(size - length, size - 1)
    if last and int(last) < int(first):
        return None
    if int(first) >= size:
        raise NoSuchRangeError
    return Part(int(first), min(int(last or size), size - 1))


def pieces(file: BinaryIO, part: Part | None) -> Iterator[bytes]:
    """The bytes of a file, or of a part of it, piece by piece; closes the file."""
    with file:
        left = None if part is None else part.size
        if part is not None:
            file.seek(part.first)
        while left is None or left > 0:
            piece = file.read(CHUNK_BYTES if left is None else min(CHUNK_BYTES, left))
            if not piece:
                return
            left = None if left is None else left - len(piece)
            yield piece


def headers_of(file_name: str, sha256: str, size: int, part: Part | None) -> dict[str, str]:
    """The headers of a file, or of a part of it."""
    digest = f"sha-256=:{base64.b64encode(bytes.fromhex(sha256)).decode()}:"
    headers = {
        "ETag": f'"{sha256}"',
        "Accept-Ranges": "bytes",
        "Cache-Control": "no-cache",
        "Content-Disposition": f'attachment; filename="{file_name}"',
        "Repr-Digest": digest,  # of the whole file, whatever part of it comes
    }
    if part is None:
        return headers | {"Content-Length": str(size), "Content-Digest": digest}
    return headers | {
        "Content-Length": str(part.size),
        "Content-Range": f"bytes {part.first}-{part.last}/{size}",
    }
