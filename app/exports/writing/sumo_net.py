"""Heights in a network that netconvert built: nothing of it changes but the z of its shapes.

Grammar: SUMO's ``net.xml`` (``data/xsd/net_file.xsd``): shapes are ``x,y`` or ``x,y,z`` in metres of the projection and
offset of ``location``; the simulator takes the slope under a vehicle from the z of its lane's shape.

Each place of an edge takes the height of the road near it: of the way whose number the edge has in its name or as
``origId`` before others, and of one that goes in its direction. Lanes have the height of their edge beside them, lanes
within a junction go evenly from the lane before to the lane after. So slopes go on through junctions, which netconvert
itself makes level, with what rises there laid upon the shortened edges.

``incline`` of an edge is its mean slope in its direction, under the key and in the form of OpenStreetMap, as netconvert
keeps a tag that it does not know; SUMO's maintainers want an attribute of that name (issue 12160), which no version
reads yet.
"""

from __future__ import annotations

import gzip
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, ElementTree, ParseError, SubElement

import numpy as np
import shapely
from pyproj import Proj
from pyproj.exceptions import ProjError

from app.core.messages import say
from fusion.errors import BadOptionsError
from fusion.types import Floats, Ints

if TYPE_CHECKING:
    from app.exports.writing.road_courses import Courses

REACH_M = 25.0
"""An edge farther from every road than this takes the height of the nearest one, and is counted."""
OTHER_WAY_M = 15.0
"""A road that the edge does not name counts as if it were so much farther away."""
ACROSS_M = 25.0
"""The same of one at a right angle to it."""
STEP_M = 10.0
"""Places along lanes are at most so far apart."""
Z_DIGITS = 3
_EDGE = re.compile(r"-?(\d+)(?:#.*)?(?:-AddedO\w+Edge)?$")


def read_net(path: Path) -> Element:
    """The network's document, gzipped or not; ``BadOptionsError`` where it is none."""
    from defusedxml.ElementTree import parse  # noqa: PLC0415 - which few need

    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as file:
            root = parse(file).getroot()
    except (OSError, EOFError, ParseError, ValueError) as error:
        raise BadOptionsError(say("export.cannot_be_read", file=path, error=error), where="net") from error
    if root is None or root.tag != "net" or root.find("location") is None:
        raise BadOptionsError(say("export.no_net", file=path.name), where="net")
    return root


def write_net(root: Element, path: Path) -> None:
    """Write the document, as XML without a declaration of its own beyond the first line."""
    ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)


def add_heights(root: Element, courses: Courses) -> tuple[int, int]:
    """Give every shape of the network its z; how many edges there are, and how many of them no road is near."""
    roads = _Roads.of(courses, *_plane(root))
    junctions = {one.attrib["id"]: one for one in root.findall("junction")}
    edges = [one for one in root.findall("edge") if one.get("function") != "internal"
             and one.get("from") in junctions and one.get("to") in junctions]  # fmt: skip
    lines = [_dense(_centre(edge, junctions)) for edge in edges]
    z, far = roads.heights(lines, [_ways_of(edge) for edge in edges])
    lanes: dict[str, Floats] = {}
    for edge, line, height in zip(edges, lines, z, strict=True):
        _edge(edge, np.column_stack([line, height]), lanes)
    inside = _inside(root, lanes)
    _junctions(root, junctions, lanes, inside)
    return len(edges), far


def _plane(root: Element) -> tuple[Proj, Floats]:
    location = root.find("location")
    told = "" if location is None else location.get("projParameter", "!")
    try:
        plane = Proj(told)
    except ProjError as error:
        raise BadOptionsError(say("export.net_nowhere"), where="net") from error
    return plane, np.array(
        (location.get("netOffset", "0,0") if location is not None else "0,0").split(","), float
    )


@dataclass(frozen=True, eq=False)
class _Roads:
    """m pieces of roads in the plane of the network: both ends (m, 3), their ways (m,)."""

    start: Floats
    end: Floats
    way: Ints
    tree: shapely.STRtree

    @classmethod
    def of(cls, courses: Courses, plane: Proj, offset_m: Floats) -> _Roads:
        x, y = plane(courses.lon_deg, courses.lat_deg)
        place = np.column_stack([x + offset_m[0], y + offset_m[1], courses.height_m])
        a = np.concatenate([one.row[:-1] for one in courses.courses])
        b = np.concatenate([one.row[1:] for one in courses.courses])
        way = np.repeat([one.way for one in courses.courses], [len(one.row) - 1 for one in courses.courses])
        lines = shapely.linestrings(np.stack([place[a, :2], place[b, :2]], axis=1))
        return cls(place[a], place[b], way.astype(np.int64), shapely.STRtree(lines))

    def heights(self, lines: list[Floats], ways: list[set[int]]) -> tuple[list[Floats], int]:
        """Heights at all places of lines (each (k, 2)), and of how many lines no road is near."""
        sizes = [len(line) for line in lines]
        if not sizes:
            return [], 0
        places, first = np.concatenate(lines), np.cumsum(sizes)[:-1]
        line = np.repeat(np.arange(len(lines)), sizes)
        points = shapely.points(places)
        at, piece = self.tree.query(points, predicate="dwithin", distance=REACH_M)
        alone = np.setdiff1d(np.arange(len(places)), at)
        at, piece = np.r_[at, alone], np.r_[piece, self.tree.nearest(points[alone])]
        off, share = self._beside(places[at], piece)
        mine = np.array([int(w) in ways[k] for k, w in zip(line[at], self.way[piece], strict=True)], bool)
        along = np.concatenate([_directions(one) for one in lines])[at]
        run = self.end[piece, :2] - self.start[piece, :2]
        sine = (along[:, 0] * run[:, 1] - along[:, 1] * run[:, 0]) / np.maximum(np.hypot(*run.T), 1e-9)
        cost = off + np.where(mine, 0.0, OTHER_WAY_M) + ACROSS_M * np.abs(sine)
        order = np.lexsort((piece, cost, at))
        best = order[np.r_[True, np.diff(at[order]) != 0]]
        z = self.start[piece, 2] + share * (self.end[piece, 2] - self.start[piece, 2])
        return np.split(z[best], first), len(np.setdiff1d(line[alone], line[np.setdiff1d(at, alone)]))

    def _beside(self, places: Floats, piece: Ints) -> tuple[Floats, Floats]:
        a, run = self.start[piece, :2], self.end[piece, :2] - self.start[piece, :2]
        share = np.clip(((places - a) * run).sum(1) / np.maximum((run**2).sum(1), 1e-9), 0, 1)
        return np.hypot(*(places - a - share[:, None] * run).T), share


def _ways_of(edge: Element) -> set[int]:
    """Numbers of ways that an edge names."""
    said = [one.get("value", "") for one in edge.iter("param") if one.get("key") == "origId"]
    found = _EDGE.match(edge.attrib["id"])
    numbers = [*" ".join(said).replace("-", "").split(), *(found.groups() if found else ())]
    return {int(number) for number in numbers if number.isdigit()}


def _shape(text: str) -> Floats:
    """Places (k, 2) of a shape, without its heights."""
    return np.array([place.split(",")[:2] for place in text.split()], float)


def _text(places: Floats) -> str:
    return " ".join(f"{x:.2f},{y:.2f},{z:.{Z_DIGITS}f}" for x, y, z in places.tolist())


def _centre(edge: Element, junctions: dict[str, Element]) -> Floats:
    if "shape" in edge.attrib:
        return _shape(edge.attrib["shape"])
    ends = [junctions[edge.attrib[name]] for name in ("from", "to")]
    return np.array([[float(one.attrib["x"]), float(one.attrib["y"])] for one in ends])


def _along(line: Floats) -> Floats:
    return np.asarray(np.r_[0.0, np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])


def _dense(line: Floats) -> Floats:
    """The line with places between its own, so that none are farther apart than ``STEP_M``."""
    along = _along(line)
    inner = [np.linspace(a, b, max(1, int(np.ceil((b - a) / STEP_M))) + 1)[:-1]
             for a, b in pairwise(along)]  # fmt: skip
    at = np.r_[np.concatenate([*inner, np.empty(0)]), along[-1]]
    return np.column_stack([np.interp(at, along, line[:, k]) for k in range(line.shape[1])])


def _directions(line: Floats) -> Floats:
    run = np.gradient(line, axis=0) if len(line) > 1 else np.zeros((1, 2))
    return np.asarray(run / np.maximum(np.hypot(*run.T), 1e-9)[:, None])


def _edge(edge: Element, line: Floats, lanes: dict[str, Floats]) -> None:
    """Write the heights of an edge's line (k, 3) to its lanes, and its slope; ``lanes`` keeps their shapes."""
    along, course = _along(line), shapely.linestrings(line[:, :2])
    edge.set("shape", _text(line))
    for lane in edge.findall("lane"):
        shape = _dense(_shape(lane.attrib["shape"]))
        beside = shapely.line_locate_point(course, shapely.points(shape))
        lanes[lane.attrib["id"]] = np.column_stack([shape, np.interp(beside, along, line[:, 2])])
        lane.set("shape", _text(lanes[lane.attrib["id"]]))
    for old in [one for one in edge.findall("param") if one.get("key") == "incline"]:
        edge.remove(old)
    slope = 100 * (line[-1, 2] - line[0, 2]) / max(float(along[-1]), 0.1)
    SubElement(edge, "param", key="incline", value=f"{slope + 0.0:.2f}%")


def _inside(root: Element, lanes: dict[str, Floats]) -> dict[str, Floats]:
    """Give the lanes within junctions heights that go evenly from the lane before to the one after; their shapes."""
    inner = {lane.attrib["id"]: lane for edge in root.findall("edge") if edge.get("function") == "internal"
             for lane in edge.findall("lane")}  # fmt: skip
    goes_on = {f"{c.attrib['from']}_{c.attrib['fromLane']}": c.get("via") for c in root.findall("connection")
               if c.attrib["from"].startswith(":")}  # fmt: skip
    shapes: dict[str, Floats] = {}
    for c in root.findall("connection"):
        before, after = (lanes.get(f"{c.attrib[a]}_{c.attrib[f'{a}Lane']}") for a in ("from", "to"))
        via, chain = c.get("via"), []
        while via in inner and via not in chain:
            chain.append(via)
            via = goes_on.get(via)
        if before is None or after is None or not chain:
            continue
        parts = [_shape(inner[name].attrib["shape"]) for name in chain]
        length = np.cumsum([0.0, *(float(_along(part)[-1]) for part in parts)])
        for name, part, start in zip(chain, parts, length[:-1], strict=True):
            share = (start + _along(part)) / max(float(length[-1]), 1e-9)
            shapes[name] = np.column_stack([part, before[-1, 2] + share * (after[0, 2] - before[-1, 2])])
            inner[name].set("shape", _text(shapes[name]))
    return shapes


def _junctions(
    root: Element, junctions: dict[str, Element], lanes: dict[str, Floats], inside: dict[str, Floats]
) -> None:
    """Junctions lie at the mean height of the lanes that come there; so do crossings and walking areas."""
    shapes, edges = lanes | inside, root.findall("edge")
    level = {
        edge.attrib["from"]: float(lanes[lane.attrib["id"]][0, 2])
        for edge in edges
        for lane in edge.findall("lane")
        if lane.attrib["id"] in lanes
    }
    for name, junction in junctions.items():
        if there := [shapes[lane][-1, 2] for lane in junction.get("incLanes", "").split() if lane in shapes]:
            level[name] = float(np.mean(there))
        if name in level:
            junction.set("z", f"{level[name]:.{Z_DIGITS}f}")
            _level(junction, level[name])
    for edge in edges:
        name = edge.attrib["id"][1:].rsplit("_", 1)[0]
        if edge.get("function") in ("crossing", "walkingarea") and name in level:
            for lane in edge.findall("lane"):
                _level(lane, level[name])


def _level(element: Element, height_m: float) -> None:
    if text := element.get("shape"):
        shape = _shape(text)
        element.set("shape", _text(np.column_stack([shape, np.full(len(shape), height_m)])))
