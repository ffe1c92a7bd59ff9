"""Reading OpenStreetMap files for exports: the roads of all regions as one, or a file of a person's own.

A graph of the nodes of roads is read in passes, as columns; objects are gone through once more when a file is written.
Knows no heights and no consumer.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import osmium
from pyproj import Geod

from app.core.messages import say
from fusion.errors import RoadsError
from fusion.roads.node_heights import RoadGraph
from fusion.roads.osm import file_format
from fusion.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from app.core.db import Bounds

ROUTED = (
    ("highway", None),
    ("route", "ferry"),
    ("railway", "platform"),
    ("public_transport", "platform"),
    ("man_made", "pier"),
)
"""Ways that routers go along: their key, and value where not any."""
FORMATS = {".pbf": "pbf", ".gz": "osm.gz", ".osm": "osm"}
"""osmium's names of formats, by the last part of a file's name."""

_WGS84 = Geod(ellps="WGS84")


@dataclass(frozen=True, eq=False)
class RoadNodes:
    """The nodes of roads: ``node`` (n,) their numbers, ascending, ``graph`` where they are and what connects them.

    ``way`` are the numbers of the ways, ascending.
    """

    node: Ints
    graph: RoadGraph
    way: Ints

    def rows(self, nodes: Ints) -> Ints:
        """For each of these numbers its row; -1 where it is none of them."""
        if not len(self.node):
            return np.full(len(nodes), -1)
        at = np.minimum(np.searchsorted(self.node, nodes), len(self.node) - 1)
        return np.where(self.node[at] == nodes, at, -1)


@dataclass
class _Columns:
    """What is read of ways: their nodes one after another."""

    id: array[int] = field(default_factory=lambda: array("q"))
    nodes: array[int] = field(default_factory=lambda: array("q"))
    structure: array[int] = field(default_factory=lambda: array("b"))
    ref: array[int] = field(default_factory=lambda: array("q"))

    def add(self, way: Any) -> None:
        before = len(self.ref)
        self.ref.extend([n.ref for n in way.nodes])
        self.id.append(way.id)
        self.nodes.append(len(self.ref) - before)
        self.structure.append(way.tags.get("bridge", "no") != "no" or way.tags.get("tunnel", "no") != "no")


def merged(files: Sequence[Path], kinds: Any = osmium.osm.NODE | osmium.osm.WAY) -> Iterator[Any]:
    """Each object of sorted files once, sorted; of one that several have that of the file in front.

    An object is valid until the next one is asked for.
    """
    opened = [osmium.FileProcessor(osmium.io.File(str(path), file_format(path)), kinds) for path in files]
    if len(opened) == 1:
        yield from opened[0]
        return
    for same in osmium.zip_processors(*opened):
        yield next(one for one in same if one is not None)


def read_nodes(files: Sequence[Path], bbox: Bounds | None = None, *, roads_only: bool = True) -> RoadNodes:
    """The nodes of roads of sorted files, or of those ways that have a node in the box.

    ``roads_only``: every way is a road (files of regions); else those of ``ROUTED`` are. ``RoadsError`` for a file that
    is none, is damaged, or has no road with the positions of its nodes.
    """
    with damage_told(files):
        ways = _Columns()
        for way in merged(files, osmium.osm.WAY):
            tags = way.tags
            if roads_only or any(tags.get(k) is not None and v in (None, tags.get(k)) for k, v in ROUTED):
                ways.add(way)
        ref = np.array(ways.ref, np.int64)
        node = np.unique(ref)
        lon, lat = _places(files, node)
    length = np.array(ways.nodes, np.int64)
    way = np.repeat(np.arange(len(length)), length)
    row = np.searchsorted(node, ref)
    if bbox is not None:
        connected = np.zeros(len(length), bool)
        connected[way[within(bbox, lon, lat)[row]]] = True
        keep = connected[way]
        way, row = way[keep], row[keep]
    used = np.unique(row)
    used = used[np.isfinite(lon[used])]
    if not len(used):
        where = "" if bbox is None else say("export.in_this_box")
        raise RoadsError(say("export.no_nodes", files=", ".join(f.name for f in files), where=where))
    place = np.full(len(node), -1, np.int64)
    place[used] = np.arange(len(used))
    numbers = np.frombuffer(ways.id, np.int64)
    structure = np.frombuffer(ways.structure, np.int8).astype(bool)
    graph = _graph(place[row], way, structure, lon[used], lat[used])
    return RoadNodes(node[used], graph, np.unique(numbers[np.unique(way)]))


def only(objects: Any, node: Ints) -> Any:
    """A processor of the nodes of these numbers alone; of everything where editors gave some negative numbers, which
    osmium's sets do not take.
    """
    if len(node) and node.min() < 0:
        return objects
    numbers = osmium.IdTracker()
    for one in node.tolist():
        numbers.add_node(one)
    return objects.with_filter(numbers.id_filter())


def within(bbox: Bounds, lon_deg: Floats, lat_deg: Floats) -> Bools:
    """Which places are in a box, which may cross the antimeridian."""
    west, south, east, north = bbox
    across = (west <= lon_deg) & (lon_deg <= east) if west <= east else (west <= lon_deg) | (lon_deg <= east)
    return np.asarray(across & (south <= lat_deg) & (lat_deg <= north))


@dataclass(frozen=True)
class OsmNode:
    """A node; ``version`` is 0 where the file has none."""

    lon_deg: float
    lat_deg: float
    version: int


@dataclass(frozen=True)
class OsmWay:
    """A way with its tags and the numbers of its nodes; ``version`` is 0 where the file has none."""

    id: int
    version: int
    nodes: tuple[int, ...]
    tags: Mapping[str, str]


def read_ways(files: Sequence[Path], ids: set[int]) -> tuple[list[OsmWay], dict[int, OsmNode]]:
    """These ways of sorted files, by their numbers, and their nodes, but for those that no file has."""
    with damage_told(files):
        ways = [
            OsmWay(w.id, w.version, tuple(n.ref for n in w.nodes), {t.k: t.v for t in w.tags})
            for w in merged(files, osmium.osm.WAY)
            if w.id in ids
        ]
        node_ids = {node for way in ways for node in way.nodes}
        nodes = {
            n.id: OsmNode(n.location.lon, n.location.lat, n.version)
            for n in merged(files, osmium.osm.NODE)
            if n.id in node_ids and n.location.valid()
        }
    return ways, nodes


@contextmanager
def writing(path: Path, file_format_name: str, generator: str) -> Iterator[Any]:
    """A writer of an OSM file, whose header says this as its generator: the one place that both formats have."""
    header = osmium.io.Header()
    header.set("generator", generator)
    place = osmium.io.File(str(path), file_format_name)
    with osmium.SimpleWriter(place, header=header, overwrite=True) as writer:
        yield writer


@contextmanager
def damage_told(files: Sequence[Path]) -> Iterator[None]:
    """What osmium raises within the block, as ``RoadsError``; so is an import that took a file away meanwhile."""
    there = [path for path in files if path.is_file()]
    try:
        yield
    except (RoadsError, RuntimeError, ValueError, UnicodeDecodeError) as error:
        if any(not path.is_file() for path in there):
            raise RoadsError(say("export.roads_anew")) from error
        if isinstance(error, RoadsError):
            raise
        names = ", ".join(path.name for path in files)
        raise RoadsError(say("export.damaged", names=names, error=str(error).rstrip("."))) from error


def _places(files: Sequence[Path], node: Ints) -> tuple[Floats, Floats]:
    """Longitudes and latitudes of nodes, degrees, NaN of those that no file has; shapes (n,)."""
    number, x, y = array("q"), array("d"), array("d")
    files_in_turn = [
        only(osmium.FileProcessor(osmium.io.File(str(f), file_format(f)), osmium.osm.NODE), node)
        for f in reversed(files)  # the file in front has the last word
    ]
    for processor in files_in_turn:
        for element in processor:
            place = getattr(element, "location")  # noqa: B009 - only nodes come, which the type does not say
            if place.valid():
                number.append(element.id)
                x.append(place.lon)
                y.append(place.lat)
    lon, lat = np.full(len(node), np.nan), np.full(len(node), np.nan)
    found_node = np.array(number, np.int64)
    at = np.minimum(np.searchsorted(node, found_node), len(node) - 1)
    mine = node[at] == found_node
    lon[at[mine]], lat[at[mine]] = np.array(x, float)[mine], np.array(y, float)[mine]
    return lon, lat


def _graph(row: Ints, way: Ints, structure: Bools, lon: Floats, lat: Floats) -> RoadGraph:
    """Edges between consecutive known nodes of each way; ``row`` and ``way`` (k,), -1 unknown."""
    a, b = row[:-1], row[1:]
    pair = (way[:-1] == way[1:]) & (a >= 0) & (b >= 0) & (a != b)
    edge = np.column_stack([a[pair], b[pair]])
    off = structure[way[:-1][pair]]
    length = np.asarray(_WGS84.inv(lon[edge[:, 0]], lat[edge[:, 0]], lon[edge[:, 1]], lat[edge[:, 1]])[2])
    return RoadGraph(edge, np.maximum(length, 1e-3), off, lon, lat)
