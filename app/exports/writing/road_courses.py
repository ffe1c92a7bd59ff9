"""Roads from junction to junction with the height of each node: what simulators take instead of a map.

A course is a way of a file, or the part of one between two nodes where ways meet or end; a loop is two. Heights are
those of ``osm-ele``: measured ones, which lead over into the elevation model's. Knows no consumer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import osmium

from app.exports.formats.osm_ele import heights_of
from app.exports.writing.osm_files import damage_told, merged, read_nodes
from fusion.roads.osm import DRIVABLE, oneway_of
from fusion.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from app.exports.source import Source


MOST_LANES = 20
_MPS = {None: 1 / 3.6, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "mph": 0.44704}
_MAXSPEED = re.compile(r"(\d{1,3})(?: ?(km/h|kmh|mph))?")


@dataclass(frozen=True, eq=False)
class Course:
    """A part of a way: ``node`` (k,) its nodes as the way is drawn, by their rows in ``Courses``."""

    way: int
    part: int
    """Counts the parts of a way that has several, from 0 on."""
    row: Ints
    tags: Mapping[str, str]

    @property
    def highway(self) -> str:
        """The class of the road."""
        return self.tags["highway"]

    @property
    def oneway(self) -> int:
        """1 along the way, -1 against it, 0 both."""
        return oneway_of(self.highway, self.tags.get("oneway"), self.tags.get("junction"))

    def lanes(self, *, against: bool) -> int | None:
        """Lanes along the way or against it, where tags say how many; of a one-way road all of them."""
        own = self.tags.get(f"lanes:{'backward' if against else 'forward'}", "")
        if own.isdigit() and 0 < int(own) < MOST_LANES:
            return int(own)
        both = self.tags.get("lanes", "")
        if not both.isdigit() or not 0 < int(both) < MOST_LANES:
            return None
        return int(both) if self.oneway else math.ceil(int(both) / 2)

    def speed_mps(self) -> float | None:
        """How fast one may go, where the tag says it as a number."""
        told = _MAXSPEED.fullmatch(self.tags.get("maxspeed", ""))
        return None if told is None or int(told[1]) == 0 else int(told[1]) * _MPS[told[2]]

    @property
    def name(self) -> str:
        """Unique among courses: the way's number, and the part's behind a #."""
        return f"{self.way}#{self.part}"


@dataclass(frozen=True, eq=False)
class Courses:
    """The courses of roads that may be driven, and their nodes: number, place, height, and whether it was measured."""

    courses: list[Course]
    node: Ints
    lon_deg: Floats
    lat_deg: Floats
    height_m: Floats
    measured: Bools


def read_courses(source: Source, *, drivable: bool = True) -> Courses:
    """All roads of the source's files within its box, in the order of the files; ``RoadsError`` where there is none.

    Without ``drivable`` footways and the like are courses as well.
    """
    files = source.road_files
    nodes = read_nodes(files, source.bbox)
    heights = heights_of(source, nodes)
    with damage_told(files):
        ways = [
            (way.id, nodes.rows(np.array([n.ref for n in way.nodes], np.int64)), {t.k: t.v for t in way.tags})
            for way in merged(files, osmium.osm.WAY)
            if way.tags.get("highway") in DRIVABLE or (not drivable and "highway" in way.tags)
        ]
    known = set(nodes.way.tolist())
    ways = [one for one in ways if one[0] in known]
    ends = _meeting([rows for _, rows, _ in ways], len(nodes.node))
    courses = [
        Course(way, part, row, tags)
        for way, rows, tags in ways
        for part, row in enumerate(_parts(rows, ends))
    ]
    graph = nodes.graph
    return Courses(courses, nodes.node, graph.lon_deg, graph.lat_deg, heights.height_m, heights.measured)


def _meeting(ways: list[Ints], count: int) -> Bools:
    """Nodes (count,) at which ways end, meet, or one meets itself."""
    rows = [row[row >= 0] for row in ways]
    total = np.bincount(np.concatenate([*rows, np.empty(0, np.int64)]), minlength=count)
    meeting = total > 1
    for row in rows:
        if len(row):
            meeting[row[[0, -1]]] = True
    return np.asarray(meeting)


def _parts(row: Ints, ends: Bools) -> Iterator[Ints]:
    """The parts of a way between ends; nodes that no file has (-1) end a part as well."""
    for piece in np.split(row, np.flatnonzero(row < 0)):
        known = piece[piece >= 0]
        run = known[np.r_[True, np.diff(known) != 0][: len(known)]]
        cuts = np.flatnonzero(ends[run])
        cuts = np.unique(np.r_[0, cuts, len(run) - 1]) if len(run) else cuts
        for a, b in pairwise(cuts.tolist()):
            if run[a] == run[b] and b - a > 1:  # a loop: networks of edges have none
                middle = (a + b) // 2
                yield run[a : middle + 1]
                yield run[middle : b + 1]
            else:
                yield run[a : b + 1]
