"""Uploaded bytes, kept over fsspec: a folder, or a bucket such as ``s3://bucket/logs``. Knows no drive.

A blob appears under its key at once or not at all: it is written under ``incoming/`` and renamed when it is
complete. A process that dies in between leaves a part there that nobody refers to; ``sweep`` removes it.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO, Self

import fsspec

_INCOMING = "incoming"
_KEPT = "drives"
_DATABASES = "databases"


@dataclass(frozen=True)
class StoredBlob:
    """A complete blob: its key, the SHA-256 of its bytes (hex) and their number."""

    key: str
    sha256: str
    size_bytes: int


class BlobStore:
    """Blobs below ``url`` (any fsspec URL; a plain path is a folder). Safe to share between threads."""

    def __init__(self, url: str) -> None:
        """The folder is created when the first blob arrives."""
        self._fs, root = fsspec.core.url_to_fs(url)
        self._root = str(root).rstrip("/")
        self._noted: set[str] = set()

    def writer(self) -> BlobWriter:
        """Begin a blob; write chunks, then ``finish`` it, or leave the ``with`` block to discard it."""
        return BlobWriter(self._fs, self._root)

    def open(self, key: str) -> BinaryIO:
        """The blob's bytes as a file; ``FileNotFoundError`` when there is none."""
        file: BinaryIO = self._fs.open(f"{self._root}/{key}", "rb")
        return file

    def delete(self, key: str) -> None:
        """Remove the blob; one that is not there is no error."""
        _remove(self._fs, f"{self._root}/{key}")

    def keys(self) -> list[str]:
        """The keys of all complete blobs, sorted."""
        return [f"{_KEPT}/{path.rsplit('/', 1)[-1]}" for path in sorted(self._list(_KEPT))]

    def sweep(self, older_than: timedelta = timedelta(days=1)) -> int:
        """Remove parts of uploads that began longer ago than ``older_than``; return how many."""
        limit = datetime.now(UTC) - older_than
        removed = 0
        for path in self._list(_INCOMING):
            if _changed_at(self._fs, path) < limit:
                _remove(self._fs, path)
                removed += 1
        return removed

    def remove_old(self, keys: Iterable[str], older_than: timedelta) -> int:
        """Remove those of the blobs that were completed longer ago than ``older_than``; return how many."""
        limit = datetime.now(UTC) - older_than
        old = [key for key in keys if _changed_at(self._fs, f"{self._root}/{key}") < limit]
        for key in old:
            self.delete(key)
        return len(old)

    def register_database(self, identity: str) -> None:
        """Note that this database refers to blobs here, so that no other takes them for orphans."""
        note = f"{self._root}/{_DATABASES}/{identity}"
        if identity not in self._noted and not self._fs.exists(note):
            self._fs.makedirs(f"{self._root}/{_DATABASES}", exist_ok=True)
            self._fs.pipe_file(note, b"")
        self._noted.add(identity)

    def databases(self) -> list[str]:
        """The paths of the notes of all databases that refer to blobs here, sorted."""
        return sorted(self._list(_DATABASES))

    def _list(self, folder: str) -> list[str]:
        try:
            return [str(path) for path in self._fs.ls(f"{self._root}/{folder}", detail=False, refresh=True)]
        except FileNotFoundError:
            return []


class BlobWriter:
    """One blob on its way in. Use as a context manager; without ``finish`` nothing is left behind.

    How large a blob may become is for whoever writes it to say: ``size_bytes`` is what it has so far.
    """

    def __init__(self, fs: Any, root: str) -> None:
        self._fs = fs
        self._root = root
        self._name = uuid.uuid4().hex
        self._part = f"{root}/{_INCOMING}/{self._name}"
        self._hash = hashlib.sha256()
        self._finished = False
        self.size_bytes = 0
        fs.makedirs(f"{root}/{_INCOMING}", exist_ok=True)
        self._file = fs.open(self._part, "wb")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._finished:
            self.discard()

    def write(self, chunk: bytes) -> None:
        """Append a chunk."""
        self.size_bytes += len(chunk)
        self._hash.update(chunk)
        self._file.write(chunk)

    def finish(self) -> StoredBlob:
        """Complete the blob and give it its key; in a folder it survives a power cut from here on."""
        self._file.flush()
        with contextlib.suppress(io.UnsupportedOperation):  # a bucket sees to that itself
            os.fsync(self._file.fileno())
        self._file.close()
        key = f"{_KEPT}/{self._name}"
        self._fs.makedirs(f"{self._root}/{_KEPT}", exist_ok=True)
        self._fs.mv(self._part, f"{self._root}/{key}")
        self._finished = True
        return StoredBlob(key, self._hash.hexdigest(), self.size_bytes)

    def discard(self) -> None:
        """Forget what was written."""
        self._finished = True
        try:
            self._file.close()
        finally:
            _remove(self._fs, self._part)


def _remove(fs: Any, path: str) -> None:
    try:
        fs.rm_file(path)
    except FileNotFoundError:
        return


def _changed_at(fs: Any, path: str) -> datetime:
    try:
        moment = fs.modified(path)
    except FileNotFoundError:  # finished or discarded while we looked
        return datetime.now(UTC)
    stamp: datetime = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return stamp
