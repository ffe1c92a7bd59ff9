"""Several files of one upload, sorted into the drives that they are (``fusion.formats.grouping``), a blob for each.

Of each file only the ends are read as a log, so that this takes moments however long the logs are: the service may do
it before it answers, and what it answers names every drive. Knows no request and no SQL. Its calls block.
"""

from __future__ import annotations

import gzip
import hashlib
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, NamedTuple, Protocol, cast

from app.core.blobs import BlobStore, BlobWriter, StoredBlob
from app.core.receiving.body import FILENAME_LENGTH, Piece
from app.drives.receiving.upload_bundle import UploadBundle
from app.drives.receiving.zips import ZipWriter, files_in
from fusion.errors import LogError
from fusion.formats import glance_at, in_short
from fusion.formats.container import CHUNK_BYTES, GZIP_MAGIC, shown_name
from fusion.formats.glance import EXCERPT_BYTES, HEAD_BYTES, Ends, Glance
from fusion.formats.grouping import Grouping, Rule, grouped, why_left, why_repeated

GZIP_LAYERS = 2


class LeftOut(NamedTuple):
    """A file that became no drive's, why (a stable identifier) and the sentence that says so."""

    file: str
    kind: str
    reason: str


class Doubt(NamedTuple):
    """Files that were taken for one drive and could be several, and why: ``continues`` or ``overlaps``."""

    files: tuple[str, ...]
    why: str


class Stored(NamedTuple):
    """The files of one drive to be."""

    blob: StoredBlob
    name: str
    files: tuple[str, ...]
    doubts: tuple[Doubt, ...] = ()


@dataclass(frozen=True)
class Sorted:
    """What came of an upload: at least one drive to be."""

    drives: tuple[Stored, ...]
    left_out: tuple[LeftOut, ...] = ()


class _Looked(NamedTuple):
    """A file in the zip, and what its ends tell."""

    info: zipfile.ZipInfo
    name: str
    glance: Glance


class SortedUpload:
    """Take the pieces of an upload, then ``finish`` it to the drives in it, or ``discard`` it."""

    def __init__(
        self,
        bundle: UploadBundle,
        begin: Callable[[], BlobWriter],
        blobs: BlobStore,
        max_content_bytes: int,
        rule: Rule,
        columns: Mapping[str, str] | None = None,
    ) -> None:
        """``bundle`` receives the files, ``begin`` begins a blob for some of them; ``rule`` as in ``grouping.Rule``."""
        self._bundle, self._begin, self._blobs = bundle, begin, blobs
        self._max_content_bytes, self._rule, self._columns = max_content_bytes, rule, columns or {}

    def take(self, pieces: Iterable[Piece]) -> None:
        """See ``UploadBundle``."""
        self._bundle.take(pieces)

    def discard(self) -> None:
        """See ``UploadBundle``."""
        self._bundle.discard()

    def finish(self) -> Sorted:
        """The drives to be. Raises what ``UploadBundle.finish`` does; nothing stays in the store then."""
        blob, name = self._bundle.finish()
        if not self._bundle.is_zip:
            return Sorted((Stored(blob, name, (name,)),))
        try:
            with self._blobs.open(blob.key) as file, zipfile.ZipFile(file) as archive:
                found = self._sorted(archive, blob, name)
        except BaseException:
            self._blobs.delete(blob.key)
            raise
        if all(drive.blob.key != blob.key for drive in found.drives):
            self._blobs.delete(blob.key)
        return found

    def _sorted(self, archive: zipfile.ZipFile, blob: StoredBlob, name: str) -> Sorted:
        looked, left_out, names = self._look(archive)
        grouping = grouped([one.glance for one in looked], self._rule)
        if len(grouping.drives) <= 1:
            doubts = _doubts(looked, grouping, range(len(looked)))
            used = tuple(one.name for one in looked) or names
            return Sorted((Stored(blob, name, used, doubts),), left_out)
        alone = [looked[k] for k in grouping.left]
        left_out += tuple(LeftOut(one.name, "no-drive", why_left(one.glance)) for one in alone)
        drives = list[Stored]()
        try:
            for numbers in grouping.drives:
                files = [looked[k] for k in numbers]
                doubts = _doubts(looked, grouping, numbers)
                shown = tuple(one.name for one in files)
                drives.append(
                    Stored(self._store(archive, files), ", ".join(shown)[:FILENAME_LENGTH], shown, doubts)
                )
        except BaseException:
            for drive in drives:
                self._blobs.delete(drive.blob.key)
            raise
        return Sorted(tuple(drives), left_out)

    def _look(self, archive: zipfile.ZipFile) -> tuple[list[_Looked], tuple[LeftOut, ...], tuple[str, ...]]:
        """Each file that may be a log; those that are none or come twice; and the names of all."""
        looked, left_out, names, seen = list[_Looked](), list[LeftOut](), list[str](), dict[str, str]()
        bytes_left = self._max_content_bytes
        for info in files_in(archive):
            name = shown_name(info.filename)
            names.append(name)
            if bytes_left <= 0:  # as of gzips that unpack to more: whoever reads them says that
                looked.append(_Looked(info, name, Glance(is_unread=True)))
                continue
            with archive.open(info) as stream:
                ends, digest = _ends(stream, bytes_left)
            bytes_left -= ends.size
            if digest in seen:
                left_out.append(LeftOut(name, "repeated", why_repeated(seen[digest])))
                continue
            seen[digest] = name
            try:
                glance = glance_at(ends, name, self._columns)
            except LogError as error:
                left_out.append(LeftOut(name, error.kind, in_short(error)))
                continue
            looked.append(_Looked(info, name, glance))
        return looked, tuple(left_out), tuple(names)

    def _store(self, archive: zipfile.ZipFile, files: Sequence[_Looked]) -> StoredBlob:
        """One file as it is, several as a zip of their own."""
        with self._begin() as writer:
            if len(files) == 1:
                _copy(archive, files[0].info, writer)
                return writer.finish()
            packed = ZipWriter(writer.write, self._max_content_bytes)
            try:
                for one in files:
                    packed.begin(one.name)
                    _copy(archive, one.info, packed)
                return writer.finish(packed.finish())
            except BaseException:
                packed.drop()
                raise


class _Sink(Protocol):
    def write(self, data: bytes, /) -> object:
        """The next bytes."""


def _copy(archive: zipfile.ZipFile, info: zipfile.ZipInfo, sink: _Sink) -> None:
    with archive.open(info) as stream:
        while piece := stream.read(CHUNK_BYTES):
            sink.write(piece)


def _ends(stream: IO[bytes], max_bytes: int) -> tuple[Ends, str]:
    """The ends of what a file unpacks to, and the digest of all of it: up to damage, and to ``max_bytes``."""
    head, tail, size, digest = bytearray(), b"", 0, hashlib.sha256()
    try:
        stream = _unpacked(stream)
        while size < max_bytes and (piece := stream.read(CHUNK_BYTES)):
            size += len(piece)
            digest.update(piece)
            room = HEAD_BYTES - len(head)
            head += piece[:room]
            tail = (tail + piece[room:])[-EXCERPT_BYTES:]
    except (gzip.BadGzipFile, EOFError, zlib.error):
        pass  # whoever reads all of it says what is wrong with it
    return Ends(bytes(head), tail, size), digest.hexdigest()


def _unpacked(stream: IO[bytes]) -> IO[bytes]:
    for _ in range(GZIP_LAYERS):
        if cast("_Peeking", stream).peek(len(GZIP_MAGIC))[: len(GZIP_MAGIC)] != GZIP_MAGIC:
            break
        stream = cast("IO[bytes]", gzip.GzipFile(fileobj=stream))
    return stream


class _Peeking(Protocol):
    def peek(self, n: int, /) -> bytes:
        """The next bytes, which stay."""


def _doubts(looked: Sequence[_Looked], grouping: Grouping, numbers: Iterable[int]) -> tuple[Doubt, ...]:
    own = set(numbers)
    return tuple(
        Doubt(tuple(looked[k].name for k in one.files), one.why.value)
        for one in grouping.unclear
        if own.issuperset(one.files)
    )
