"""Files of changes (osmChange): applied to the roads of a file that was kept for that.

What is kept is every way with a ``highway``, drivable or not, and its nodes: a path that becomes a road has them; and
what has a name that a map shows (``names``).
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Any

import osmium

from fusion.errors import RoadsError
from fusion.messages import say
from fusion.roads.names import WATERS
from fusion.roads.osm import BROKEN, bounded_format, place_filter

Box = tuple[float, float, float, float]
"""West, south, east, north, degrees."""

MOST_NUMBER = 2**44
"""A thousand times the numbers that there are."""

_KIND_ORDER = {"n": 0, "w": 1, "r": 2}


def is_change_file(path: Path) -> bool:
    """Whether the file holds changes, by its first bytes; False also for what cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(2)
        with gzip.open(path) if head == b"\x1f\x8b" else path.open("rb") as file:
            return b"<osmChange" in file.read(1024)
    except (OSError, EOFError, zlib.error):
        return False


def keep_roads(source: Path, target: Path) -> None:
    """Write the ways of an OSM file that have a ``highway``, and their nodes, to another (PBF), sorted; so places and
    waters that have a name.

    Raises ``RoadsError`` for a file that is none, or damaged.
    """
    file = osmium.io.File(str(source.absolute()), bounded_format(source))
    try:
        _write_sorted(file, target, None, set())
    except BROKEN as error:
        raise _damaged(source, error) from error


def apply_changes(kept: Path, changes: Path, target: Path, bounds_deg: Box) -> None:
    """Write what ``keep_roads`` kept, with the changes, to another file.

    Ways that are new are taken where they have a node in the box. Nodes that neither file has stay missing. Raises
    ``RoadsError`` for changes that cannot be read.
    """
    merged = target.with_name(f"whole-{target.name}")
    bounded_format(changes)
    content = changes.read_bytes()
    try:
        merge = osmium.MergeInputReader()
        merge.add_buffer(content, "osc.gz" if content.startswith(b"\x1f\x8b") else "osc")
        with osmium.io.Reader(str(kept)) as reader:
            writer = osmium.io.Writer(str(merged), overwrite=True)
            try:
                merge.apply_to_reader(reader, writer)
            finally:
                writer.close()
        known = {way.id for way in osmium.FileProcessor(str(kept), osmium.osm.WAY)}
        _write_sorted(osmium.io.File(str(merged)), target, bounds_deg, known)
    except BROKEN as error:
        raise _damaged(changes, error) from error
    finally:
        merged.unlink(missing_ok=True)


def _write_sorted(file: Any, target: Path, bounds_deg: Box | None, known: set[int]) -> None:
    """Write the ways that are meant, and their nodes; sorted whether or not the file is."""
    wanted = osmium.IdTracker()
    near = None if bounds_deg is None else _nodes_within(file, bounds_deg)
    lines = osmium.FileProcessor(file, osmium.osm.WAY).with_filter(
        osmium.filter.KeyFilter("highway", "waterway")
    )
    for way in lines:
        if "highway" not in way.tags and not _is_named_water(way):
            continue
        _require_number(way)
        if near is None or way.id in known or near.contains_any_references(way):
            wanted.add_way(way.id)
            wanted.add_references(way)
    for node in osmium.FileProcessor(file, osmium.osm.NODE).with_filter(place_filter()):
        _require_number(node)
        if bounds_deg is None or _is_within(node, bounds_deg):
            wanted.add_node(node.id)
    in_order, last = True, (0, -(2**63))
    part = target.with_name(f"unsorted-{target.name}")
    with osmium.SimpleWriter(str(part), overwrite=True) as writer:
        for thing in osmium.FileProcessor(file).with_filter(wanted.id_filter()):
            place = (_KIND_ORDER[thing.type_str()], thing.id)
            in_order, last = in_order and place >= last, place
            writer.add(thing)
    if in_order:
        part.replace(target)
        return
    merge = osmium.MergeInputReader()
    merge.add_file(str(part))
    with osmium.SimpleWriter(str(target), overwrite=True) as writer:
        merge.apply(writer, simplify=False)
    part.unlink()


def _require_number(thing: Any) -> None:
    """Sets of numbers take memory by the greatest, and take none below 0."""
    if not 0 <= thing.id < MOST_NUMBER:
        raise ValueError(
            f"{thing.type_str()}{thing.id} has a number that OpenStreetMap gives nothing (an editor's, of what is not "
            "uploaded yet?)"
        )


def _is_named_water(way: Any) -> bool:
    return way.tags.get("waterway") in WATERS and "name" in way.tags


def _nodes_within(file: Any, box: Box) -> Any:
    nodes = osmium.IdTracker()
    for node in osmium.FileProcessor(file, osmium.osm.NODE):
        _require_number(node)
        if _is_within(node, box):
            nodes.add_node(node.id)
    return nodes


def _is_within(node: Any, box: Box) -> bool:
    west, south, east, north = box
    at = node.location
    return bool(at.valid() and west <= at.lon <= east and south <= at.lat <= north)


def _damaged(path: Path, error: Exception) -> RoadsError:
    return RoadsError(say("roads.damaged", file=path.name, error=str(error).rstrip(".")), where=path.name)
