"""The first look at an upload: its first bytes tell, while they arrive, whether its files can be a drive's log.

Knows no request and no store. It holds as much of one file, unpacked, as the library needs to recognise a log. Formats
are loaded when the first file has arrived.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

from fusion.errors import LogError, MalformedLogError
from fusion.formats.container import GZIP_MAGIC, up_to_damage

HEAD_BYTES = 4 << 20
"""As the library's own (a test holds them equal)."""
_EARLY_BYTES = 64 << 10
"""Enough to recognise most logs; a recognised file is not held any longer."""
_LAYERS = 2
_GZIP_WBITS = 31


class FirstLook:
    """Take the pieces of each file of an upload, then ``check`` all of them.

    ``begin`` and ``feed`` each file. One of several files must be a log; files that are none are left out.
    """

    def __init__(self, columns: Mapping[str, str] | None = None) -> None:
        """``columns``: how the files' headers call ours."""
        self._columns = columns or {}
        self._head: _Head | None = None
        self._known = False
        self._files = 0
        self._any_known = False
        self._fault: LogError | None = None

    def begin(self) -> None:
        """The next file; the one before has ended."""
        self._end()
        self._files += 1
        self._head, self._known = _Head(), False

    def feed(self, data: bytes) -> None:
        """The next bytes of the file."""
        if self._head is None:
            return
        before = len(self._head.data)
        self._head.feed(data)
        if before < _EARLY_BYTES <= len(self._head.data):
            self._known = self._fault_of(bytes(self._head.data)) is None
        if self._known:
            self._any_known, self._head = True, None
        elif self._head.full:
            self._end()

    def check(self) -> None:
        """Raise what is wrong with the upload: the ``LogError`` of its first file, if none of them is a log."""
        self._end()
        if self._fault is not None and not self._any_known:
            raise self._fault

    def again(self) -> None:
        """Forget the file: it is a zip, whose files are looked at instead."""
        self._head, self._files, self._any_known, self._fault = None, 0, False, None

    def _end(self) -> None:
        if self._head is None:
            return
        fault = self._head.fault() or self._fault_of(bytes(self._head.data))
        self._head = None
        if fault is None:
            self._any_known = True
        elif self._fault is None:
            self._fault = fault

    def _fault_of(self, head: bytes) -> LogError | None:
        from fusion.formats import refuse_head  # noqa: PLC0415 - with its readers only where something is uploaded

        try:
            # Whether others follow is not known yet, but the first of several may lack what the others have.
            refuse_head(head, part=self._files > 1, columns=self._columns)
        except LogError as error:
            return error
        return None


class _Head:
    """The beginning of a file, unpacked from at most two layers of gzip."""

    def __init__(self, layers: int = _LAYERS) -> None:
        self.data = bytearray()
        self._layers = layers
        self._member: zlib._Decompress | None = None
        self._inner: _Head | None = None
        self._over = False

    @property
    def full(self) -> bool:
        """Whether more bytes change nothing."""
        return self._over or len(self.data) >= HEAD_BYTES

    def feed(self, data: bytes) -> None:
        """Take the next bytes of the file."""
        if self.full:
            return
        if self._inner is None and self._layers and len(self.data) < len(GZIP_MAGIC):
            data, self.data = bytes(self.data) + data, bytearray()
            if data.startswith(GZIP_MAGIC):
                self._inner, self._member = _Head(self._layers - 1), zlib.decompressobj(_GZIP_WBITS)
        if self._inner is not None:
            self._unpack(data)
        else:
            self.data += data[: HEAD_BYTES - len(self.data)]

    def fault(self) -> LogError | None:
        """What is wrong with the packing, if nothing of a log came out of it."""
        if self._inner is not None:
            if not self._inner.data and self._inner._inner is None:
                return MalformedLogError(
                    "The file holds the beginning of a gzip and nothing that can be unpacked. Upload the whole file."
                )
            return self._inner.fault()
        if not self._layers and self.data[:2] == GZIP_MAGIC:
            return MalformedLogError(
                "The file is gzipped more than twice. Unpack it and upload the log itself."
            )
        return None

    def _unpack(self, packed: bytes) -> None:
        assert self._inner is not None  # noqa: S101 - the caller looked
        while packed and self._member is not None and not self._inner.full:
            before = self._member.copy()
            try:
                self._inner.feed(self._member.decompress(packed, HEAD_BYTES))
            except zlib.error:
                self._inner.feed(up_to_damage(before, packed))
                self._member = None
                break
            packed = self._member.unconsumed_tail
            if self._member.eof:
                packed = self._member.unused_data
                self._member = zlib.decompressobj(_GZIP_WBITS) if packed[:2] == GZIP_MAGIC else None
        self.data = self._inner.data
        self._over = self._inner.full or self._member is None
