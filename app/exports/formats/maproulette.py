"""Proposals of ``incline`` for MapRoulette: one task for each steep section, which a person looks at and decides.

Consumer: MapRoulette, a challenge from a local file in its line-by-line form. Grammar: a GeoJSON text sequence (RFC
7464): each task is the byte RS, one GeoJSON FeatureCollection on one line, and LF. For sections that are a whole way
the task is cooperative, a tag fix: the member ``cooperativeWork`` with ``{meta: {version: 2, type: 1}, operations:
[{operationType: "modifyElement", data: {id: "way/N", operations: [{operation: "setTags", data: {incline: ...}}]}}]}``.

A tag fix cannot split a way, and a tag on the whole of a way that is steep in part would be wrong. So sections that
want a split come in a file of their own (``kind=split``), an ordinary challenge, whose tasks name the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from app.core.messages import say
from app.core.text import COORDINATE_DIGITS, dumps
from app.exports.format import Format, Stated
from app.exports.writing.inclines import InclineOptions, Section, proposals
from app.exports.writing.osm_files import OsmNode
from app.map.segment import OSM_ATTRIBUTION

if TYPE_CHECKING:
    from app.exports.source import Source

RECORD = "\x1e"


class Tasks(StrEnum):
    """Which sections become tasks."""

    TAGS = "tags"
    SPLIT = "split"


class TaskOptions(InclineOptions):
    """What is beyond doubt, and which tasks."""

    kind: Tasks = Field(Tasks.TAGS, description="tags: whole ways, as tag fixes; split: parts of ways.")


class MapRoulette(Format):
    """Tasks, one a line."""

    name = "maproulette"
    consumer = "MapRoulette (line-by-line GeoJSON, cooperative tag fixes)"
    suffixes = (".geojsonl", ".geojson")
    media_type = "application/geo+json-seq"
    description = (
        f"Proposals of incline=* for people to review, never an edit: a MapRoulette challenge ({consumer})"
    )
    options = TaskOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the tasks; their number."""
        count = other = 0
        with path.open("w", encoding="utf-8", newline="\n") as file:
            for _, sections, nodes in proposals(source, options):
                for section in sections:
                    if section.whole != (options.kind is Tasks.TAGS):
                        other += 1
                        continue
                    file.write(f"{RECORD}{dumps(task(section, nodes, stated))}\n")
                    count += 1
        if other:
            missing = Tasks.SPLIT if options.kind is Tasks.TAGS else Tasks.TAGS
            source.note(say("export.other_kind", n=other, kind=missing))
        return count


def task(section: Section, nodes: Mapping[int, OsmNode], stated: Stated) -> dict[str, Any]:
    """One task as a FeatureCollection."""
    line = [
        [round(nodes[n].lon_deg, COORDINATE_DIGITS), round(nodes[n].lat_deg, COORDINATE_DIGITS)]
        for n in section.way.nodes[section.first : section.last + 1]
    ]
    way = f"way/{section.way.id}"
    properties = {
        "@id": way,
        "id": f"{way}/{section.from_node}/{section.to_node}",
        "incline_proposed": section.value,
        "incline_today": section.tagged,
        "from_node": section.from_node,
        "to_node": section.to_node,
        "length_m": round(section.length_m, 1),
        "mean_percent": round(section.mean_percent, 1),
        "sigma_percent": round(section.sigma_percent, 2),
        "drives": section.drives,
        "instruction": section.describe(),
        "attribution": stated.get("attribution", OSM_ATTRIBUTION),
    }
    geometry = {"type": "LineString", "coordinates": line}
    feature = {"type": "Feature", "geometry": geometry, "properties": properties}
    collection: dict[str, Any] = {"type": "FeatureCollection", "features": [feature]}
    if section.whole:
        change = {"operation": "setTags", "data": {"incline": section.value}}
        collection["cooperativeWork"] = {
            "meta": {"version": 2, "type": 1},
            "operations": [{"operationType": "modifyElement", "data": {"id": way, "operations": [change]}}],
        }
    return collection
