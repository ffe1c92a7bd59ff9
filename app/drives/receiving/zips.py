"""Several files as one zip: ours is written while the files come; any other is read as well.

Files that belong together, as observations and navigation data, are kept as one blob. So all that follows knows one
key, one size and one identity, which is of the files' contents, in whatever order, form or zip they came. Knows no
store and no log. A zip may come from a stranger: it is read within bounds and never unpacked to a disk.
"""

from __future__ import annotations

import errno
import hashlib
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import PurePosixPath
from typing import IO, BinaryIO

from app.core.content import ContentHash
from app.core.errors import BadRequestError, BodyTooLargeError, UnsupportedBodyError
from app.core.messages import say
from app.drives.receiving.first_look import FirstLook
from fusion.formats.container import BOMB_FREE_BYTES, BOMB_RATIO, CHUNK_BYTES

MAX_FILES = 32
"""More than any recorder writes for one drive."""
DIRECTORY_BYTES = 1 << 20
"""Largest table of contents of a zip: ``zipfile`` reads it at once and makes objects of all of it."""

MAGIC_BYTES = 4
"""Bytes by which a zip is recognised."""
_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1
_KIND = b"versant files\0"
"""Before the digests of several files, so that their identity is that of no file which happens to hold digests."""
_ADDED = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})
"""What systems put beside files; the reader of logs leaves out the same."""
_NAME_LENGTH = 80
_FIELD = "file"
# What zipfile raises for damage, here and there; a seek to before the start is an OSError of its own.
_BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    ValueError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)


def is_zip(head: bytes) -> bool:
    """Whether bytes that begin so are a zip."""
    return head.startswith(_MAGIC)


def content_of_files(contents: Iterable[str]) -> str:
    """Identity of files with these contents (hex digests): of one its own, of several the same in any order.

    A repeated content counts once.
    """
    files = sorted(set(contents))
    if len(files) == 1:
        return files[0]
    return hashlib.sha256(_KIND + bytes.fromhex("".join(files))).hexdigest()


class ZipWriter:
    """Files into one zip, piece by piece: ``begin`` and ``write`` each, then ``finish``, or ``drop`` to give up.

    They are stored as they are (what is worth compressing came gzipped), with safe names, each once, and without times:
    the same files in the same order give the same bytes.
    """

    def __init__(self, write: Callable[[bytes], None], max_content_bytes: int) -> None:
        """``write`` takes the bytes of the zip; a file that unpacks to more than that is its own content."""
        self._sink = _Sink(write)
        self._zip = zipfile.ZipFile(self._sink, "w")
        self._max_content_bytes = max_content_bytes
        self._file: IO[bytes] | None = None
        self._hash = ContentHash(max_content_bytes)
        self._head = b""
        self._names: list[str] = []
        self._contents: dict[str, str] = {}

    def begin(self, name: str) -> None:
        """The next file; the one before has ended. Raises what is wrong with that one."""
        self._end()
        if len(self._names) == MAX_FILES:
            raise _too_many()
        self._names.append(_own_name(name, self._names))
        self._hash, self._head = ContentHash(self._max_content_bytes), b""
        # Nobody knows yet how long it is.
        self._file = self._zip.open(zipfile.ZipInfo(self._names[-1]), "w", force_zip64=True)

    def write(self, data: bytes) -> None:
        """The next bytes of the file."""
        if len(self._head) < MAGIC_BYTES:
            self._head = (self._head + data)[:MAGIC_BYTES]
            if is_zip(self._head):
                raise _nested(repr(self._names[-1]))
        assert self._file is not None  # noqa: S101 - begun
        self._file.write(data)
        self._hash.update(data)

    def finish(self) -> str:
        """Write the end of the zip; returns the content of the files (``content_of_files``)."""
        self._end()
        self._zip.close()
        return content_of_files(self._contents)

    def drop(self) -> None:
        """Write nothing more."""
        self._sink.over = True
        if self._file is not None:
            self._file.close()
        self._zip.close()

    def _end(self) -> None:
        if self._file is None:
            return
        self._file.close()
        self._file = None
        name, content = self._names[-1], self._hash.content_sha256()
        if not self._head:
            raise BadRequestError(say("upload.empty_file", name=name), field=_FIELD)
        if (other := self._contents.setdefault(content, name)) != name:
            raise BadRequestError(
                say("upload.same_files", other=other, name=name),
                field=_FIELD,
            )


class _Sink:
    """Where a zip is written to, without a way back."""

    def __init__(self, write: Callable[[bytes], None]) -> None:
        self._write = write
        self.over = False

    def write(self, data: bytes) -> int:
        """Pass on what is still wanted."""
        if not self.over:
            self._write(data)
        return len(data)

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """The owner of ``write`` closes the file behind it."""


def _own_name(name: str, used: Iterable[str]) -> str:
    """``name`` without leading dots, and with a number where it is taken in whatever case."""
    path = PurePosixPath(name.lstrip(".") or "file")
    names = {other.lower() for other in used}
    own, number = path.name, 1
    while own.lower() in names:
        number += 1
        own = f"{path.stem}-{number}{path.suffix}"
    return own


def content_of_zip(file: BinaryIO, max_bytes: int, look: FirstLook) -> str:
    """Identity of the files in a zip; ``file`` can seek, ``max_bytes`` is the most that they may unpack to together.

    Left out is what holds nothing (folders, empty files) and what systems add of their own. ``look`` sees each. Raises
    ``BadRequestError`` for a broken zip or one without files, ``BodyTooLargeError`` for too many or too large ones or a
    bomb, ``UnsupportedBodyError`` for files that are encrypted, compressed in an unusual way, or zips themselves.
    """
    try:
        with zipfile.ZipFile(_Bounded(file)) as archive:
            members = files_in(archive)
            _check(members, file.seek(0, 2), max_bytes)
            contents = {_content(archive, info, max_bytes, look) for info in members}
    except _BROKEN as error:
        raise _broken(error) from None
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        raise _broken(error) from None
    return content_of_files(contents)


def files_in(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """What is looked at of a zip: neither folders and empty files nor what systems add of their own."""
    return [info for info in archive.infolist() if _is_file(info)]


class _Bounded:
    """A file of which nothing large is read at once."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell = file.seek, file.tell

    def seekable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(min(size, DIRECTORY_BYTES + 1) if size >= 0 else DIRECTORY_BYTES + 1)
        if len(data) > DIRECTORY_BYTES:
            raise _too_many()
        return data


def _is_file(info: zipfile.ZipInfo) -> bool:
    path = PurePosixPath(info.filename)
    added = path.name in _ADDED or path.name.startswith("._") or "__MACOSX" in path.parts
    return bool(info.file_size) and not info.filename.endswith("/") and not added


def _check(members: list[zipfile.ZipInfo], packed: int, max_bytes: int) -> None:
    """Refuse files by the table of contents; the sizes stated there bind the reader."""
    if not members:
        raise BadRequestError(say("zip.no_file"), field=_FIELD)
    if len(members) > MAX_FILES:
        raise _too_many()
    for info in members:
        if info.flag_bits & _ENCRYPTED:
            raise UnsupportedBodyError(
                say("zip.file_encrypted", name=_shown(info)),
                field=_FIELD,
            )
        if info.compress_type not in _METHODS:
            raise UnsupportedBodyError(
                say("zip.file_unusual", name=_shown(info)),
                field=_FIELD,
            )
    unpacked = sum(info.file_size for info in members)
    if unpacked > max_bytes:
        raise BodyTooLargeError(
            say("zip.too_large", most=max_bytes),
            field=_FIELD,
        )
    if unpacked > BOMB_FREE_BYTES and unpacked > BOMB_RATIO * packed:
        raise BodyTooLargeError(
            say("zip.looks_like_bomb", packed=packed, unpacked=unpacked),
            field=_FIELD,
        )


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo, max_bytes: int, look: FirstLook) -> str:
    content, first = ContentHash(max_bytes), True
    look.begin()
    with archive.open(info) as member:
        while piece := member.read(CHUNK_BYTES):
            if first and is_zip(piece):
                raise _nested(_shown(info))
            content.update(piece)
            look.feed(piece)
            first = False
    return content.content_sha256()


def _shown(info: zipfile.ZipInfo) -> str:
    """A stranger's name for a file, as a sentence can hold it."""
    last = PurePosixPath(info.filename.replace("\\", "/")).name
    return repr("".join(c for c in last if c.isprintable())[:_NAME_LENGTH])


def _nested(name: str) -> UnsupportedBodyError:
    return UnsupportedBodyError(
        say("zip.in_zip", name=name),
        field=_FIELD,
    )


def _too_many() -> BodyTooLargeError:
    return BodyTooLargeError(
        say("upload.many_files", most=MAX_FILES),
        field=_FIELD,
    )


def _broken(error: Exception) -> BadRequestError:
    return BadRequestError(
        say("zip.unreadable", error=error or type(error).__name__),
        field=_FIELD,
    )
