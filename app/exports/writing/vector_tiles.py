"""Vector tiles of segments that come from no database: as the service's of single segments, but without ids."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from app.core.text import rounded
from app.map.segment import Segment
from app.map.tiles import encoding
from app.map.tiles.encoding import BUFFER, EXTENT
from app.map.tiles.road_store import DEM_DIGITS, KEYS
from app.map.tiles.store import EDGE_DEG, SEGMENTS
from fusion.arrays import counted
from fusion.types import Bools, Floats, Ints


def tiles_of(
    segments: Sequence[Segment], zooms: tuple[int, int], number: Callable[[int, int, int], int]
) -> Iterator[tuple[tuple[int, int, int], bytes]]:
    """The tiles (zoom, column, row) of these zooms that hold anything, in each by their numbers; not compressed."""
    ends = np.array([one.coordinates for one in segments], float).reshape(-1, 2, 2)
    x, y = _world(ends[:, :, 0], ends[:, :, 1])
    columns = _columns(segments)
    for z in range(zooms[0], zooms[1] + 1):
        for address, rows, lines in _by_tile(x * 2.0**z, y * 2.0**z, z, number):
            yield address, _tile(columns, rows, lines)


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
    units = [w[row, e] - at for e in range(2) for w, at in ((x, column), (y, line))]
    there, clipped = encoding.clipped(EXTENT * np.column_stack(units))
    row, column, line = row[there], column[there], line[there]
    addresses, tile = np.unique(np.column_stack([column, line]), axis=0, return_inverse=True)
    numbers = np.array([number(z, *address) for address in addresses.tolist()], np.int64)
    tile = tile.ravel()
    order = np.lexsort((row, numbers[tile]))
    begins = np.flatnonzero(np.diff(tile[order], prepend=-1))
    for mine in np.split(order, begins[1:]) if len(order) else ():
        at_column, at_row = addresses[tile[mine[0]]].tolist()
        yield (z, at_column, at_row), row[mine], clipped[mine]


def _columns(segments: Sequence[Segment]) -> dict[str, np.ma.MaskedArray[Any, Any]]:
    """What is known of n segments, by key, shape (n,); unknown and false are masked."""
    found = [one.properties() for one in segments]
    for own, one in zip(found, segments, strict=True):
        own["dem_slope_percent"] = rounded(one.dem_slope_percent, DEM_DIGITS)
    columns = {}
    for key, kind in zip(KEYS, _TYPES, strict=True):
        column = [own[key] for own in found]
        known = np.array([value is not None and value is not False for value in column], bool)
        filled: Any = np.array(
            [value if there else kind() for value, there in zip(column, known, strict=True)], kind
        )
        columns[key] = np.ma.MaskedArray(filled, ~known)
    return columns


def _tile(columns: Mapping[str, np.ma.MaskedArray[Any, Any]], rows: Ints, ends: Ints) -> bytes:
    """The tile of these rows, whose ends (m, 4) are on its grid."""
    values, codes = encoding.Values(b"", 0), []
    for key, kind in zip(KEYS, _TYPES, strict=True):
        column = columns[key][rows]
        known = ~np.ma.getmaskarray(column)
        different, code = np.unique(column.data[known], return_inverse=True)
        codes.append(np.full(len(rows), -1, np.int64))
        codes[-1][known] = values.count + code
        values += _WRITE[kind](different)
    features, _ = encoding.features(None, ends, codes)
    return encoding.layer(SEGMENTS, features.tobytes(), KEYS, values)


def _flags(values: Bools) -> encoding.Values:
    """False is not told."""
    return encoding.TRUE if len(values) else encoding.Values(b"", 0)


_TYPES: tuple[type, ...] = (int, float, float, str, int, bool, bool, float)
"""Of the values of ``KEYS``."""
_WRITE: Mapping[type, Callable[[Any], encoding.Values]] = {
    int: lambda values: encoding.integers(values.tolist()),
    float: encoding.doubles,
    str: lambda values: encoding.texts(values.tolist()),
    bool: _flags,
}
