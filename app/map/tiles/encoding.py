"""Mapbox vector tiles (version 2.1 of the specification) out of arrays: lines of two points with their properties.

All features at once: each byte of all of them is one vector, and which of them have it another. The tiles are equal to
those of PostGIS (``ST_AsMVTGeom``, ``ST_AsMVT``), which takes ten times as long for each feature.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.core.text import varint
from fusion.types import Bools, Floats, Ints

EXTENT = 4096
"""Units across a vector tile."""
BUFFER = 64
"""Units by which lines go on beyond a tile's edge, so that it does not cut wide strokes short."""
SHORT = 1.5
"""Units: as long is drawn what is shorter than the grid is fine, from its start to the east."""

_VARINT, _DELIMITED = 0, 2
_LINE_STRING = b"\x18\x02"
_MOVE_TO, _LINE_TO = 1 << 3 | 1, 1 << 3 | 2


@dataclass(frozen=True)
class Values:
    """Values that features have, as the tile's layer lists them: written, and how many."""

    written: bytes
    count: int

    def __add__(self, other: Values) -> Values:
        """These, and then those."""
        return Values(self.written + other.written, self.count + other.count)


def doubles(values: Floats) -> Values:
    """Numbers of shape (k,)."""
    written = np.empty(len(values), [("head", "u1", 3), ("value", "<f8")])
    written["head"] = (_key(4, _DELIMITED), 9, 3 << 3 | 1)
    written["value"] = values
    return Values(written.tobytes(), len(values))


def integers(values: Iterable[int]) -> Values:
    """Whole numbers; those from 0 on and those below are of two types."""
    parts = [_integer(n) for n in values]
    return Values(b"".join(parts), len(parts))


@lru_cache(maxsize=10_000)
def _integer(n: int) -> bytes:
    key, written = (5, n) if n >= 0 else (6, -2 * n - 1)
    return _part(4, bytes([_key(key, _VARINT)]) + varint(written))


def texts(values: Iterable[str]) -> Values:
    """Texts."""
    parts = [_part(4, _part(1, text.encode())) for text in values]
    return Values(b"".join(parts), len(parts))


TRUE = Values(b"\x22\x02\x38\x01", 1)


def clipped(units: Floats) -> tuple[Ints, Ints]:
    """Which of n lines a tile shows, and how: rows (m,), and their ends x, y, x, y (m, 4) on its grid and buffer.

    ``units``: both ends of each line, shape (n, 4), in units of the tile from its north-western corner. As
    ``ST_AsMVTGeom`` has it: on the grid first, then cut off. A line that becomes a point is ``SHORT``.
    """
    x0, y0, x1, y1 = units.T
    to_x, to_y = np.rint(x1), np.rint(y1)
    short = (np.rint(x0) == to_x) & (np.rint(y0) == to_y)
    as_short = np.rint(x0 + SHORT), np.rint(y0)
    ends = _cut(x0, y0, np.where(short, as_short[0], to_x), np.where(short, as_short[1], to_y))
    # Of what the edge leaves a point of, the start may still lie inside.
    points = np.flatnonzero(_is_point(ends) & ~short & _inside(x0) & _inside(y0))
    ends[points] = _cut(x0[points], y0[points], as_short[0][points], as_short[1][points])
    rows = np.flatnonzero(~_is_point(ends))
    return rows, ends[rows].astype(np.int64)


def _inside(along: Floats) -> Bools:
    return np.asarray(np.abs(np.rint(along) - EXTENT / 2) <= EXTENT / 2 + BUFFER)


def _is_point(ends: Floats) -> Bools:
    return np.asarray((ends[:, 0] == ends[:, 2]) & (ends[:, 1] == ends[:, 3]))


def _cut(x0: Floats, y0: Floats, to_x: Floats, to_y: Floats) -> Floats:
    """Lines within the tile and its buffer, on the grid (Liang and Barsky, 1984); what lies outside is a point."""
    x0, y0 = np.rint(x0), np.rint(y0)
    enters, leaves = np.zeros(len(x0)), np.ones(len(x0))
    outside = np.zeros(len(x0), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for start, step in ((x0, to_x - x0), (y0, to_y - y0)):
            low, high = (-BUFFER - start) / step, (EXTENT + BUFFER - start) / step
            flat = step == 0
            outside |= flat & ((start < -BUFFER) | (start > EXTENT + BUFFER))
            enters = np.where(flat, enters, np.maximum(enters, np.minimum(low, high)))
            leaves = np.where(flat, leaves, np.minimum(leaves, np.maximum(low, high)))
    leaves = np.where(outside | (enters > leaves), enters, leaves)
    ends = np.empty((len(x0), 4))
    for k, (start, end) in enumerate(((x0, to_x), (y0, to_y))):
        ends[:, k] = np.rint(start + enters * (end - start))
        ends[:, k + 2] = np.rint(np.where(leaves == 1, end, start + leaves * (end - start)))
    return ends


def features(ids: Ints | None, ends: Ints, codes: Sequence[Ints]) -> tuple[Ints, Ints]:
    """n features: their bytes, one after the other (uint8), and how many each has, shape (n,).

    ``ids``: (n,), from 0 on; None: they have none. ``ends``: (n, 4), as ``clipped`` gives them. ``codes``: for each of
    the layer's keys which of its values each feature has, shape (n,), below 0 where it has none.
    """
    every = np.ones(len(ends), bool)
    tags, line, body, whole = (_Columns(len(ends)) for _ in range(4))
    for key, code in enumerate(codes):
        has = code >= 0
        tags.constant(bytes([key]), has)
        tags.add(code, has)
    x0, y0, x1, y1 = ends.T.astype(np.int64)
    for command, steps in ((_MOVE_TO, (x0, y0)), (_LINE_TO, (x1 - x0, y1 - y0))):
        line.constant(bytes([command]))
        for step in steps:
            line.add(step << 1 ^ step >> 63, every)
    if ids is not None:
        body.constant(bytes([_key(1, _VARINT)]))
        body.add(ids, every)
    body.constant(bytes([_key(2, _DELIMITED)]))
    body.add(tags.size, every)
    body.extend(tags)
    body.constant(_LINE_STRING + bytes([_key(4, _DELIMITED)]))
    body.add(line.size, every)
    body.extend(line)
    whole.constant(bytes([_key(2, _DELIMITED)]))
    whole.add(body.size, every)
    whole.extend(body)
    return whole.joined(), whole.size


def layer(name: str, written: bytes, keys: Sequence[str], values: Values) -> bytes:
    """The tile of one layer of these features; empty without any."""
    if not written:
        return b""
    head = bytes([_key(15, _VARINT), 2]) + _part(1, name.encode())
    named = b"".join(_part(3, key.encode()) for key in keys)
    return _part(
        3, b"".join((head, written, named, values.written, bytes([_key(5, _VARINT)]), varint(EXTENT)))
    )


class _Columns:
    """Bytes of n messages, column by column: the values, and which of the messages have them."""

    def __init__(self, n: int) -> None:
        self._every = np.ones(n, bool)
        self._bytes: list[Ints] = []
        self._there: list[Bools] = []
        self.size = np.zeros(n, np.int64)
        """Of each message, in bytes."""

    def constant(self, written: bytes, there: Bools | None = None) -> None:
        """Some messages, or all, go on with these bytes."""
        for byte in written:
            self._bytes.append(np.full(len(self.size), byte, np.uint8))
            self._there.append(self._every if there is None else there)
            self.size += self._there[-1]

    def add(self, numbers: Ints, there: Bools) -> None:
        """Some messages go on with a number from 0 on, as ``varint`` writes it."""
        while True:
            self._there.append(there)
            self.size += there
            more = there & (numbers > 127)
            if not more.any():
                self._bytes.append(numbers.astype(np.uint8))
                return
            self._bytes.append(numbers.astype(np.uint8) & 127 | more.view(np.uint8) << 7)
            numbers, there = numbers >> 7, more

    def extend(self, other: _Columns) -> None:
        """All messages go on as those do."""
        self._bytes += other._bytes
        self._there += other._there
        self.size += other.size

    def joined(self) -> Ints:
        """All messages, one after the other."""
        return np.array(self._bytes).T[np.array(self._there).T]


def _key(field: int, kind: int) -> int:
    return field << 3 | kind


def _part(field: int, written: bytes) -> bytes:
    return bytes([_key(field, _DELIMITED)]) + varint(len(written)) + written
