"""The files in a folder or a zip, those in zips in it as well, one after the other: within bounds, nothing kept.

A zip may come from a stranger. What it says of the sizes of its files is not believed: whoever reads one stops at a
size of its own. Zips in zips are unpacked to a temporary file, up to ``MOST_DEPTH`` below each other and
``MOST_NESTED_BYTES`` each.
"""

from __future__ import annotations

import re
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import IO

from fusion.errors import LogError, MalformedLogError, UnknownFormatError
from fusion.formats.container import (
    CHUNK_BYTES,
    OTHER_DOCUMENTS,
    is_zip,
    most_unpacked,
    shown_name,
    why_unread,
)
from fusion.messages import say

MOST_DEPTH = 3
"""A zip in a zip in a zip: an export of exports. What lies deeper is told and not opened."""
MOST_NESTED_BYTES = 4 << 30
SPOOLED_BYTES = 64 << 20
"""A zip in a zip is held in memory up to this size."""
MOST_FILES = 200_000
"""More than anybody's rides."""
_ADDED = re.compile(r"(^|/)(__MACOSX|\.[^/]*|Thumbs\.db|desktop\.ini|@eaDir)(/|$)")
"""Hidden files, and what systems add of their own."""
BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    ValueError,
    NotImplementedError,
    OverflowError,
    RuntimeError,
)


@dataclass(frozen=True)
class File:
    """One file: its ``name`` with the folders and zips that it lies in, how many bytes it is said to have, and how it
    is opened while the walk stands at it. ``path``: where it lies in a folder. ``fault``: why it is not read.
    """

    name: str
    size: int
    open: Callable[[], AbstractContextManager[IO[bytes]]]
    path: Path | None = None
    fault: LogError | None = None

    @property
    def folder(self) -> str:
        """The folder or the zip that it lies in, empty for the outermost: files of one folder may be one drive."""
        return str(PurePosixPath(self.name).parent).removesuffix(".")

    @property
    def own_name(self) -> str:
        """Without them, fit to be shown."""
        return shown_name(self.name)


def files_in(root: Path) -> Iterator[File]:
    """Every file below a folder, or in a zip, in the order of names, or a file itself; each is to be read before the
    next is asked for. No two have the same name: a zip may hold one twice.

    Raises ``OSError`` where there is nothing, ``MalformedLogError`` for more files than ``MOST_FILES``.
    """
    found = _in_folder(root) if root.is_dir() else _on_disk(root, root.name, "")
    names = Counter[str]()
    for count, file in enumerate(found):
        if count == MOST_FILES:
            raise MalformedLogError(say("zip.too_many", n=count + 1, most=MOST_FILES))
        names[file.name] += 1
        again = names[file.name]
        yield file if again == 1 else replace(file, name=f"{file.name} ({again})")


def bytes_in(root: Path) -> int:
    """About how many bytes the files below a folder or in a zip have: what a progress bar counts to."""
    if root.is_dir():
        return sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    try:
        with zipfile.ZipFile(root) as archive:
            return sum(info.file_size for info in archive.infolist())
    except (*BROKEN, OSError):
        return root.stat().st_size


def _in_folder(root: Path) -> Iterator[File]:
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        if _ADDED.search(name) or not path.is_file():
            continue
        try:
            yield from _on_disk(path, name, f"{name}/")
        except OSError as error:
            fault = LogError(say("log.unreadable", reason=error.strerror or error))
            yield File(name, 0, _opener(path), path, fault)


def _on_disk(path: Path, name: str, before: str) -> Iterator[File]:
    """A file, or those in it where it is a zip: their names begin with ``before``."""
    with path.open("rb") as opened:
        head = opened.read(4)
    file = File(name, path.stat().st_size, _opener(path), path)
    yield from _zip_or_file(file, path, 1, before) if is_zip(head) else (file,)


def _opener(path: Path) -> Callable[[], AbstractContextManager[IO[bytes]]]:
    return lambda: path.open("rb")


def _zip_or_file(file: File, source: Path | IO[bytes], depth: int, before: str) -> Iterator[File]:
    """The files in a zip that lies among others; itself where it is another kind of document, or cannot be read."""
    try:
        if depth > MOST_DEPTH:
            raise MalformedLogError(say("archive.too_deep", most=MOST_DEPTH))
        yield from _in_zip(source, before, depth)
    except LogError as error:
        yield File(file.name, file.size, file.open, file.path, error)


def _in_zip(source: Path | IO[bytes], before: str, depth: int) -> Iterator[File]:
    try:
        archive = zipfile.ZipFile(source)
    except BROKEN as error:
        raise MalformedLogError(say("archive.broken_zip", error=error or type(error).__name__)) from error
    with archive:
        infos = [one for one in archive.infolist() if not one.is_dir()]
        if any(one.filename in OTHER_DOCUMENTS for one in infos):
            raise UnknownFormatError(say("archive.document"))
        for info in sorted(infos, key=lambda one: one.filename):
            name = info.filename.replace("\\", "/").lstrip("/")
            if not _ADDED.search(name):
                yield from _member(archive, info, f"{before}{name}", depth)


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, depth: int) -> Iterator[File]:
    def opened() -> AbstractContextManager[IO[bytes]]:
        return closing(archive.open(info))

    why = why_unread(info)
    fault = LogError(why) if why else None
    file = File(name, info.file_size, opened, None, fault)
    if fault is not None:
        yield file
        return
    try:
        with opened() as stream:
            nested = is_zip(stream.read(4))
    except (*BROKEN, OSError):
        nested = False  # whoever reads it says what is wrong
    if not nested:
        yield file
    elif depth >= MOST_DEPTH:
        yield File(
            name, info.file_size, opened, None, MalformedLogError(say("archive.too_deep", most=MOST_DEPTH))
        )
    else:
        yield from _nested(file, info, depth)


def _nested(file: File, info: zipfile.ZipInfo, depth: int) -> Iterator[File]:
    """The files in a zip in a zip: it is unpacked, for its contents stand at its end."""
    with tempfile.SpooledTemporaryFile(SPOOLED_BYTES) as unpacked:
        try:
            with file.open() as stream:
                copy_within(stream, unpacked.write, MOST_NESTED_BYTES, info.compress_size)
        except LogError as error:
            yield File(file.name, file.size, file.open, None, error)
            return
        yield from _zip_or_file(file, unpacked, depth + 1, f"{file.name}/")


def copy_within(
    stream: IO[bytes], write: Callable[[bytes], object], most_bytes: int, packed_bytes: int
) -> None:
    """Copy what a file in a zip unpacks to; ``MalformedLogError`` for one that is damaged, too large, or a bomb."""
    size = 0
    try:
        while piece := stream.read(CHUNK_BYTES):
            size += len(piece)
            if size > min(most_bytes, most_unpacked(packed_bytes)):
                raise MalformedLogError(say("archive.large_zip", most=most_bytes))
            write(piece)
    except BROKEN as error:
        raise MalformedLogError(say("archive.broken_zip", error=error or type(error).__name__)) from error
