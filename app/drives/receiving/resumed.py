"""Uploads that come in parts, over hours and many connections: the parts lie in the store until all have come.

Each part is a file of its own, ``incoming/resumed.OWNER.ID.OFFSET``: a bucket cannot append, and several processes may
answer. A part appears when its connection has ended, however it did: what came of it is kept. What the upload is to be
lies beside it, and so does its answer, once it has one. An upload that is not over within a day is swept as parts of
others are. Knows no request, no drive and no SQL. Its calls block.
"""

from __future__ import annotations

import json
import secrets
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, BinaryIO

from app.core import filesystems as files
from app.core.errors import NotFoundError, TooManyError
from app.core.messages import say

MOST_OPEN = 16
"""Of one owner at once."""
MOST_ENDED = 100
"""The answers of so many are kept, of each owner: those of the last."""
MOST_PARTS = 1000
"""Of one upload: each is a file, and all are listed at each request."""
KEPT = timedelta(days=1)
READ_BYTES = 1 << 20
_PREFIX = "resumed"


@dataclass(frozen=True)
class Asked:
    """What an upload is to be: ``size_bytes`` of a file, and how it is computed."""

    size_bytes: int
    filename: str
    method: str
    options: dict[str, Any]
    grouping: str
    sports: list[str] | None = None
    begun_at: str = field(default_factory=lambda: datetime.now(UTC).isoformat())

    @property
    def ends_at(self) -> datetime:
        """When it is forgotten."""
        return datetime.fromisoformat(self.begun_at) + KEPT


class ResumedUploads:
    """Those of one owner, in the store below ``url`` (``BlobStore`` has the same)."""

    def __init__(self, url: str, owner: int | None, keep_free_bytes: int = 0) -> None:
        """``keep_free_bytes``: ``StorageFullError`` as soon as less would stay free of a folder's disk."""
        self._fs, root = files.file_system(url)
        self._folder, self._keep_free_bytes = f"{root}/{files.INCOMING}", keep_free_bytes
        self._before = f"{_PREFIX}.{owner or 0}."

    def begin(self, asked: Asked) -> str:
        """A new one; its id, which nobody can guess. ``TooManyError`` where the owner has as many as it may."""
        names = self._names("")
        begun, ended = (
            {name.partition(".")[0] for name in names if name.endswith(end)} for end in (".asked", ".answer")
        )
        since = {upload: self._begun_at(upload) for upload in begun}
        forgotten = {upload for upload, begun_at in since.items() if begun_at is None}
        latest = sorted(ended & begun - forgotten, key=lambda upload: since[upload] or "")
        for upload in forgotten.union(latest[:-MOST_ENDED]):
            self.remove(upload)
        if len(begun - ended - forgotten) >= MOST_OPEN:
            raise TooManyError(say("resumed.many", most=MOST_OPEN))
        upload = secrets.token_hex(16)
        files.make_folder(self._fs, self._folder)
        self._write(f"{upload}.asked", asdict(asked))
        return upload

    def asked(self, upload: str) -> Asked:
        """What it is to be; ``NotFoundError`` where there is none of the owner's, or its time is over."""
        found = self._read(f"{upload}.asked") if upload.isalnum() else None
        if found is None or Asked(**found).ends_at < datetime.now(UTC):
            raise NotFoundError(say("resumed.none", id=upload[:40]))
        return Asked(**found)

    def offset(self, upload: str) -> int:
        """How many bytes have come, one after the other."""
        return sum(size for _, size in self._parts(upload))

    def answer(self, upload: str) -> dict[str, Any] | None:
        """What came of it; None before it is over."""
        return self._read(f"{upload}.answer")

    def end(self, upload: str, answer: dict[str, Any]) -> None:
        """All has come, and became that: the bytes are not needed any more."""
        self._write(f"{upload}.answer", answer)
        for path, _ in self._parts(upload):
            files.remove_file(self._fs, path)

    def remove(self, upload: str) -> None:
        """Forget all of it."""
        for name in self._names(upload):
            files.remove_file(self._fs, f"{self._folder}/{self._before}{name}")

    def part(self, upload: str, offset: int) -> PartWriter:
        """Write the bytes from there on; ``TooManyError`` where it came in too many parts already."""
        parts = self._parts(upload)
        if len(parts) >= MOST_PARTS and sum(size for _, size in parts) < self.asked(upload).size_bytes:
            raise TooManyError(say("resumed.parts", most=MOST_PARTS))
        return PartWriter(
            self._fs, f"{self._folder}/{self._before}{upload}.{offset:015d}", self._keep_free_bytes
        )

    def data(self, upload: str) -> Iterator[bytes]:
        """All bytes, in pieces."""
        for path, _ in self._parts(upload):
            with self._fs.open(path, "rb") as file:
                while piece := file.read(READ_BYTES):
                    yield piece

    def _parts(self, upload: str) -> list[tuple[str, int]]:
        """Path and size of each part that follows on those before it."""
        sizes = {}
        for name in self._names(upload):
            offset = name.rpartition(".")[2]
            path = f"{self._folder}/{self._before}{name}"
            if offset.isdigit():
                with suppress(FileNotFoundError):
                    sizes[int(offset)] = (path, int(self._fs.size(path)))
        found, at = list[tuple[str, int]](), 0
        while at in sizes:
            found.append(sizes[at])
            at += sizes[at][1]
        return found

    def _names(self, upload: str) -> list[str]:
        """Of the files of an upload, or of all: id and what follows it."""
        before = f"{self._before}{upload}"
        try:
            paths = self._fs.ls(self._folder, detail=False, refresh=True)
        except FileNotFoundError:
            return []
        names = (str(path).rpartition("/")[2] for path in paths)
        return [name.removeprefix(self._before) for name in names if name.startswith(before)]

    def _begun_at(self, upload: str) -> str | None:
        """None: its time is over."""
        try:
            return self.asked(upload).begun_at
        except NotFoundError:
            return None

    def _read(self, name: str) -> dict[str, Any] | None:
        try:
            found: dict[str, Any] = json.loads(self._fs.cat_file(f"{self._folder}/{self._before}{name}"))
        except FileNotFoundError:
            return None
        return found

    def _write(self, name: str, document: dict[str, Any]) -> None:
        part = f"{self._folder}/{uuid.uuid4().hex}"
        with files.full_is_told():
            self._fs.pipe_file(part, json.dumps(document, default=str).encode())
            files.complete(self._fs, part, f"{self._folder}/{self._before}{name}")


class PartWriter:
    """One part on its way in: ``write``, then ``keep`` what came, or ``drop`` it."""

    def __init__(self, fs: Any, path: str, keep_free_bytes: int = 0) -> None:
        self._fs, self._path, self._keep_free_bytes = fs, path, keep_free_bytes
        self._temporary = f"{path.rpartition('/')[0]}/{uuid.uuid4().hex}"
        with files.full_is_told():
            self._file: BinaryIO = fs.open(self._temporary, "wb")
        self.size_bytes = 0

    def write(self, data: bytes) -> None:
        """The next bytes."""
        free = files.free_bytes(self._fs, self._path) if self._keep_free_bytes else None
        if free is not None and free < self._keep_free_bytes + len(data):
            raise files.storage_full()
        with files.full_is_told():
            self._file.write(data)
        self.size_bytes += len(data)

    def keep(self) -> bool:
        """Give it its place; whether nobody else was faster, who sent the same bytes."""
        with files.full_is_told():
            self._file.close()
            if not self.size_bytes or self._fs.exists(self._path):
                files.remove_file(self._fs, self._temporary)
                return not self.size_bytes
            files.complete(self._fs, self._temporary, self._path)
        return True

    def drop(self) -> None:
        """Forget it."""
        with suppress(OSError):
            self._file.close()
        files.remove_file(self._fs, self._temporary)
