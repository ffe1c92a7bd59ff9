"""The times and positions of a FIT file's records, found by stepping from message to message: nothing else is decoded.

A decoder looks at every field and takes a hundred times as long. Layout: FIT protocol 2, record header, definition and
data messages.
"""

from __future__ import annotations

import struct
from array import array
from typing import NamedTuple

import numpy as np

from fusion.formats.fit.messages import HEAD_BYTES, MAGIC
from fusion.types import Floats

MOST_MESSAGES = 200_000
"""Two days of records at one a second; a file of empty messages has as many in a fifth of a megabyte."""
_RECORD = 20
_TIMESTAMP, _LAT, _LON = 253, 0, 1
_TELLING: dict[int, dict[int, str]] = {
    12: {0: "sport", 1: "sub_sport"},
    18: {5: "sport", 6: "sub_sport", 9: "distance"},
}
"""Fields of the messages ``sport`` and ``session``; distances in centimetres."""
_WIDTHS = {1: "B", 4: "I"}
_COMPRESSED, _DEFINITION, _DEVELOPER = 0x80, 0x40, 0x20
_UNKNOWN = 0x7FFFFFFF


class _Message(NamedTuple):
    """How long one is, and how time and position are read from it, where it is a record that has them."""

    size: int
    fields: tuple[struct.Struct, int, int, int] | None
    telling: tuple[tuple[str, struct.Struct, int], ...] = ()
    """What else it says: name, form and place of each field."""


def walk(data: bytes, telling: dict[str, list[int]] | None = None) -> tuple[Floats, int]:
    """(n, 3) of the records with a position: seconds of FIT, latitude and longitude in semicircles; and how many bytes
    were walked through: all of them where the file ends, is damaged, or another one follows.

    ``telling`` is filled with what its sessions say: ``sport`` and ``sub_sport`` by number, ``distance`` in cm.
    """
    out = array("d")
    if len(data) < HEAD_BYTES or data[8:12] != MAGIC:
        return np.empty((0, 3)), 0
    at = data[0]
    written = struct.unpack_from("<I", data, 4)[0]
    end = min(len(data), at + written) if written else len(data)
    kinds: dict[int, _Message] = {}
    for _ in range(MOST_MESSAGES):
        if at >= end:
            break
        head = data[at]
        if head & _DEFINITION and not head & _COMPRESSED:
            size = _define(data, at, kinds)
            if not size:
                break
            at += size
            continue
        kind = kinds.get((head >> 5) & 3 if head & _COMPRESSED else head & 15)
        if kind is None or at + 1 + kind.size > end:
            break
        if kind.fields is not None and not head & _COMPRESSED:
            number, when, lat, lon = kind.fields
            place = number.unpack_from(data, at + 1 + lat)[0], number.unpack_from(data, at + 1 + lon)[0]
            if _UNKNOWN not in place:
                out.extend((number.unpack_from(data, at + 1 + when)[0], *place))
        if kind.telling and telling is not None:
            _tell(kind, data, at, telling)
        at += 1 + kind.size
    else:
        return np.array(out).reshape(-1, 3), at
    return np.array(out).reshape(-1, 3), len(data)


def _tell(kind: _Message, data: bytes, at: int, telling: dict[str, list[int]]) -> None:
    for name, form, offset in kind.telling:
        telling.setdefault(name, []).append(form.unpack_from(data, at + 1 + offset)[0])


def _define(data: bytes, at: int, kinds: dict[int, _Message]) -> int:
    """Learn what messages of a number look like; how many bytes say so, 0 where they are cut off."""
    head = data[at]
    if at + 6 > len(data):
        return 0
    order = ">" if data[at + 2] else "<"
    (message,) = struct.unpack_from(f"{order}H", data, at + 3)
    count, size, places = data[at + 5], 0, dict[int, int]()
    told, names = list[tuple[str, struct.Struct, int]](), _TELLING.get(message, {})
    length = 6 + 3 * count
    if at + length + 1 > len(data):
        return 0
    for k in range(count):
        number, width = data[at + 6 + 3 * k], data[at + 7 + 3 * k]
        if width == 4:
            places[number] = size
        if number in names and width in _WIDTHS:
            told.append((names[number], struct.Struct(f"{order}{_WIDTHS[width]}"), size))
        size += width
    if head & _DEVELOPER:
        more = data[at + length]
        if at + length + 1 + 3 * more > len(data):
            return 0
        size += sum(data[at + length + 2 + 3 * k] for k in range(more))
        length += 1 + 3 * more
    wanted = message == _RECORD and {_TIMESTAMP, _LAT, _LON} <= set(places)
    fields = (struct.Struct(f"{order}i"), places[_TIMESTAMP], places[_LAT], places[_LON]) if wanted else None
    kinds[head & 15] = _Message(size, fields, tuple(told))
    return length
