"""The files in an upload, taken out of the body as it arrives: multipart/form-data, or the body itself.

Bytes in, bytes of the files out: knows no request, no store and no limits of size and number. python-multipart finds
the parts. Its ``FormParser`` and Starlette's ``MultiPartParser`` were tried in the place of the callbacks below: both
write every file into a temporary one first, keep a log that came without a file name in memory, and do not tell a
body that broke off from one without the field. ``PushMultipartParser`` of ``multipart`` streams and would save the
callbacks for headers, but is one more dependency, and malformed bodies would get other messages.
"""

from __future__ import annotations

from collections.abc import Iterable
from email.message import Message
from email.utils import collapse_rfc2231_value
from itertools import groupby
from pathlib import PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import unquote

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.datastructures import Headers, QueryParams

from app.core.errors import BadRequestError, UnsupportedBodyError
from app.core.messages import say

FIELD = "file"
ENVELOPE_BYTES = 64 * 1024
"""What a multipart body may hold beside the file: boundaries, headers, small fields."""
FILENAME_LENGTH = 255
DEFAULT_FILENAME = "upload"
FILENAME_CHARSETS = frozenset({"utf-8", "iso-8859-1", "latin-1"})
"""Of ``filename*=`` (RFC 6266, section 4.3); Python's decoders for other names fail in ways of their own."""


class Piece(NamedTuple):
    """Some bytes of one of the files; each file has a piece, also an empty one."""

    file: int
    """Which one, from 0; they come one after the other."""
    name: str
    data: bytes


def joined(pieces: Iterable[Piece]) -> list[Piece]:
    """The same with one piece for each file."""
    return [
        Piece(file, name, b"".join(piece.data for piece in of_one))
        for (file, name), of_one in groupby(pieces, key=lambda piece: piece[:2])
    ]


def upload_source(headers: Headers, query: QueryParams) -> UploadSource:
    """How to read the body that these headers announce; ``UnsupportedBodyError`` where there is no way.

    Any content type but multipart is taken as the log itself: logs have no media types, and curl calls every
    body a form.
    """
    encoding = headers.get("content-encoding", "identity").strip().lower()
    if encoding not in {"", "identity", "gzip", "x-gzip"}:
        raise UnsupportedBodyError(
            say("upload.encoding", encoding=encoding),
            field="Content-Encoding",
        )
    filename = _announced_filename(headers, query)
    kind, options = parse_options_header(headers.get("content-type"))
    if not kind.lower().startswith(b"multipart/"):
        return RawBody(filename)
    if kind.lower() != b"multipart/form-data" or not options.get(b"boundary"):
        raise UnsupportedBodyError(
            say("upload.no_boundary"),
            field="Content-Type",
        )
    return MultipartBody(options[b"boundary"], filename)


class RawBody:
    """The body is the file."""

    envelope_bytes = 0
    """How many bytes the body may be longer than the files."""

    def __init__(self, filename: str) -> None:
        self._filename = filename

    def feed(self, chunk: bytes) -> list[Piece]:
        """Take the next bytes of the body; return those of files among them, in their order: here all."""
        return [Piece(0, self._filename, chunk)]

    def finish(self) -> None:
        """The body has ended, always complete: the server itself checks the length."""


class MultipartBody:
    """The parts called ``file`` of a multipart/form-data body; other parts are passed over."""

    envelope_bytes = ENVELOPE_BYTES

    def __init__(self, boundary: bytes, filename: str) -> None:
        self._default_name = self._name = filename
        self._files = 0
        self._complete = self._inside = False
        self._header_name = self._header_value = b""
        self._headers: dict[bytes, bytes] = {}
        self._pieces: list[Piece] = []
        self._passed_over = 0
        # What follows the underscore of a method is the parser's name of what it is called for.
        callbacks: Any = {name[1:]: getattr(self, name) for name in dir(self) if name.startswith("_on_")}
        try:
            self._parser = MultipartParser(boundary, callbacks)
        except FormParserError as error:
            raise BadRequestError(say("upload.multipart", error=error), field="Content-Type") from None

    def feed(self, chunk: bytes) -> list[Piece]:
        """The files' bytes in ``chunk``; ``BadRequestError`` where the body is no multipart."""
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise BadRequestError(say("upload.malformed", error=error), field="body") from None
        pieces, self._pieces = self._pieces, []
        return joined(pieces)

    def finish(self) -> None:
        """``BadRequestError`` for a body cut short or without a part called ``file``."""
        if not self._complete:
            raise BadRequestError(say("upload.cut_off"), field="body")
        if not self._files:
            raise BadRequestError(
                say("upload.no_field", field=FIELD),
                field=FIELD,
            )

    def _on_part_begin(self) -> None:
        self._headers, self._inside = {}, False

    def _on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._header_name += data[start:end]

    def _on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._header_value += data[start:end]

    def _on_header_end(self) -> None:
        self._headers[self._header_name.lower()] = self._header_value
        self._header_name = self._header_value = b""

    def _on_headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition"))
        if options.get(b"name") != FIELD.encode():
            return
        self._files += 1
        self._inside = True
        name = options.get(b"filename", b"").decode("utf-8", "replace")
        self._name = clean_filename(name) if name else self._default_name
        self._add(b"")

    def _on_part_data(self, data: bytes, start: int, end: int) -> None:
        if self._inside:
            self._add(data[start:end])
            return
        self._passed_over += end - start
        if self._passed_over > ENVELOPE_BYTES:
            raise BadRequestError(
                say("upload.other_fields", most=ENVELOPE_BYTES, field=FIELD),
                field=FIELD,
            )

    def _add(self, data: bytes) -> None:
        self._pieces.append(Piece(self._files - 1, self._name, data))

    def _on_part_end(self) -> None:
        self._inside = False

    def _on_end(self) -> None:
        self._complete = True


UploadSource = RawBody | MultipartBody
"""Where the files' bytes come from."""


def clean_filename(name: str) -> str:
    """The last part of a path of any system, without control characters, at most 255 characters long."""
    last = PurePosixPath(name.replace("\\", "/")).name
    return "".join(c for c in last if c.isprintable()).strip()[:FILENAME_LENGTH] or DEFAULT_FILENAME


def _announced_filename(headers: Headers, query: QueryParams) -> str:
    names = (
        query.get("filename"),
        unquote(headers.get("x-filename", "")),
        _disposed_filename(headers.get("content-disposition", "")),
    )
    return next((clean_filename(name) for name in names if name), DEFAULT_FILENAME)


def _disposed_filename(content_disposition: str) -> str | None:
    """The name in a Content-Disposition header; None where it holds none that can be read."""
    disposition = Message()
    disposition["Content-Disposition"] = content_disposition
    try:
        name = disposition.get_param("filename", header="content-disposition")
        if isinstance(name, tuple) and (name[0] or "utf-8").lower() not in FILENAME_CHARSETS:
            return None
        return collapse_rfc2231_value(name) if name else None
    except (ValueError, TypeError, LookupError):  # the parser trips over odd continuations in these ways
        return None
