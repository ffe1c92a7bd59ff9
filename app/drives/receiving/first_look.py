"""The first look at an upload: its first bytes tell, while they arrive, whether its files can be a drive's log.

Knows no request and no store. It holds as much of one file as the library needs to recognise a log. Formats are loaded
when the first file has arrived.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

from app.core.messages import say
from fusion.errors import LogError, MalformedLogError
from fusion.formats.container import GZIP_MAGIC, up_to_damage

HEAD_BYTES = 4 << 20
"""As the library's own (a test holds them equal)."""
_HELD_BYTES = HEAD_BYTES + (64 << 10)
"""Of one file: a gzip of what cannot be compressed is a little longer than that."""
_EARLY_BYTES = 64 << 10
"""Enough to recognise most logs; a recognised file is not held any longer."""
_STEP_BYTES = 64 << 10
"""Unpacked at a time: zlib copies what follows each of many small members."""
_LAYERS = 2
_GZIP_WBITS = 31


class FirstLook:
    """Take the pieces of each file of an upload, then ``check`` all of them.

    ``begin`` and ``feed`` each file. One of several files must be a log; files that are none are left out.
    """

    def __init__(self, columns: Mapping[str, str] | None = None) -> None:
        """``columns``: how the files' headers call ours."""
        self.columns = columns or {}
        self._head: bytearray | None = None
        self._files = 0
        self._any_known = False
        self._fault: LogError | None = None

    def begin(self) -> None:
        """The next file; the one before has ended."""
        self._end()
        self._files += 1
        self._head = bytearray()

    def feed(self, data: bytes) -> None:
        """The next bytes of the file."""
        if self._head is None:
            return
        before = len(self._head)
        self._head += data[: _HELD_BYTES - before]
        if before < _EARLY_BYTES <= len(self._head) and self._fault_of(bytes(self._head)) is None:
            self._any_known, self._head = True, None
        elif len(self._head) == _HELD_BYTES:
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
        fault = self._fault_of(bytes(self._head))
        self._head = None
        if fault is None:
            self._any_known = True
        elif self._fault is None:
            self._fault = fault

    def _fault_of(self, head: bytes) -> LogError | None:
        from fusion.formats import refuse_head  # noqa: PLC0415 - with its readers only where something is uploaded

        try:
            # Whether others follow is not known yet, but the first of several may lack what the others have.
            refuse_head(unpacked(head), part=self._files > 1, columns=self.columns)
        except LogError as error:
            return error
        return None


def unpacked(head: bytes) -> bytes:
    """What the beginning of a file unpacks to, at most ``HEAD_BYTES``; ``MalformedLogError`` where that is no log's."""
    for _ in range(_LAYERS):
        if not head.startswith(GZIP_MAGIC):
            break
        head = _gunzipped(head)
        if not head:
            raise MalformedLogError(say("gzip.nothing_unpacked"))
    if head.startswith(GZIP_MAGIC):
        raise MalformedLogError(say("gzip.nested"))
    return head[:HEAD_BYTES]


def _gunzipped(packed: bytes) -> bytes:
    """The members of a gzip one after the other, up to where it ends or is damaged, or there is enough."""
    unpacked, at, view = bytearray(), 0, memoryview(packed)
    while packed.startswith(GZIP_MAGIC, at):
        member = zlib.decompressobj(_GZIP_WBITS)
        while at < len(packed) and not member.eof:
            before, step = member.copy(), view[at : at + _STEP_BYTES]
            try:
                unpacked += member.decompress(step, HEAD_BYTES)
            except zlib.error:
                return bytes(unpacked + up_to_damage(before, step))
            if len(unpacked) >= HEAD_BYTES:
                return bytes(unpacked)
            at += len(step) - len(member.unused_data)
    return bytes(unpacked)
