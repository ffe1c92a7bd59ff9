"""The hash of what bytes unpack to, computed while they stream by. Knows no file and no log.

The same log, gzipped at another level or under another name, is the same content. How gzip is read is as
``fusion.formats.container`` reads a log: several members, at most two layers, what follows the last member ignored.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator

from fusion.formats.container import BOMB_FREE_BYTES, BOMB_RATIO, CHUNK_BYTES, GZIP_MAGIC

LAYERS = 2
_GZIP_WBITS = 31


class ContentHash:
    """SHA-256 of bytes and of what they unpack to, in the memory of one piece.

    Bytes that are no gzip, or a broken one, or one that unpacks to more than ``max_bytes`` or looks like a bomb, are
    their own content.
    """

    def __init__(self, max_bytes: int, layers: int = LAYERS) -> None:
        self._bytes = hashlib.sha256()
        self._max_bytes = max_bytes
        self._packed = self._unpacked = 0
        self._members: _Members | None = _Members() if layers else None
        self._inner = ContentHash(max_bytes, layers - 1) if layers else None

    def update(self, data: bytes) -> None:
        """Take the next bytes."""
        self._bytes.update(data)
        if self._members is None or self._inner is None:
            return
        self._packed += len(data)
        try:
            for piece in self._members.unpack(data):
                self._unpacked += len(piece)
                if self._is_bomb(self._packed - self._members.unread):
                    self._members = None  # the rest is not unpacked at all
                    return
                self._inner.update(piece)
        except zlib.error:
            self._members = None

    def _is_bomb(self, packed: int) -> bool:
        ratio = self._unpacked > BOMB_FREE_BYTES and self._unpacked > BOMB_RATIO * packed
        return ratio or self._unpacked > self._max_bytes

    def sha256(self) -> str:
        """Of the bytes, hex."""
        return self._bytes.hexdigest()

    def content_sha256(self) -> str:
        """Of what the bytes unpack to, hex."""
        if self._members is None or self._inner is None or not self._members.is_complete:
            return self.sha256()
        return self._inner.content_sha256()


class _Members:
    """The members of a gzip file, unpacked as they come."""

    def __init__(self) -> None:
        self._member: zlib._Decompress | None = None
        self._between = b""  # the first byte of a member whose second has not come yet
        self._count = 0
        self._over = False
        self.unread = 0
        """How many of the bytes that came are not unpacked yet."""

    @property
    def is_complete(self) -> bool:
        """Whether there is a member, and none is cut short."""
        return self._count > 0 and self._member is None

    def unpack(self, data: bytes) -> Iterator[bytes]:
        """What the next bytes unpack to, in pieces of at most ``CHUNK_BYTES``; ``zlib.error`` for no gzip."""
        data, self._between = self._between + data, b""
        while data and not self._over:
            if self._member is None and not self._begin(data):
                return
            assert self._member is not None  # noqa: S101 - begun above
            piece = self._member.decompress(data, CHUNK_BYTES)
            if self._member.eof:
                data, self._member = self._member.unused_data, None
                self._count += 1
            else:
                data = self._member.unconsumed_tail
            self.unread = len(data)
            yield piece

    def _begin(self, data: bytes) -> bool:
        """Begin a member; whether there is one here."""
        if not GZIP_MAGIC.startswith(data[:2]):
            if not self._count:
                raise zlib.error("no gzip")
            self._over = True
            return False
        if len(data) < len(GZIP_MAGIC):
            self._between = data
            return False
        self._member = zlib.decompressobj(_GZIP_WBITS)
        return True
