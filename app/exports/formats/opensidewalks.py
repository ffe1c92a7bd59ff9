"""Roads as OpenSidewalks edges with ``incline``, for planners of walks and wheelchair routes.

Consumer: whatever reads the OpenSidewalks schema 0.3 (``opensidewalks.schema.json``). Grammar: a GeoJSON
FeatureCollection with ``$schema``; nodes are Points with a text ``_id``; edges are LineStrings with texts ``_id``,
``_u_id`` and ``_v_id``, and of each kind of edge only the properties that the schema lists, or ones that begin with
``ext:``. ``incline`` is a ratio of -1 to 1, positive uphill from u to v. The schema means the steepest part of the
edge; so does this file, where nobody asks for the mean.

Kinds of road that the schema does not know are its custom edges, which have no ``incline`` of their own: there it is
``ext:incline``. Motorways are left out: nobody walks there.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from app.core.text import dumps, rounded
from app.exports.format import Format, NoOptions, Stated
from app.map.segment import Segment

if TYPE_CHECKING:
    from app.exports.source import Source

SCHEMA = "https://sidewalks.washington.edu/opensidewalks/0.3/schema.json"
KINDS = frozenset(
    {"trunk", "primary", "secondary", "tertiary", "residential", "unclassified", "service", "living_street"}
)
"""Values of ``highway`` that are kinds of edges in the schema by themselves."""
LEFT_OUT = frozenset({"motorway", "motorway_link"})
DIGITS = 4  # of a ratio: 0.01 %


class Which(StrEnum):
    """Which slope of an edge is its incline."""

    STEEPEST = "steepest"
    MEAN = "mean"


class SidewalkOptions(NoOptions):
    """Which slopes, and of which edges."""

    incline: Which = Field(Which.STEEPEST, description="steepest: of the steepest 20 m; mean: of the edge.")
    measured: bool = Field(False, description="Only edges whose slope was measured.")


class OpenSidewalks(Format):
    """Edges of roads with their inclines, and the nodes between them."""

    name = "opensidewalks"
    consumer = "OpenSidewalks schema 0.3"
    suffixes = (".geojson",)
    media_type = "application/geo+json"
    description = (
        f"Roads as edges of a walking network with their incline, and the nodes between them ({consumer})"
    )
    options = SidewalkOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write edges and nodes; the number of edges."""
        head = {"type": "FeatureCollection", "$schema": SCHEMA, "dataSource": {"name": "Versant", **stated}}
        seen: set[int] = set()
        count = 0
        with path.open("w", encoding="utf-8") as file:
            file.write(dumps(head)[:-1] + ',"features":[')
            for segment in source.segments(gaps=True):
                if segment.highway in LEFT_OUT or (options.measured and segment.slope_percent is None):
                    continue
                features = [*_nodes(segment, seen), _edge(segment, options.incline)]
                file.write(("," if count else "") + ",\n".join(map(dumps, features)) + "\n")
                count += 1
            file.write("]}\n")
        return count


def _nodes(segment: Segment, seen: set[int]) -> Iterator[dict[str, Any]]:
    ends = (segment.from_node, segment.to_node)
    for node, place in zip(ends, segment.rounded_coordinates(), strict=True):
        if node not in seen:
            seen.add(node)
            geometry = {"type": "Point", "coordinates": list(place)}
            yield {"type": "Feature", "geometry": geometry, "properties": {"_id": node_id(node)}}


def _edge(segment: Segment, which: Which) -> dict[str, Any]:
    known = segment.highway in KINDS
    properties: dict[str, Any] = {
        "_id": f"s{segment.stored_id}",
        "_u_id": node_id(segment.from_node),
        "_v_id": node_id(segment.to_node),
        "highway" if known else "ext:highway": segment.highway,
        "length" if known else "ext:length": rounded(segment.length_m, 2),
        "name" if known else "ext:name": segment.name,
        "incline" if known else "ext:incline": incline_of(segment, which),
        "ext:incline_sigma": _ratio(segment.slope_sigma_percent),
        "ext:drives": segment.drives,
        "ext:osm_way_id": segment.osm_way_id,
    }
    given = {name: value for name, value in properties.items() if value is not None}
    return {"type": "Feature", "geometry": segment.geometry(), "properties": given}


def incline_of(segment: Segment, which: Which) -> float | None:
    """The incline, a ratio within -1 to 1; None where nothing was measured."""
    steepest = segment.steepest_percent if which is Which.STEEPEST else None
    ratio = _ratio(segment.slope_percent if steepest is None else steepest)
    return None if ratio is None else min(max(ratio, -1.0), 1.0)


def node_id(node: int) -> str:
    """A node's name in the file."""
    return f"n{node}"


def _ratio(percent: float | None) -> float | None:
    return None if percent is None else rounded(percent / 100, DIGITS)
