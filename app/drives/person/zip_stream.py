"""A ZIP archive written piece by piece to somebody who reads as slowly as they like: neither on disk nor in memory.

Sizes and checksums follow each file (a "data descriptor"), since nothing is known of it before it has been read. What
memory holds is a piece, and half a kilobyte of each file: a ZIP ends with the list of all.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

PIECE_BYTES = 256 * 1024
_OWNERS_ALONE = 0o600 << 16


class ZipStream:
    """An archive on its way out: ``add`` and ``end`` give its bytes."""

    def __init__(self, moment: datetime) -> None:
        """``moment``: the time of all files."""
        self._sink = _Sink()
        self._zip = zipfile.ZipFile(self._sink, "w")
        self._time = moment.astimezone(UTC).timetuple()[:6]

    def add(self, name: str, chunks: Iterable[bytes], size_bytes: int | None = None) -> Iterator[bytes]:
        """A file. One whose size is known is stored as it is: logs come compressed, or are to be had byte for byte."""
        info = zipfile.ZipInfo(name, self._time)
        info.external_attr = _OWNERS_ALONE
        info.compress_type = zipfile.ZIP_DEFLATED if size_bytes is None else zipfile.ZIP_STORED
        info.file_size = size_bytes or 0  # from 4 GiB on the format is another one
        with self._zip.open(info, "w") as file:
            for chunk in chunks:
                file.write(chunk)
                if self._sink.size_bytes >= PIECE_BYTES:
                    yield self._sink.take()

    def end(self) -> bytes:
        """What is left, and the list of all files."""
        self._zip.close()
        return self._sink.take()


class _Sink:
    """What the archive is written to. It has no positions, by which ``zipfile`` knows that it cannot go back."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self.size_bytes = 0

    def write(self, piece: bytes) -> int:
        self._pieces.append(bytes(piece))
        self.size_bytes += len(piece)
        return len(piece)

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing is open."""

    def take(self) -> bytes:
        taken = b"".join(self._pieces)
        self._pieces, self.size_bytes = [], 0
        return taken
