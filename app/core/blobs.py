"""Uploaded bytes, kept over fsspec: a folder, or a bucket such as ``s3://bucket/logs``. Knows no drive.

Where there is no room for them the error is ``StorageFullError``.

A blob appears under its key at once or not at all: it is written under ``incoming/`` and renamed when it is
complete. A process that dies in between leaves a part there that nobody refers to; ``sweep`` removes it.
"""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, BinaryIO, Self

from fsspec.spec import AbstractBufferedFile

from app.core import filesystems as files
from app.core.content import ContentHash

BLOCK_BYTES = 8 * 2**20
"""What is collected for one request to a bucket; ten thousand such are a blob."""
MAX_CONTENT_BYTES = 512 * 2**20

UNKNOWN_DATABASE = "unknown"
NOTED_WITHIN = timedelta(hours=1)
"""The first upload's blob is there before its database is noted."""

LOGS, EXPORTS, IMPORTS, EDITIONS = "drives", "exports", "imports", "editions"
"""Sections of a store: logs of drives, files that were made for somebody, files that the operator imports, and folders
of files that are everybody's."""

_DATABASES = "databases"


@dataclass(frozen=True)
class StoredBlob:
    """A complete blob: its key, the SHA-256 of its bytes (hex) and their number.

    ``content_sha256`` is of what the bytes unpack to (``app.core.content``), or what their writer said.
    """

    key: str
    sha256: str
    size_bytes: int
    content_sha256: str


class BlobStore:
    """Blobs below ``url`` (any fsspec URL; a plain path is a folder). Safe to share between threads."""

    def __init__(self, url: str, section: str = LOGS) -> None:
        """The folder is created when the first blob arrives. ``section``: of the store; only its blobs are
        listed.
        """
        self._fs, self._root = files.file_system(url)
        self._section = section
        self._noted: set[str] = set()

    def writer(
        self, *, keep_free_bytes: int = 0, expected_bytes: int = 0, max_content_bytes: int = MAX_CONTENT_BYTES
    ) -> BlobWriter:
        """Begin a blob; write chunks, then ``finish`` it, or leave the ``with`` block to discard it.

        ``StorageFullError`` as soon as less than ``keep_free_bytes`` would stay free, at once where ``expected_bytes``
        are too many already. What unpacks to more than ``max_content_bytes`` counts as its own content.
        """
        return BlobWriter(self, keep_free_bytes, expected_bytes, max_content_bytes)

    def free_bytes(self) -> int | None:
        """Free room for blobs, bytes; None where it is unknown, as of a bucket."""
        return files.free_bytes(self._fs, self._root)

    def probe(self) -> None:
        """Write a few bytes and remove them again: raises what an upload would meet."""
        path = f"{self._root}/{files.INCOMING}/{uuid.uuid4().hex}"
        files.make_folder(self._fs, f"{self._root}/{files.INCOMING}")
        try:
            self._fs.pipe_file(path, b"ready")
        finally:
            files.remove_file(self._fs, path)

    def exists(self, key: str) -> bool:
        """Whether the blob is there."""
        return bool(self._fs.exists(f"{self._root}/{key}"))

    def open(self, key: str, block_bytes: int | None = None) -> BinaryIO:
        """The blob's bytes as a file; ``FileNotFoundError`` when there is none.

        ``block_bytes``: so much is fetched of a bucket at once.
        """
        file: BinaryIO = self._fs.open(f"{self._root}/{key}", "rb", block_size=block_bytes)
        return file

    def take(self, key: str, path: Path) -> bool:
        """Store a file as a blob of this key, as a backup brings it back; whether it was not there yet.

        One that is there stays: blobs never change.
        """
        if self.exists(key):
            return False
        with files.full_is_told():
            files.put_file(self._fs, self._root, path, key)
        return True

    def delete(self, key: str) -> None:
        """Remove the blob; one that is not there is no error."""
        files.remove_file(self._fs, f"{self._root}/{key}")

    def delete_folder(self, key: str) -> None:
        """Remove all blobs whose keys begin with this one and a slash; none is no error."""
        with contextlib.suppress(FileNotFoundError):
            self._fs.rm(f"{self._root}/{key}", recursive=True)

    def keys(self) -> list[str]:
        """The keys of all complete blobs, sorted; of blobs in folders those of the folders."""
        return [f"{self._section}/{path.rsplit('/', 1)[-1]}" for path in sorted(self._list(self._section))]

    def sweep(self, older_than: timedelta = timedelta(days=1)) -> int:
        """Remove parts of uploads that began longer ago than ``older_than``; return how many."""
        limit = datetime.now(UTC) - older_than
        old = [path for path in self._list(files.INCOMING) if _changed_at(self._fs, path) < limit]
        for path in old:
            files.remove_file(self._fs, path)
        return len(old)

    def older(self, keys: Iterable[str], than: timedelta) -> list[str]:
        """Those of the blobs that were completed longer ago than that."""
        limit = datetime.now(UTC) - than
        return [key for key in keys if _changed_at(self._fs, f"{self._root}/{key}") < limit]

    def register_database(self, identity: str) -> None:
        """Note that this database refers to blobs here, so that no other takes them for orphans.

        Blobs without any note are of unknown databases: that is noted as well.
        """
        if identity in self._noted:
            return
        registered = self.databases()
        if identity not in registered:
            if not registered and self.older(self.keys(), NOTED_WITHIN):
                self._note(UNKNOWN_DATABASE)
            self._note(identity)
        self._noted.add(identity)

    def databases(self) -> list[str]:
        """The identities of all databases that refer to blobs here, sorted."""
        return sorted(path.rsplit("/", 1)[-1] for path in self._list(_DATABASES))

    def forget_databases(self, but: str) -> None:
        """Forget all databases that refer to blobs here, except this one."""
        for identity in self.databases():
            if identity != but:
                files.remove_file(self._fs, f"{self._root}/{_DATABASES}/{identity}")

    def _note(self, identity: str) -> None:
        with files.full_is_told():
            files.make_folder(self._fs, f"{self._root}/{_DATABASES}")
            self._fs.pipe_file(f"{self._root}/{_DATABASES}/{identity}", b"")

    def _list(self, folder: str) -> list[str]:
        try:
            return [str(path) for path in self._fs.ls(f"{self._root}/{folder}", detail=False, refresh=True)]
        except FileNotFoundError:
            return []


class BlobWriter:
    """One blob on its way in. Use as a context manager; without ``finish`` nothing is left behind.

    The writer's user limits its size: ``size_bytes`` counts what was written so far.
    """

    def __init__(
        self, store: BlobStore, keep_free_bytes: int, expected_bytes: int, max_content_bytes: int
    ) -> None:
        self._fs, self._root, self._section = store._fs, store._root, store._section
        self._keep_free_bytes = keep_free_bytes
        self._name = uuid.uuid4().hex
        self._part = f"{self._root}/{files.INCOMING}/{self._name}"
        self._hash = ContentHash(max_content_bytes)
        self._finished = self._closed = False
        self.size_bytes = 0
        self.require_room(expected_bytes)
        with files.full_is_told():
            files.make_folder(self._fs, f"{self._root}/{files.INCOMING}")
            self._file = self._fs.open(self._part, "wb", block_size=BLOCK_BYTES)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._finished:
            self.discard()

    def write(self, chunk: bytes) -> None:
        """Append a chunk."""
        self.require_room(len(chunk))
        self.size_bytes += len(chunk)
        self._hash.update(chunk)
        with files.full_is_told():
            self._file.write(chunk)

    def require_room(self, size_bytes: int) -> None:
        """``StorageFullError`` unless the room to keep free remains after ``size_bytes`` more."""
        free = files.free_bytes(self._fs, self._root) if self._keep_free_bytes else None
        if free is not None and free < self._keep_free_bytes + size_bytes:
            raise files.storage_full()

    def reopened(self) -> BinaryIO:
        """What was written, to be read before it is finished or discarded; nothing can be written any more."""
        self._close()
        file: BinaryIO = self._fs.open(self._part, "rb")
        return file

    def finish(self, content_sha256: str | None = None) -> StoredBlob:
        """Complete the blob and give it its key; in a folder it survives a power cut from here on.

        ``content_sha256`` takes the place of what ``ContentHash`` computes, as for a zip.
        """
        key = f"{self._section}/{self._name}"
        self._close()
        with files.full_is_told():
            files.complete(self._fs, self._part, f"{self._root}/{key}")
        self._finished = True
        content = content_sha256 or self._hash.content_sha256()
        return StoredBlob(key, self._hash.sha256(), self.size_bytes, content)

    def discard(self) -> None:
        """Forget what was written."""
        self._finished = True
        try:
            if not self._closed:
                with contextlib.suppress(OSError):  # what is still buffered finds no room now either
                    _drop(self._file)
        finally:
            files.remove_file(self._fs, self._part)

    def _close(self) -> None:
        if self._closed:
            return
        with files.full_is_told():
            self._file.close()
        self._closed = True


def _drop(file: Any) -> None:
    """Close a file that is not wanted; one on its way to a bucket would be completed by that."""
    if isinstance(file, AbstractBufferedFile):
        file.discard()
        file.closed = True
    else:
        file.close()


def _changed_at(fs: Any, path: str) -> datetime:
    try:
        return files.modified_at(fs, path)
    except FileNotFoundError:  # finished or discarded while we looked
        return datetime.now(UTC)
