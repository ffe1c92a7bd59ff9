"""An OpenStreetMap file whose road nodes all carry ``ele``, the height of the road.

Consumers, each by its sources: openrouteservice with ``elevation.preprocessed: true`` takes the tag ``ele`` of every
node of a road and reads a missing one as 0 m; OpenTripPlanner takes it where bridges, tunnels, embankments and
cuttings make it leave its elevation model; SUMO's ``netconvert --osm.elevation`` takes it of OSM XML. Grammar: OSM XML
0.6 or PBF; ``ele`` is a decimal number of metres without a unit.

So there is no road node without one. Heights are those of the network where drives measured them, and lead over into
those of the elevation model along the roads (``fusion.roads.node_heights``). An ``ele`` that a node had is replaced:
all are above one datum, which the file's header states as part of its generator, for OSM files have no other place.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import osmium
from pydantic import Field

from app.core.messages import say
from app.core.version import code_version
from app.exports.format import Format, NoOptions, Stated
from app.exports.writing.osm_files import FORMATS, RoadNodes, damage_told, merged, only, read_nodes, writing
from app.map.segment import HEIGHT_DATUM, Segment
from fusion.errors import BadOptionsError, RoadsError
from fusion.frames import METRES_PER_DEGREE
from fusion.roads.node_heights import NodeHeights, node_heights
from fusion.roads.osm import file_format
from fusion.types import Floats

if TYPE_CHECKING:
    from app.exports.source import Source

DIGITS = 2
MOVED_M = 20.0
"""A node of another file that lies farther from ours of the same number than this is another place."""


class EleOptions(NoOptions):
    """Which file gets the heights."""

    local_files: ClassVar[frozenset[str]] = frozenset({"osm"})

    osm: Path | None = Field(
        None, description="A file of your own, all of which is kept; else the roads of all regions."
    )


class OsmEle(Format):
    """Roads with heights, or a whole file with heights on its roads."""

    name = "osm-ele"
    consumer = "openrouteservice, OpenTripPlanner, SUMO (node tag ele)"
    suffixes = (".osm.pbf", ".osm", ".osm.gz")
    media_type = "application/octet-stream"
    description = f"OpenStreetMap file with the height of the road, ele, on every node of a road ({consumer})"
    options = EleOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the file; the number of nodes with ``ele``. ``RoadsError`` where no height is known at all."""
        if (form := FORMATS.get(path.suffix.lower())) is None:
            raise BadOptionsError(
                say("export.writes", file=path.name, format=self.name, names=", ".join(self.suffixes)),
                where="out",
            )
        own_roads = options.osm is None
        files = source.road_files if own_roads else (options.osm,)
        nodes = read_nodes(files, source.bbox if own_roads else None, roads_only=own_roads)
        heights = heights_of(source, nodes)
        generator = f"Versant {code_version()}; ele: metres above {_datum(source, heights, stated)}"
        if attribution := stated.get("attribution"):
            generator += f"; {attribution}"
        ele = dict(zip(nodes.node.tolist(), np.round(heights.height_m, DIGITS).tolist(), strict=True))
        with damage_told(files), writing(path, form, generator) as writer:
            if own_roads:
                had = _write_roads(writer, files, nodes, ele)
            else:
                had = _write_whole(writer, options.osm, nodes, ele)
        for text in _notes(nodes, heights, had):
            source.note(text)
        return len(ele)


@dataclass
class _Measured:
    """What segments say: heights of nodes as weighted sums, and rises of segments without heights."""

    weight: Floats
    sum_m: Floats
    rises: list[tuple[int, int, float]]


def heights_of(source: Source, nodes: RoadNodes) -> NodeHeights:
    """Heights of all nodes of roads; ``RoadsError`` where nothing is known of any."""
    graph = nodes.graph
    measured = _measured(source, nodes)
    with np.errstate(invalid="ignore"):
        known = measured.sum_m / measured.weight  # NaN where nothing was measured
    ground = source.ground_heights(graph.lon_deg, graph.lat_deg)
    try:
        return node_heights(graph, ground, known, _rises(nodes, measured.rises))
    except ValueError as error:
        raise RoadsError(say("export.no_height")) from error


def _measured(source: Source, nodes: RoadNodes) -> _Measured:
    measured = _Measured(np.zeros(len(nodes.node)), np.zeros(len(nodes.node)), [])
    segments = (segment for segment in source.segments(gaps=True) if segment.slope_percent is not None)
    while part := list(islice(segments, 10_000)):
        _add(measured, nodes, part)
    return measured


def _add(measured: _Measured, nodes: RoadNodes, part: list[Segment]) -> None:
    """Add what some segments say; of ends that are not where the file has the node, nothing."""
    ends = np.array([(s.from_node, s.to_node) for s in part], np.int64).reshape(-1, 2)
    place = np.array([(*s.coordinates[0], *s.coordinates[-1]) for s in part]).reshape(-1, 2, 2)
    rows = nodes.rows(ends.ravel()).reshape(-1, 2)
    east = (place[..., 0] - nodes.graph.lon_deg[rows]) * np.cos(np.radians(place[..., 1]))
    off_m = METRES_PER_DEGREE * np.hypot(east, place[..., 1] - nodes.graph.lat_deg[rows])
    rows = np.where(off_m <= MOVED_M, rows, -1)
    for segment, (a, b) in zip(part, rows.tolist(), strict=True):
        weight = max(segment.height_sigma_m or 1.0, 1e-3) ** -2
        if segment.height_from_m is None or segment.height_to_m is None:
            if a >= 0 and b >= 0 and segment.slope_percent is not None:
                measured.rises.append((a, b, segment.slope_percent / 100 * segment.length_m))
            continue
        for row, height in ((a, segment.height_from_m), (b, segment.height_to_m)):
            if row >= 0:
                measured.weight[row] += weight
                measured.sum_m[row] += weight * height


def _rises(nodes: RoadNodes, rises: list[tuple[int, int, float]]) -> Floats | None:
    """The rises as a column of the graph's edges, NaN unknown."""
    if not rises:
        return None
    by_edge = {(a, b): rise for a, b, rise in rises} | {(b, a): -rise for a, b, rise in rises}
    return np.array([by_edge.get((a, b), np.nan) for a, b in nodes.graph.edge.tolist()])


def _datum(source: Source, heights: NodeHeights, stated: Stated) -> str:
    if heights.measured.any():
        return stated.get("height_datum", HEIGHT_DATUM)
    return source.ground_datum() or "the datum of the elevation model"


def _add_node(writer: Any, node: Any, ele_m: float) -> bool:
    """Write the node with its height; whether it had one."""
    tags = {tag.k: tag.v for tag in node.tags}
    writer.add_node(node.replace(tags=tags | {"ele": f"{ele_m:.{DIGITS}f}"}))
    return "ele" in tags


def _write_roads(writer: Any, files: Any, nodes: RoadNodes, ele: dict[int, float]) -> int:
    """Write the roads of regions; how many nodes had a height before."""
    had, ways = 0, set(nodes.way.tolist())
    for thing in merged(files):
        if thing.is_node():
            if (height := ele.get(thing.id)) is not None:
                had += _add_node(writer, thing, height)
        elif thing.id in ways:
            writer.add_way(thing)
    return had


def _write_whole(writer: Any, path: Path, nodes: RoadNodes, ele: dict[int, float]) -> int:
    """Write all that the file has, in its order; only nodes of roads come by here, the rest is passed on by osmium."""
    had = 0
    objects = osmium.FileProcessor(osmium.io.File(str(path), file_format(path)))
    for thing in only(objects.handler_for_filtered(writer), nodes.node):
        if thing.is_node() and thing.id in ele:
            had += _add_node(writer, thing, ele[thing.id])
        else:
            writer.add(thing)
    return had


def _notes(nodes: RoadNodes, heights: NodeHeights, had: int) -> list[str]:
    n, measured = len(nodes.node), int(heights.measured.sum())
    spanned, guessed = int(heights.spanned.sum()), int(heights.guessed.sum())
    sentences = [
        f"{n} nodes of roads have a height: {measured} measured, {n - measured - spanned - guessed} by the elevation "
        f"model, {spanned} spanned over bridges, tunnels and their approaches, and voids of the model."
    ]
    if measured:
        sentences.append(say("export.shifted", offset_m=heights.offset_m))
    if guessed:
        sentences.append(say("export.guessed", n=guessed))
    if had:
        sentences.append(say("export.replaced", n=had))
    return sentences
