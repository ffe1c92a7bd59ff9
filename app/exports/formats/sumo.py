"""Networks for SUMO with the heights of roads: one of one's own with heights put in, or all roads as plain XML.

Consumer: SUMO (``sumo``, ``netconvert`` 1.28). As ``.net.xml``: the network that ``net`` names, as ``netconvert`` or
``netedit`` left it, with the z of every shape (``app.exports.writing.sumo_net``); lanes, lights and turns stay as they
are. As ``.zip``: plain XML of the roads, which ``netconvert -c roads.netccfg`` builds; grammar: ``nodes_file.xsd``,
``edges_file.xsd``, ``types_file.xsd``. Places there are degrees with metres for z, which ``--proj.utm`` turns into a
plane. An edge is the part of a way between two junctions and is called after both, against the way with a minus.

``incline`` is a parameter of every edge: its mean slope in percent in its direction.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar
from xml.sax.saxutils import quoteattr

import numpy as np
from pydantic import Field

from app.core.messages import say
from app.exports.format import Format, NoOptions, Stated
from app.exports.writing.road_courses import Course, Courses, read_courses
from fusion.errors import BadOptionsError
from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats

if TYPE_CHECKING:
    from app.exports.source import Source

_DATE = (1980, 1, 1, 0, 0, 0)  # of every member of an archive, so that equal maps give equal bytes
_TYPES = {
    "motorway": (2, 39.44), "motorway_link": (1, 22.22), "trunk": (2, 27.78), "trunk_link": (1, 22.22),
    "primary": (1, 27.78), "primary_link": (1, 22.22), "secondary": (1, 27.78), "secondary_link": (1, 22.22),
    "tertiary": (1, 22.22), "tertiary_link": (1, 22.22), "unclassified": (1, 13.89), "residential": (1, 13.89),
    "living_street": (1, 2.78), "service": (1, 5.56), "track": (1, 5.56), "road": (1, 13.89),
}  # fmt: skip
"""Lanes in each direction, and m/s, where tags say neither; a class that comes first goes first at junctions."""


class SumoOptions(NoOptions):
    """Whose network."""

    local_files: ClassVar[frozenset[str]] = frozenset({"net"})

    net: Path | None = Field(
        None, description="Your network (.net.xml, also gzipped), all of which is kept; for a .net.xml alone."
    )


class Sumo(Format):
    """A network with heights."""

    name = "sumo"
    consumer = "SUMO (net.xml, or plain XML for netconvert)"
    suffixes = (".zip", ".net.xml")
    media_type = "application/zip"
    description = (
        f"Road network with heights and the slope of each edge, incline: of its own, or yours ({consumer})"
    )
    options = SumoOptions
    holds = "edges"

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the network; the number of edges."""
        if path.suffix.lower() == ".zip":
            return _write_plain(source, path, stated)
        if options.net is None:
            raise BadOptionsError(say("export.net_alone", format=self.name), where="net")
        from app.exports.writing.sumo_net import add_heights, read_net, write_net  # noqa: PLC0415 - reads XML

        root = read_net(options.net)
        edges, far = add_heights(root, read_courses(source, drivable=False))
        write_net(root, path)
        if far:
            source.note(say("export.net_far", n=far, all=edges))
        return edges


@dataclass(frozen=True)
class _Edge:
    course: Course
    against: bool

    @property
    def id(self) -> str:
        return f"-{self.course.name}" if self.against else self.course.name


def _write_plain(source: Source, path: Path, stated: Stated) -> int:
    roads = read_courses(source)
    edges = [
        _Edge(one, against)
        for one in roads.courses
        for against in (False, True)
        if not one.oneway or (one.oneway < 0) == against
    ]
    files = {
        "roads.nod.xml": _nodes(roads),
        "roads.edg.xml": _edges(roads, edges),
        "roads.typ.xml": _types(),
        "roads.netccfg": iter([_CONFIGURATION]),
        "README.txt": iter([_readme(stated)]),
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, lines in files.items():
            member = zipfile.ZipInfo(name, _DATE)
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as file:
                for line in lines:
                    file.write(line.encode())
    return len(edges)


def _nodes(roads: Courses) -> Iterator[str]:
    ends = np.unique(np.concatenate([one.row[[0, -1]] for one in roads.courses] or [np.empty(0, int)]))
    yield "<nodes>\n"
    for row in ends.tolist():
        lon, lat, height = roads.lon_deg[row], roads.lat_deg[row], roads.height_m[row]
        yield f'  <node id="{roads.node[row]}" x="{lon:.7f}" y="{lat:.7f}" z="{height:.3f}"/>\n'
    yield "</nodes>\n"


def _edges(roads: Courses, edges: list[_Edge]) -> Iterator[str]:
    yield "<edges>\n"
    for edge in edges:
        course = edge.course
        row = course.row[::-1] if edge.against else course.row
        place = np.column_stack([roads.lon_deg[row], roads.lat_deg[row], roads.height_m[row]])
        shape = " ".join(f"{lon:.7f},{lat:.7f},{z:.3f}" for lon, lat, z in place.tolist())
        told = {"id": edge.id, "from": str(roads.node[row[0]]), "to": str(roads.node[row[-1]]), "shape": shape,
                "type": f"highway.{course.highway}", "spreadType": "center" if course.oneway else "right",
                **_usual(course, against=edge.against)}  # fmt: skip
        if name := course.tags.get("name"):
            told["name"] = name
        attributes = " ".join(f"{key}={quoteattr(value)}" for key, value in told.items())
        slope = 100 * (place[-1, 2] - place[0, 2]) / max(float(lengths_m(place).sum()), 0.1)
        measured = float(roads.measured[row].mean())
        yield (
            f'  <edge {attributes}>\n    <param key="incline" value="{slope + 0.0:.2f}%"/>\n'
            f'    <param key="measured" value="{measured:.2f}"/>\n  </edge>\n'
        )
    yield "</edges>\n"


def lengths_m(place: Floats) -> Floats:
    """Lengths (k - 1,) between places (k, 2 or more) of longitude and latitude."""
    east = np.diff(place[:, 0]) * math.cos(math.radians(float(place[:, 1].mean())))
    return np.asarray(METRES_PER_DEGREE * np.hypot(east, np.diff(place[:, 1])))


def _usual(course: Course, *, against: bool) -> dict[str, str]:
    """Lanes and speed in this direction, where tags say them."""
    lanes, speed = course.lanes(against=against), course.speed_mps()
    return ({} if lanes is None else {"numLanes": str(lanes)}) | (
        {} if speed is None else {"speed": f"{speed:.2f}"}
    )


def _types() -> Iterator[str]:
    yield "<types>\n"
    for number, (name, (lanes, speed)) in enumerate(_TYPES.items()):
        yield f'  <type id="highway.{name}" numLanes="{lanes}" speed="{speed}" priority="{15 - number}"/>\n'
    yield "</types>\n"


_CONFIGURATION = """<configuration>
  <input>
    <node-files value="roads.nod.xml"/>
    <edge-files value="roads.edg.xml"/>
    <type-files value="roads.typ.xml"/>
  </input>
  <output>
    <output-file value="roads.net.xml"/>
  </output>
  <projection>
    <proj.utm value="true"/>
  </projection>
</configuration>
"""


def _readme(stated: Stated) -> str:
    statements = "".join(f"{name}: {text}\n" for name, text in sorted(stated.items()))
    return (
        "Roads with heights for SUMO, written by Versant: netconvert -c roads.netccfg builds roads.net.xml.\n"
        "incline of an edge is its mean slope in percent, measured the share of its nodes that drives measured.\n"
        "netconvert makes junctions level and lays what rises there upon the edges beside them. To have slopes go on\n"
        "through junctions: versant export --as sumo -o measured.net.xml --option net=roads.net.xml\n"
        f"Turn restrictions and traffic lights are not in it.\n{statements}"
    )
