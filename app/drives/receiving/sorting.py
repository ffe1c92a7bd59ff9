"""Several files of one upload, sorted into the drives that they are (``fusion.formats.grouping``), a blob for each.

Of each file only the ends are read as a log, so that this takes moments however long the logs are: the service may do
it before it answers, and what it answers names every drive. Knows no request and no SQL. Its calls block.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import NamedTuple, Protocol, cast

from app.core.blobs import BlobStore, BlobWriter, StoredBlob
from app.core.messages import say
from app.core.receiving.body import FILENAME_LENGTH, Piece
from app.drives.receiving.upload_bundle import UploadBundle
from app.drives.receiving.zips import ZipWriter, files_in
from fusion.errors import NotOnRoadsError
from fusion.formats.archives.look import Kind, Looked, Looker, ends_of
from fusion.formats.archives.sheets import is_list, sports_of
from fusion.formats.container import CHUNK_BYTES, shown_name
from fusion.formats.glance import Glance
from fusion.formats.grouping import Grouping, Rule, grouped, why_left, why_repeated

NO_BOUND = 1 << 62
"""Of a file's size here: what it unpacks to is bounded where it is read."""


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
        sports: Collection[str] | None = None,
    ) -> None:
        """``bundle`` receives the files, ``begin`` begins a blob for some of them; ``rule`` as in ``grouping.Rule``.

        ``sports``: files that tell of another are left out; None: none is.
        """
        self._bundle, self._begin, self._blobs = bundle, begin, blobs
        self._max_content_bytes, self._rule = max_content_bytes, rule
        self._looker = Looker(sports, columns or {}, NO_BOUND)

    def take(self, pieces: Iterable[Piece]) -> None:
        """See ``UploadBundle``."""
        self._bundle.take(pieces)

    def discard(self) -> None:
        """See ``UploadBundle``."""
        self._bundle.discard()

    def finish(self) -> Sorted:
        """The drives to be. Raises what ``UploadBundle.finish`` does, and ``NotOnRoadsError`` where all of them are of
        other sports; nothing stays in the store then."""
        blob, name = self._bundle.finish()
        try:
            if not self._bundle.is_zip:
                self._require_sport(blob, name)
                return Sorted((Stored(blob, name, (name,)),))
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
        others = [one for one in left_out if one.kind == Kind.NOT_ON_ROADS]
        if others and not looked:
            raise NotOnRoadsError(others[0].reason)
        grouping = grouped([one.glance for one in looked], self._rule)
        if len(grouping.drives) <= 1 and not others:
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

    def _require_sport(self, blob: StoredBlob, name: str) -> None:
        if self._looker.sports is None:
            return
        with self._blobs.open(blob.key) as file:
            reader = io.BufferedReader(cast("io.RawIOBase", file))
            try:
                looked = self._looker.judged(*ends_of(reader, self._max_content_bytes), name)
            finally:
                reader.detach()  # the block closes what is below
        if looked.kind is Kind.NOT_ON_ROADS:
            raise NotOnRoadsError(looked.reason)

    def _look(self, archive: zipfile.ZipFile) -> tuple[list[_Looked], tuple[LeftOut, ...], tuple[str, ...]]:
        """Each file that may be a log; those that are none or come twice; and the names of all."""
        found, names, seen = list[tuple[zipfile.ZipInfo, Looked]](), list[str](), dict[str, str]()
        sports: dict[str, str] = {}
        bytes_left = self._max_content_bytes
        for info in files_in(archive):
            name = shown_name(info.filename)
            names.append(name)
            if bytes_left <= 0:  # as of gzips that unpack to more: whoever reads them says that
                found.append((info, Looked(name, Kind.DRIVE, glance=Glance(is_unread=True))))
                continue
            with archive.open(info) as stream:
                ends, digest = ends_of(stream, bytes_left)
            bytes_left -= ends.size
            if digest in seen:
                looked = Looked(name, Kind.REPEATED, why_repeated(seen[digest]))
            elif self._looker.sports is not None and is_list(ends.head):
                sports |= {PurePosixPath(file).name: sport for file, sport in sports_of(ends.head).items()}
                looked = Looked(name, Kind.NOT_A_LOG, say("archive.list"))
            else:
                looked = self._looker.judged(ends, digest, name)
            seen.setdefault(digest, name)
            found.append((info, looked))
        told = [(info, self._looker.of_sport(one, sports.get(one.name, ""))) for info, one in found]
        drives = [_Looked(info, one.name, one.glance) for info, one in told if one.kind is Kind.DRIVE]
        left = [
            LeftOut(one.name, one.kind.value, one.reason) for _, one in told if one.kind is not Kind.DRIVE
        ]
        return drives, tuple(left), tuple(names)

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


def _doubts(looked: Sequence[_Looked], grouping: Grouping, numbers: Iterable[int]) -> tuple[Doubt, ...]:
    own = set(numbers)
    return tuple(
        Doubt(tuple(looked[k].name for k in one.files), one.why.value)
        for one in grouping.unclear
        if own.issuperset(one.files)
    )
