"""Mapbox vector tiles of segments that come from no database, after version 2.1 of their specification; without ids.

What is in a tile, and how, is as the service's tiles have it where they show single segments (``app.map.tiles.store``):
extent, buffer, properties, and lines of a unit where a segment is shorter than the grid is fine.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from app.core.text import rounded, varint
from app.map.segment import Segment
from app.map.tiles.store import BUFFER, DEM_DIGITS, EDGE_DEG, EXTENT, SEGMENTS
from fusion.arrays import counted
from fusion.types import Bools, Floats, Ints

_NAMES = (
    "slope_percent",
    "slope_sigma_percent",
    "drives",
    "highway",
    "oneway",
    "bridge",
    "tunnel",
    "dem_slope_percent",
)
_LINE, _MOVE_ONE, _LINE_ONE = 2, 9, 10
_VARINT, _FIXED64, _BYTES = 0, 1, 2


def tiles_of(
    segments: Sequence[Segment], zooms: tuple[int, int], number: Callable[[int, int, int], int]
) -> Iterator[tuple[tuple[int, int, int], bytes]]:
    """The tiles (zoom, column, row) of these zooms that hold anything, in each by their numbers; not compressed."""
    ends = np.array([one.coordinates for one in segments], float).reshape(-1, 2, 2)
    x, y = _world(ends[:, :, 0], ends[:, :, 1])
    tags = [_properties(one) for one in segments]
    for z in range(zooms[0], zooms[1] + 1):
        for address, rows, lines in _by_tile(x * 2.0**z, y * 2.0**z, z, number):
            yield address, _tile([tags[k] for k in rows.tolist()], lines)


def _world(lon_deg: Floats, lat_deg: Floats) -> tuple[Floats, Floats]:
    """Positions on the plane of tiles, 0 to 1 from west and from north."""
    lat = np.radians(np.clip(lat_deg, -EDGE_DEG, EDGE_DEG))
    return (lon_deg + 180) / 360, (1 - np.arcsinh(np.tan(lat)) / np.pi) / 2


def _by_tile(
    x: Floats, y: Floats, z: int, number: Callable[[int, int, int], int]
) -> Iterator[tuple[tuple[int, int, int], Ints, Ints]]:
    """Tile after tile: its address, the rows of lines (n, 2) in it, and these in its units, (m, 4)."""
    margin, last = BUFFER / EXTENT, 2**z - 1
    (left, right), (top, low) = (
        np.clip(np.floor([w.min(axis=1) - margin, w.max(axis=1) + margin]), 0, last).astype(np.int64)
        for w in (x, y)
    )
    across = right - left + 1
    row, k = counted(across * (low - top + 1))
    column, line = left[row] + k % across[row], top[row] + k // across[row]
    start, end = (EXTENT * np.column_stack([x[row, e] - column, y[row, e] - line]) for e in range(2))
    there, clipped = _clipped(start, end)
    row, column, line, clipped = row[there], column[there], line[there], clipped[there]
    addresses, tile = np.unique(np.column_stack([column, line]), axis=0, return_inverse=True)
    numbers = np.array([number(z, *address) for address in addresses.tolist()], np.int64)
    tile = tile.ravel()
    order = np.lexsort((row, numbers[tile]))
    begins = np.flatnonzero(np.diff(tile[order], prepend=-1))
    for mine in np.split(order, begins[1:]) if len(order) else ():
        at_column, at_row = addresses[tile[mine[0]]].tolist()
        yield (z, at_column, at_row), row[mine], clipped[mine]


def _clipped(start: Floats, end: Floats) -> tuple[Bools, Ints]:
    """Which lines (n, 2) to (n, 2) reach into a tile and its buffer, and what is inside of each (Liang & Barsky 1984),
    on the grid: x and y of either end, (n, 4)."""
    step = end - start
    enter, leave = np.zeros(len(start)), np.ones(len(start))
    inside = np.ones(len(start), bool)
    for axis in range(2):
        for sign, bound in ((-1.0, BUFFER), (1.0, EXTENT + BUFFER)):
            towards, room = sign * step[:, axis], bound - sign * start[:, axis]
            inside &= (towards != 0) | (room >= 0)
            share = np.divide(room, towards, out=np.zeros_like(room), where=towards != 0)
            leave = np.where(towards > 0, np.minimum(leave, share), leave)
            enter = np.where(towards < 0, np.maximum(enter, share), enter)
    inside &= enter <= leave
    ends = np.column_stack([start + enter[:, None] * step, start + leave[:, None] * step])
    grid = np.rint(ends).astype(np.int64)
    grid[(grid[:, :2] == grid[:, 2:]).all(axis=1), 2] += 1
    return inside, grid


def _properties(segment: Segment) -> list[tuple[int, bytes]]:
    """What a segment has, as numbers of names with encoded values; unknown and false are left out."""
    found = segment.properties()
    found["dem_slope_percent"] = rounded(segment.dem_slope_percent, DEM_DIGITS)
    return [
        (key, _value(found[name]))
        for key, name in enumerate(_NAMES)
        if found[name] is not None and found[name] is not False
    ]


def _value(value: Any) -> bytes:
    if isinstance(value, bool):
        return _number(7, int(value))
    if isinstance(value, str):
        return _part(1, value.encode())
    if isinstance(value, float):
        return varint(3 << 3 | _FIXED64) + struct.pack("<d", value)
    return _number(6, _zigzag(value))


def _tile(tags: list[list[tuple[int, bytes]]], lines: Ints) -> bytes:
    values: dict[bytes, int] = {}
    features = []
    for own, (x0, y0, x1, y1) in zip(tags, lines.tolist(), strict=True):
        pairs = b"".join(varint(key) + varint(values.setdefault(value, len(values))) for key, value in own)
        geometry = (
            _MOVE_ONE, _zigzag(x0), _zigzag(y0), _LINE_ONE, _zigzag(x1 - x0), _zigzag(y1 - y0),
        )  # fmt: skip
        feature = _part(2, pairs) + _number(3, _LINE) + _part(4, b"".join(map(varint, geometry)))
        features.append(_part(2, feature))
    layer = (
        _part(1, SEGMENTS.encode()),
        *features,
        *(_part(3, name.encode()) for name in _NAMES),
        *(_part(4, value) for value in values),
        _number(5, EXTENT),
        _number(15, 2),
    )
    return _part(3, b"".join(layer))


def _zigzag(value: int) -> int:
    return value << 1 if value >= 0 else (-value << 1) - 1


def _number(name: int, value: int) -> bytes:
    return varint(name << 3 | _VARINT) + varint(value)


def _part(name: int, data: bytes) -> bytes:
    return varint(name << 3 | _BYTES) + varint(len(data)) + data
