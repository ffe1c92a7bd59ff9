"""How much a file of OpenStreetMap unpacks to, found out before it is read."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from fusion.errors import RoadsError
from fusion.types import Progress, no_progress

PBF_TIMES, GZIP_TIMES = 20, 50
"""PBF packs to a half or a third, XML by gzip to a tenth: more is an attack, and each node of it takes memory."""
_FREE_BYTES = 64 << 20  # which any file may unpack to
_CHUNK_BYTES = 1 << 20
_HEADER_BYTES = 64 << 10  # as the format bounds it
_RAW_SIZE, _DATA_SIZE = 2, 3


def refuse_bomb(path: Path, kind: str, progress: Progress = no_progress) -> None:
    """Raise ``RoadsError`` for a file of this kind (``file_format``) that unpacks to many times its size, or is cut."""
    packed = path.stat().st_size
    times = PBF_TIMES if kind == "pbf" else GZIP_TIMES
    most, unpacked = max(_FREE_BYTES, times * packed), 0
    if not kind.endswith(("pbf", "gz")):
        return
    with path.open("rb") as file:
        try:
            for size in _pbf_sizes(file) if kind == "pbf" else _gzip_sizes(file):
                unpacked += size
                if unpacked > most:
                    raise RoadsError(
                        f"{path.name} unpacks to more than {times} times its size, which no map does. Download or "
                        "export it again."
                    )
                progress("looking through the file", min(file.tell() / packed, 1.0))
        except (ValueError, IndexError, zlib.error) as error:
            raise RoadsError(f"{path.name} is damaged: {error}. Download or export it again.") from error


def _gzip_sizes(file: BinaryIO) -> Iterator[int]:
    """What pieces of the file unpack to; a cut or other end is the reader's to tell."""
    member, feed = zlib.decompressobj(31), file.read(_CHUNK_BYTES)
    while feed:
        yield len(member.decompress(feed, _CHUNK_BYTES))
        feed = member.unconsumed_tail or member.unused_data or file.read(_CHUNK_BYTES)
        if member.eof:
            if not feed.startswith(b"\x1f"):  # what follows is no gzip, and nobody reads it
                return
            member = zlib.decompressobj(31)


def _pbf_sizes(file: BinaryIO) -> Iterator[int]:
    """What the blobs say that they unpack to; the reader holds them to that."""
    while length := file.read(4):
        size = int.from_bytes(length, "big")
        if size > _HEADER_BYTES:
            raise ValueError("a header of a blob is too large")
        data_bytes = _numbers(file.read(size)).get(_DATA_SIZE, 0)
        begins = file.tell()
        header = _numbers(file.read(min(data_bytes, _HEADER_BYTES)))
        yield max(header.get(_RAW_SIZE, 0), data_bytes)
        file.seek(begins + data_bytes)


def _numbers(message: bytes) -> dict[int, int]:
    """The numbers among the fields of a protocol buffer, as far as it is there; blocks of bytes are passed over."""
    fields, at = {}, 0
    while at < len(message):
        key, at = _varint(message, at)
        value, at = _varint(message, at)
        if key & 7 == 2:
            at += value
        elif key & 7 == 0:
            fields[key >> 3] = value
        else:
            raise ValueError("a field of a blob is of no known kind")
    return fields


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 64:
        if at >= len(message):
            raise ValueError("a header of a blob is cut off")
        value |= (message[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if message[at - 1] < 128:
            return value, at
    raise ValueError("a number in a blob is too long")
