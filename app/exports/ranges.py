"""Files that are fetched whole or in parts (RFC 9110, section 14): which bytes, and the answer that has them."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import BinaryIO

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

from app.core.errors import STATUS_KINDS
from app.core.http import not_modified
from app.core.problems import problem_response

CHUNK_BYTES = 256 * 1024

_ONE_RANGE = re.compile(r"bytes\s*=\s*(\d*)\s*-\s*(\d*)", re.IGNORECASE | re.ASCII)
MOST_DIGITS = 18

OpenedFile = Callable[[], tuple[BinaryIO, Mapping[str, str]]]
"""Opens a file, and tells the headers of all answers with it."""


class NoSuchRangeError(Exception):
    """The file ends before the range."""


@dataclass(frozen=True)
class Stored:
    """A file that is stored with its checksum."""

    sha256: str
    """Of all its bytes, hex; in quotes it is the file's ETag."""
    size_bytes: int
    media_type: str


def stored_answer(
    request: Request, stored: Stored, opened: Callable[[], BinaryIO], headers: Mapping[str, str]
) -> Response:
    """A stored file as ``file_answer`` answers, with its checksum; 304 where the client has it.

    ``headers``: of all answers with it, Cache-Control among them.
    """
    etag = f'"{stored.sha256}"'
    if unchanged := not_modified(request, {"ETag": etag, "Cache-Control": headers["Cache-Control"]}):
        return unchanged
    # Of the whole file, whatever part of it comes.
    digest = f"sha-256=:{base64.b64encode(bytes.fromhex(stored.sha256)).decode()}:"
    shown = {**headers, "ETag": etag, "Accept-Ranges": "bytes", "Repr-Digest": digest}
    whole = {"Content-Digest": digest}
    return file_answer(request, etag, stored.size_bytes, stored.media_type, lambda: (opened(), shown), whole)


def file_answer(
    request: Request,
    etag: str,
    size: int,
    media_type: str,
    opened: OpenedFile,
    of_whole: Mapping[str, str] = MappingProxyType({}),
) -> Response:
    """A file of ``size`` bytes, or the part of it that the request asks for; 416 where it ends before that.

    ``of_whole``: further headers of an answer with all of it.
    """
    try:
        part = part_of(request.headers.get("range"), request.headers.get("if-range"), etag, size)
    except NoSuchRangeError:
        detail = f"The file has {size} bytes, and the range {request.headers['range'][:80]!r} begins beyond its end."
        range_headers = {"Content-Range": f"bytes */{size}", "ETag": etag}
        return problem_response(request, STATUS_KINDS[416], detail, headers=range_headers)
    file, headers = opened()
    if part is None:
        whole = {**headers, "Content-Length": str(size), **of_whole}
        return StreamingResponse(pieces(file, range(size)), 200, whole, media_type)
    place = {"Content-Length": str(len(part)), "Content-Range": f"bytes {part[0]}-{part[-1]}/{size}"}
    return StreamingResponse(pieces(file, part), 206, {**headers, **place}, media_type)


def part_of(range_header: str | None, if_range: str | None, etag: str, size: int) -> range | None:
    """The positions of the bytes that are asked for, of a file of ``size``; None: the whole one.

    Several ranges at once, another unit and what is no range are answered by the whole file, as the standard allows,
    and so is a range of what the client has of another file (``if_range``). Raises ``NoSuchRangeError``.
    """
    if range_header is None or (if_range is not None and if_range.strip() != etag):
        return None
    match = _ONE_RANGE.fullmatch(range_header.strip())
    if match is None or not any(match.groups()) or any(len(n) > MOST_DIGITS for n in match.groups()):
        return None
    first, last = match.groups()
    if first and last and int(last) < int(first):
        return None
    part = (
        range(int(first), size if not last else min(int(last) + 1, size))
        if first
        else range(size)[-int(last) :]
    )
    if not part or (not first and not int(last)):
        raise NoSuchRangeError
    return part


def pieces(file: BinaryIO, part: range) -> Iterator[bytes]:
    """The bytes at these positions of a file, piece by piece; closes the file."""
    with file:
        file.seek(part.start)
        left = len(part)
        while left > 0 and (piece := file.read(min(CHUNK_BYTES, left))):
            left -= len(piece)
            yield piece
