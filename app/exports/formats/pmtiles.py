"""PMTiles 3: the vector tiles as the service shows them, in one archive of which clients read parts over HTTP.

Written after its published specification. Tiles lie in the order of their numbers (along a Hilbert curve), equal ones
once. Directories and tiles are gzip without a time, so that equal tiles make equal files.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, model_validator

from app.core.text import dumps, varint
from app.exports.format import Format, NoOptions, Stated, nothing_beside
from app.map.segment import OSM_LICENSE
from app.network import ZOOM

if TYPE_CHECKING:
    from app.exports.source import Source, Tile

ROOT_ENDS_AT = 16_384
"""Clients fetch so many bytes first: the header and the root directory have to fit in."""
HEADER = struct.Struct("<7sB11Q6B4iB2i")
ENTRIES_PER_LEAF = 4096
GZIP_LEVEL = 6
_AS_IT_IS, _GZIP, _CLUSTERED = 1, 2, 1
MVT, PNG = 1, 2
"""Kinds of tiles."""
_E7 = 10_000_000


@dataclass
class _Entry:
    """``run`` tiles from the number ``tile`` on that have the same bytes; run 0: a leaf directory."""

    tile: int
    offset: int
    length: int
    run: int = 1


@dataclass
class _Contents:
    """Where the bytes of tiles are, by their hash; whether they are gzipped."""

    gzipped: bool = True
    entries: list[_Entry] = field(default_factory=list)
    places: dict[bytes, tuple[int, int]] = field(default_factory=dict)
    addressed: int = 0
    size: int = 0

    def add(self, tile: int, data: bytes) -> bytes:
        """Note the tile; what is to be written for it, nothing where equal bytes are there."""
        if self.entries and tile < self.entries[-1].tile + self.entries[-1].run:
            raise ValueError("tiles have to come in the order of their numbers")
        self.addressed += 1
        key = hashlib.sha256(data).digest()[:16]
        packed = b""
        if key not in self.places:
            packed = packed_gzip(data) if self.gzipped else data
            self.places[key] = (self.size, len(packed))
            self.size += len(packed)
        offset, length = self.places[key]
        last = self.entries[-1] if self.entries else None
        if last is not None and last.offset == offset and tile == last.tile + last.run:
            last.run += 1
        else:
            self.entries.append(_Entry(tile, offset, length))
        return packed


def tile_number(z: int, x: int, y: int) -> int:
    """The number of a tile: after all of lower zooms, along the Hilbert curve of its own."""
    number = 0
    for k in reversed(range(z)):
        rx, ry = x >> k & 1, y >> k & 1
        number += (1 << 2 * k) * (3 * rx ^ ry)
        if not ry:
            if rx:
                x, y = (1 << k) - 1 - (x & (1 << k) - 1), (1 << k) - 1 - (y & (1 << k) - 1)
            x, y = y, x
    return ((1 << 2 * z) - 1) // 3 + number


def packed_gzip(data: bytes) -> bytes:
    """As gzip, without a time."""
    return zlib.compress(data, GZIP_LEVEL, wbits=31)


def write_pmtiles(
    path: Path,
    tiles: Iterable[tuple[Tile, bytes]],
    *,
    metadata: Mapping[str, Any],
    zooms: tuple[int, int],
    bounds_deg: tuple[float, float, float, float],
    kind: int = MVT,
) -> int:
    """Write an archive of tiles, which come by ascending number; returns how many. Vector tiles are compressed here.

    Memory: some 200 bytes a tile. ``bounds_deg``: west, south, east, north of what is in it.
    """
    contents = _Contents(gzipped=kind == MVT)
    with path.open("wb") as file:
        file.seek(ROOT_ENDS_AT)  # the directory is known at the end, and has to be at the beginning
        for tile, data in tiles:
            file.write(contents.add(tile_number(*tile), data))
        packed_metadata = packed_gzip(dumps(dict(metadata)).encode())
        root, leaves = _directories(contents.entries)
        file.write(packed_metadata)
        file.write(leaves)
        file.seek(0)
        after = ROOT_ENDS_AT + contents.size
        end = after + len(packed_metadata)
        sections = (HEADER.size, len(root), after, len(packed_metadata), end, len(leaves))
        tile_data = (ROOT_ENDS_AT, contents.size)
        counts = (contents.addressed, len(contents.entries), len(contents.places))
        kinds = (_CLUSTERED, _GZIP, _GZIP if contents.gzipped else _AS_IT_IS, kind)
        west, south, east, north = bounds_deg
        corners = [round(value * _E7) for value in bounds_deg]
        centre = [round((a + b) / 2 * _E7) for a, b in ((west, east), (south, north))]
        numbers = (*sections, *tile_data, *counts, *kinds, *zooms, *corners, zooms[1], *centre)
        file.write(HEADER.pack(b"PMTiles", 3, *numbers) + root)
    return contents.addressed


def _directories(entries: list[_Entry]) -> tuple[bytes, bytes]:
    """The root directory, and the leaves that it leads to where it would be too large without."""
    root, size = _directory(entries), ENTRIES_PER_LEAF
    leaves = b""
    while len(root) > ROOT_ENDS_AT - HEADER.size:
        above, parts, offset = list[_Entry](), list[bytes](), 0
        for start in range(0, len(entries), size):
            part = _directory(entries[start : start + size])
            above.append(_Entry(entries[start].tile, offset, len(part), 0))
            parts.append(part)
            offset += len(part)
        root, leaves, size = _directory(above), b"".join(parts), 2 * size
    return root, leaves


def _directory(entries: list[_Entry]) -> bytes:
    """Column after column, each number in as many bytes as it needs."""
    numbers, last = [len(entries)], 0
    for entry in entries:
        numbers.append(entry.tile - last)
        last = entry.tile
    numbers += [entry.run for entry in entries]
    numbers += [entry.length for entry in entries]
    ends = -1
    for entry in entries:
        numbers.append(0 if entry.offset == ends else entry.offset + 1)
        ends = entry.offset + entry.length
    return packed_gzip(b"".join(map(varint, numbers)))


class ZoomOptions(NoOptions):
    """From which zoom to which."""

    min_zoom: int
    max_zoom: int

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min_zoom > self.max_zoom:
            raise ValueError("min_zoom must not exceed max_zoom")
        return self


class TileOptions(ZoomOptions):
    """Which tiles."""

    min_zoom: int = Field(6, ge=0, le=ZOOM, description="The lowest zoom.")
    max_zoom: int = Field(ZOOM, ge=0, le=ZOOM, description="The highest zoom; clients enlarge its tiles.")


class PmTiles(Format):
    """The vector tiles as the service shows them."""

    name = "pmtiles"
    suffixes = (".pmtiles",)
    media_type = "application/vnd.pmtiles"
    description = "PMTiles 3: the vector tiles in one file, which maps read without any service"
    options = TileOptions
    holds = "tiles"
    companions = nothing_beside

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``; counts tiles."""
        # It brings what a service stands on: who exports no tiles need not load it.
        from app.map.tiles.documents import SEGMENT_FIELDS, kinds  # noqa: PLC0415
        from app.map.tiles.store import SEGMENTS  # noqa: PLC0415

        zooms = (options.min_zoom, options.max_zoom)
        layer = {"id": SEGMENTS, "fields": kinds(SEGMENT_FIELDS), "minzoom": zooms[0], "maxzoom": zooms[1]}
        metadata = {
            "name": "Versant road slopes",
            "description": "Slopes of road segments, measured by vehicles",
            "type": "overlay",
            "version": "1",
            "license": OSM_LICENSE,
            **stated,
            "vector_layers": [layer],
        }
        return write_pmtiles(
            path, source.tiles(zooms, tile_number), metadata=metadata, zooms=zooms, bounds_deg=source.extent()
        )
