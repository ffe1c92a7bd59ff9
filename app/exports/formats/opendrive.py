"""Roads with their elevation profiles for driving simulators: OpenDRIVE.

Consumers: CARLA, esmini, SUMO (``netconvert --opendrive-files``). Grammar: ASAM OpenDRIVE 1.4 (``OpenDRIVE_1.4H.xsd``):
a road is a course of ``app.exports.writing.road_courses``, its reference line the way as it is drawn (straight pieces),
its lanes those of the tags, to the right in the direction of s, to the left against it; one-way roads lie in the middle
of their lanes. Places are metres of a transverse Mercator projection, which ``geoReference`` states.

    <elevation s a b c d/>      height a + b ds + c ds^2 + d ds^3 from s on, ds = s - its own s

Between two nodes it is the cubic that has the heights of both, and at each the grade of the parabola through the node
and its neighbours: heights and grades have no step along a road. Where roads meet, heights are the same; grades are
each road's own.

Roads that are continued by just one other are linked. There are no ``junction`` elements, no connecting roads, no
superelevation, signals and objects: who drives from road to road needs them from a program that makes them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from pydantic import Field

from app.exports.format import Format, NoOptions, Stated
from app.exports.writing.road_courses import Course, Courses, read_courses
from fusion.frames import LocalProjection
from fusion.types import Floats, Ints

if TYPE_CHECKING:
    from app.exports.source import Source

SHORTEST_M = 0.01
_TYPES = {"motorway": "motorway", "trunk": "rural", "primary": "rural", "secondary": "rural",
          "residential": "town", "living_street": "lowSpeed", "service": "lowSpeed"}  # fmt: skip


class OpenDriveOptions(NoOptions):
    """How wide lanes are."""

    lane_width_m: float = Field(3.25, ge=2, le=5, description="Width of every lane.")


@dataclass(frozen=True, eq=False)
class _Road:
    """A road in its direction of s: places (k, 2) of nodes, their heights (k,), s (k,), rows of both ends."""

    course: Course
    place_m: Floats
    height_m: Floats
    s_m: Floats
    ends: tuple[int, int]


class OpenDrive(Format):
    """Roads with cubic heights."""

    name = "opendrive"
    consumer = "CARLA, esmini, SUMO (OpenDRIVE 1.4)"
    suffixes = (".xodr",)
    media_type = "application/xml"
    description = f"Roads with their heights as cubics along them, elevationProfile ({consumer})"
    options = OpenDriveOptions
    holds = "roads"

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the file; the number of roads."""
        courses = read_courses(source)
        plane = LocalProjection.around(courses.lon_deg, courses.lat_deg)
        xy = np.column_stack(plane.to_xy(courses.lon_deg, courses.lat_deg))
        roads = [road for one in courses.courses if (road := _road(one, courses, xy)) is not None]
        links = _links(roads)
        with path.open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(_header(plane, xy, stated))
            for number, road in enumerate(roads):
                file.writelines(_written(number, road, links, options.lane_width_m))
            file.write("</OpenDRIVE>\n")
        return len(roads)


def _road(course: Course, courses: Courses, xy: Floats) -> _Road | None:
    """The road, against the way where traffic goes against it; None of one without length."""
    row = course.row[::-1] if course.oneway < 0 else course.row
    apart = np.hypot(*np.diff(xy[row], axis=0).T)
    row = row[np.r_[True, apart >= SHORTEST_M]]
    if len(row) < 2:
        return None
    s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy[row], axis=0).T))]
    return _Road(course, xy[row], courses.height_m[row], s, (int(row[0]), int(row[-1])))


Link = tuple[int, str]
"""A road's number, and which of its ends is there."""


def _links(roads: list[_Road]) -> dict[Link, Link]:
    """Where just two ends of roads meet, each one's other."""
    at: dict[int, list[Link]] = {}
    for number, road in enumerate(roads):
        for node, end in zip(road.ends, ("start", "end"), strict=True):
            at.setdefault(node, []).append((number, end))
    pairs = [both for both in at.values() if len(both) == 2]
    return {one: other for a, b in pairs for one, other in ((a, b), (b, a))}


def _header(plane: LocalProjection, xy: Floats, stated: Stated) -> Iterator[str]:
    (west, south), (east, north) = xy.min(axis=0).tolist(), xy.max(axis=0).tolist()
    yield '<?xml version="1.0" encoding="UTF-8"?>\n<OpenDRIVE>\n'
    yield (
        f'  <header revMajor="1" revMinor="4" name="roads" version="1" vendor="Versant" north="{north:.2f}" '
        f'south="{south:.2f}" east="{east:.2f}" west="{west:.2f}">\n'
        f"    <geoReference><![CDATA[+proj=tmerc +lat_0={plane.lat0_deg} +lon_0={plane.lon0_deg} +k=1 +x_0=0 +y_0=0 "
        "+datum=WGS84 +units=m +no_defs]]></geoReference>\n"
    )
    for name, value in sorted(stated.items()):
        yield f"    <userData code={quoteattr(name)} value={quoteattr(value)}/>\n"
    yield "  </header>\n"


def _written(number: int, road: _Road, links: dict[Link, Link], width_m: float) -> Iterator[str]:
    course = road.course
    yield (
        f'  <road name={quoteattr(course.tags.get("name", ""))} length="{road.s_m[-1]:.4f}" id="{number}" '
        'junction="-1">\n    <link>'
    )
    for tag, end in (("predecessor", "start"), ("successor", "end")):
        if other := links.get((number, end)):
            yield f'<{tag} elementType="road" elementId="{other[0]}" contactPoint="{other[1]}"/>'
    kind = _TYPES.get(course.highway.removesuffix("_link"), "town")
    speed = course.speed_mps()
    limit = "/>" if speed is None else f'><speed max="{speed:.2f}" unit="m/s"/></type>'
    yield f'</link>\n    <type s="0" type="{kind}"{limit}\n    <planView>\n'
    step = np.diff(road.place_m, axis=0)
    for s, (x, y), (dx, dy) in zip(road.s_m.tolist(), road.place_m.tolist(), step.tolist(), strict=False):
        yield (
            f'      <geometry s="{s:.4f}" x="{x:.4f}" y="{y:.4f}" hdg="{np.arctan2(dy, dx):.8f}" '
            f'length="{np.hypot(dx, dy):.4f}"><line/></geometry>\n'
        )
    yield "    </planView>\n    <elevationProfile>\n"
    for s, (a, b, c, d) in zip(road.s_m.tolist(), cubics(road.s_m, road.height_m).tolist(), strict=False):
        yield f'      <elevation s="{s:.4f}" a="{a:.4f}" b="{b:.8f}" c="{c:.10f}" d="{d:.12f}"/>\n'
    yield "    </elevationProfile>\n    <lateralProfile/>\n"
    yield from _lanes(course, width_m)
    yield f'    <userData code="osm" value="{course.name}"/>\n  </road>\n'


def cubics(s_m: Floats, height_m: Floats) -> Floats:
    """Coefficients (k - 1, 4) of the cubics between nodes at ``s_m`` (k,), ascending, with these heights (k,)."""
    run, slope = np.diff(s_m), np.diff(height_m) / np.diff(s_m)
    grade = np.r_[slope[0], np.zeros(len(slope) - 1), slope[-1]]
    grade[1:-1] = (slope[:-1] * run[1:] + slope[1:] * run[:-1]) / (run[:-1] + run[1:])
    start, end = grade[:-1], grade[1:]
    c = (3 * slope - 2 * start - end) / run
    d = (start + end - 2 * slope) / run**2
    return np.column_stack([height_m[:-1], start, c, d])


def _lanes(course: Course, width_m: float) -> Iterator[str]:
    right = course.lanes(against=course.oneway < 0) or 1
    left = 0 if course.oneway else course.lanes(against=True) or 1
    middle = 0.0 if left else right * width_m / 2
    yield f'    <lanes>\n      <laneOffset s="0" a="{middle:.3f}" b="0" c="0" d="0"/>\n      <laneSection s="0">\n'
    if left:
        yield from _side("left", np.arange(left, 0, -1), width_m)
    yield '        <center><lane id="0" type="none" level="false"><link/></lane></center>\n'
    yield from _side("right", -np.arange(1, right + 1), width_m)
    yield "      </laneSection>\n    </lanes>\n"


def _side(name: str, ids: Ints, width_m: float) -> Iterator[str]:
    yield f"        <{name}>\n"
    for number in ids.tolist():
        yield (
            f'          <lane id="{number}" type="driving" level="false"><link/>'
            f'<width sOffset="0" a="{width_m}" b="0" c="0" d="0"/></lane>\n'
        )
    yield f"        </{name}>\n"
