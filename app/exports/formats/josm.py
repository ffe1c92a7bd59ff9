"""Proposals of ``incline`` for JOSM: ways that are steep in part, split where it belongs, as a layer to look at.

Consumer: JOSM. Grammar: its OSM XML: ``<osm version="0.6" upload="never" download="never">`` with nodes, then ways,
each with ``id`` and ``version``; new ones have negative numbers and no version; changed ones ``action="modify"``.

The layer cannot be uploaded: it is a suggestion. Who agrees downloads the present state into another layer and does the
same there, with the relations that the way is part of, which this file does not have. The piece with the most nodes
keeps the way's number, as where JOSM splits; all pieces keep its tags, and on steep ones ``incline`` is as proposed. A
node of its own beside each steep piece has a ``note`` with what was measured. Where the file had no versions,
``version`` is 1, since JOSM opens no file without.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

from app.core.messages import say
from app.core.version import code_version
from app.exports.format import Format, Stated
from app.exports.writing.inclines import InclineOptions, Section, proposals
from app.exports.writing.osm_files import OsmNode, OsmWay

if TYPE_CHECKING:
    from app.exports.source import Source

_UNKNOWN_VERSION = 1
_BESIDE_DEG = 3e-5
"""By which notes lie north of the road, some 3 m: on it they would be taken for its own nodes."""
_NOT_IN_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")


@dataclass(frozen=True)
class Piece:
    """A part of a way between two positions in it, and the value proposed for it."""

    first: int
    last: int
    section: Section | None


class Josm(Format):
    """Split ways with proposed tags."""

    name = "josm"
    consumer = "JOSM (OSM XML with upload=never)"
    suffixes = (".osm",)
    media_type = "application/vnd.openstreetmap.data+xml"
    description = (
        "Proposals of incline=* for people to review, never an edit: ways split where it is steep "
        f"({consumer})"
    )
    options = InclineOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write nodes and ways; the number of steep pieces."""
        proposed = list(proposals(source, options))
        versions = all(way.version for way, _, _ in proposed)
        with path.open("w", encoding="utf-8", newline="\n") as file:
            generator = (
                f"Versant {code_version()}; a suggestion, nothing to upload; {stated.get('attribution', '')}"
            )
            file.write(
                f'<?xml version=\'1.0\' encoding=\'UTF-8\'?>\n<osm version="0.6" upload="never" download="never" '
                f"generator={quoteattr(generator)}>\n"
            )
            file.writelines(_nodes(proposed))
            numbers = count(-1, -1)
            steep = [(section, nodes) for _, sections, nodes in proposed for section in sections]
            file.writelines(_note(next(numbers), section, nodes, stated) for section, nodes in steep)
            for way, sections, _ in proposed:
                file.writelines(layer_ways(way, sections, numbers))
            file.write("</osm>\n")
        if proposed and not versions:
            source.note(say("export.no_versions"))
        return len(steep)


def pieces(way: OsmWay, sections: list[Section]) -> list[Piece]:
    """The way cut at the ends of its sections; a section that is the whole way is one piece."""
    if len(sections) == 1 and sections[0].whole:
        return [Piece(0, len(way.nodes) - 1, sections[0])]
    cuts = sorted({0, len(way.nodes) - 1, *(s.first for s in sections), *(s.last for s in sections)})
    by_ends = {(s.first, s.last): s for s in sections}
    return [Piece(a, b, by_ends.get((a, b))) for a, b in pairwise(cuts)]


def _nodes(proposed: list[tuple[OsmWay, list[Section], Mapping[int, OsmNode]]]) -> Iterator[str]:
    """All nodes of the ways, each once, by number."""
    places = {node: nodes[node] for way, _, nodes in proposed for node in way.nodes}
    for number, node in sorted(places.items()):
        version = node.version or _UNKNOWN_VERSION
        yield f'  <node id="{number}" version="{version}" lat="{node.lat_deg:.7f}" lon="{node.lon_deg:.7f}"/>\n'


def _note(number: int, section: Section, nodes: Mapping[int, OsmNode], stated: Stated) -> str:
    """A node beside the middle of a section that tells what was measured."""
    middle = (section.first + section.last) // 2
    one, other = (nodes[node] for node in section.way.nodes[middle : middle + 2])
    lat = 0.5 * (one.lat_deg + other.lat_deg) + _BESIDE_DEG
    lon = 0.5 * (one.lon_deg + other.lon_deg)
    tags = {"note": section.describe(), "source": stated.get("attribution", "")}
    return f'  <node id="{number}" lat="{lat:.7f}" lon="{lon:.7f}">\n{_tags(tags)}  </node>\n'


def layer_ways(way: OsmWay, sections: list[Section], numbers: Iterator[int]) -> Iterator[str]:
    """The pieces of a way as XML; new ones take their numbers."""
    parts = pieces(way, sections)
    largest = max(parts, key=lambda piece: (piece.last - piece.first, -piece.first))
    for piece in parts:
        head = f'id="{way.id}" version="{way.version or _UNKNOWN_VERSION}"'
        if piece is not largest:
            head = f'id="{next(numbers)}"'
        tags = dict(way.tags)
        if piece.section is not None:
            tags["incline"] = piece.section.value
        refs = "".join(f'    <nd ref="{node}"/>\n' for node in way.nodes[piece.first : piece.last + 1])
        yield f'  <way {head} action="modify">\n{refs}{_tags(tags)}  </way>\n'


def _tags(tags: Mapping[str, str]) -> str:
    return "".join(f"    <tag k={_quoted(k)} v={_quoted(v)}/>\n" for k, v in sorted(tags.items()))


def _quoted(text: str) -> str:
    """As an attribute; without the characters that a file may hold and XML may not."""
    return quoteattr(_NOT_IN_XML.sub("", text))
