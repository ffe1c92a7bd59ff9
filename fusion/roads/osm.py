"""OSM files to road segments; how much a file unpacks to is found out before it is read."""

from __future__ import annotations

import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import osmium
from numpy.typing import NDArray

from fusion.errors import RoadsError
from fusion.messages import say
from fusion.roads.names import PLACES, WATER_TAGS, MapNames
from fusion.roads.table import DTYPE_OF, RoadTable
from fusion.types import Progress, no_progress

PBF_TIMES, GZIP_TIMES = 20, 50
"""How many times its size a file may unpack to. PBF packs to a half or a third, and gzip packs XML to a tenth. A file
that packs better is an attack, and each of its nodes takes memory."""
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
                    raise RoadsError(say("roads.bomb", file=path.name, times=times))
                progress("looking through the file", min(file.tell() / packed, 1.0))
        except (ValueError, IndexError, zlib.error) as error:
            raise RoadsError(say("roads.damaged", file=path.name, error=error)) from error


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


_WITH_LINKS = ("motorway", "trunk", "primary", "secondary", "tertiary")
_OTHERS = ("unclassified", "residential", "living_street", "service", "road", "track")
DRIVABLE = frozenset((*_WITH_LINKS, *(f"{kind}_link" for kind in _WITH_LINKS), *_OTHERS))
"""The values of ``highway`` that make a way drivable."""

BROKEN: tuple[type[Exception], ...] = (
    RuntimeError,
    ValueError,
    KeyError,
    MemoryError,
    osmium.InvalidLocationError,
)
"""What osmium raises for a file that is damaged; memory is short where numbers are beyond reason."""

_FORWARD = frozenset({"yes", "true", "1"})
_BACKWARD = frozenset({"-1", "reverse"})
_NO = frozenset({"no", "false", "0"})
_OF_WAYS = ("oneway", "bridge", "tunnel", "layer", "highway", "name")
_WAYS_PER_REPORT = 8192
_SUFFIX_HINT = say("roads.give_extract")


@dataclass
class _Ways:
    """What one pass over the ways collects: node columns flat, way columns one per way."""

    node: array[int] = field(default_factory=lambda: array("q"))
    x: array[int] = field(default_factory=lambda: array("i"))
    y: array[int] = field(default_factory=lambda: array("i"))
    id: list[int] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    tags: dict[str, list[Any]] = field(default_factory=lambda: {name: [] for name in _OF_WAYS})

    def add(self, way: Any) -> None:
        """Append one osmium way whose nodes carry their locations."""
        before = len(self.node)
        node, x, y = self.node.append, self.x.append, self.y.append
        for n in way.nodes:
            node(n.ref)
            x(n.x)
            y(n.y)
        tag = way.tags.get
        highway = tag("highway")
        self.id.append(way.id)
        self.nodes.append(len(self.node) - before)
        bridge, tunnel = (tag(name, "no") != "no" for name in ("bridge", "tunnel"))
        oneway, layer = oneway_of(highway, tag("oneway"), tag("junction")), layer_of(tag("layer"))
        values = oneway, bridge, tunnel, layer, highway, tag("name")
        for name, value in zip(_OF_WAYS, values, strict=True):
            self.tags[name].append(value)


def read_roads(path: Path, progress: Progress = no_progress, *, names: MapNames | None = None) -> RoadTable:
    """Read the drivable ways of an OSM file (XML, gzipped XML or PBF, recognised by content) as segments.

    ``names`` takes the names of the map from the same file, where they are wanted. Node pairs with an end that
    the extract lacks, and pairs without length, are left out and counted in ``RoadTable.skipped``. Nodes may come
    after the ways. Raises ``RoadsError`` when the file is missing, is no OSM file, is damaged, or holds no drivable
    way with the positions of its nodes.
    """
    path = Path(path)
    source = osmium.io.File(str(path.absolute()), bounded_format(path, progress))
    progress("reading nodes", 0.0)
    try:
        locations = osmium.NodeLocationsForWays(osmium.index.create_map("flex_mem"))
        locations.ignore_errors()
        with osmium.io.Reader(source, osmium.osm.NODE) as reader:
            osmium.apply(reader, locations, *(() if names is None else (place_filter(), names)))
        progress("reading ways", 0.3)
        ways = _collect(source, locations, progress, names)
    except BROKEN as error:
        raise RoadsError(say("roads.damaged", file=path.name, error=error)) from error
    progress("building segments", 0.9)
    table = _segments(ways)
    if not len(table):
        raise RoadsError(_nothing(path, ways, table.skipped))
    progress("building segments", 1.0)
    return table


def oneway_of(highway: str, oneway: str | None, junction: str | None) -> int:
    """1 along the way, -1 against it, 0 both; roundabouts and motorways are one-way unless tagged."""
    if oneway in _FORWARD:
        return 1
    if oneway in _BACKWARD:
        return -1
    if oneway in _NO:
        return 0
    return int(highway == "motorway" or junction in ("roundabout", "circular"))


def layer_of(tag: str | None) -> int:
    """OSM's ``layer`` as an integer; 0 when absent, not a whole number or beyond -100..100."""
    try:
        layer = int(tag or 0)
    except ValueError:
        return 0
    return layer if abs(layer) <= 100 else 0


def file_format(path: Path) -> str:
    """The name that osmium gives the file's format, from its first bytes."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RoadsError(say("roads.unreadable", file=path, reason=reason, hint=_SUFFIX_HINT)) from error
    if not head:
        raise RoadsError(say("roads.empty", file=path.name, hint=_SUFFIX_HINT))
    if b"OSMHeader" in head:
        return "pbf"
    if head.startswith(b"\x1f\x8b"):
        return "osm.gz"
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<"):
        return "osm"
    raise RoadsError(say("roads.no_osm", file=path.name, hint=_SUFFIX_HINT))


def bounded_format(path: Path, progress: Progress = no_progress) -> str:
    """``file_format`` of a file that does not unpack to far more than any map."""
    kind = file_format(path)
    refuse_bomb(path, kind, progress)
    return kind


def place_filter() -> Any:
    """Of nodes, lets those pass alone that a map may name."""
    return osmium.filter.TagFilter(*(("place", kind) for kind in PLACES)).enable_for(osmium.osm.NODE)


def _collect(source: Any, locations: Any, progress: Progress, names: MapNames | None) -> _Ways:
    tags = [("highway", value) for value in sorted(DRIVABLE)]
    wanted = osmium.filter.TagFilter(*tags, *(() if names is None else WATER_TAGS))
    ways = _Ways()
    processor = osmium.FileProcessor(source, osmium.osm.WAY).with_filter(wanted).with_filter(locations)
    for count, way in enumerate(processor):
        if isinstance(way, osmium.osm.Way) and not way.deleted:
            if names is not None:
                names.way(way)
            if names is None or way.tags.get("highway") in DRIVABLE:
                ways.add(way)
        if count % _WAYS_PER_REPORT == 0:
            # osmium does not say how far it has read: approach the end without reaching it.
            progress("reading ways", 0.3 + 0.6 * count / (count + 100_000))
    return ways


def _segments(ways: _Ways) -> RoadTable:
    """Pair consecutive nodes of each way; vectorised, as a country has tens of millions of them."""
    node = np.frombuffer(ways.node, np.int64)
    x, y = np.frombuffer(ways.x, np.int32), np.frombuffer(ways.y, np.int32)
    way = np.repeat(np.arange(len(ways.id)), ways.nodes)
    known = (np.abs(x.astype(np.int64)) <= 1_800_000_000) & (np.abs(y.astype(np.int64)) <= 900_000_000)
    pair = way[1:] == way[:-1]
    located = known[1:] & known[:-1]
    length = (node[1:] != node[:-1]) & ((x[1:] != x[:-1]) | (y[1:] != y[:-1]))
    i = np.flatnonzero(pair & located & length)
    skipped = Counter[str]()
    for reason, lost in (
        ("node missing from the file", pair & ~located),
        ("no length", pair & located & ~length),
    ):
        if lost.any():
            skipped[reason] = int(lost.sum())
    w = way[i]
    return RoadTable.from_columns(
        osm_way_id=np.array(ways.id, np.int64)[w],
        from_node=node[i],
        to_node=node[i + 1],
        lon0_deg=_degrees(x[i]),
        lat0_deg=_degrees(y[i]),
        lon1_deg=_degrees(x[i + 1]),
        lat1_deg=_degrees(y[i + 1]),
        **{name: np.array(ways.tags[name], DTYPE_OF[name])[w] for name in _OF_WAYS},
        skipped=skipped,
    )


def _degrees(units: NDArray[np.int32]) -> NDArray[np.float64]:
    # Dividing by 1e7 gives the double nearest to the decimal in the file; multiplying by 1e-7 does not.
    return units / 1e7


def _nothing(path: Path, ways: _Ways, skipped: Counter[str]) -> str:
    if not ways.id:
        return say("roads.no_way", file=path.name, classes=", ".join(sorted(DRIVABLE)))
    if skipped["node missing from the file"]:
        return say("roads.no_nodes", file=path.name, n=len(ways.id))
    return say("roads.no_length", n=len(ways.id), file=path.name)
