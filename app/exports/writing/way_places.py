"""Where along its OpenStreetMap way each segment lies, for joins by linear reference.

Segments know their nodes and not their place in the way. Chains give the order; the kept file of the region says which
node is the way's first and which its last, for an extract may cut a way, and a ring may begin anywhere.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import osmium

from app.exports.writing.osm_files import damage_told, merged
from app.map.derived.chains import chains_of, places
from app.map.segment import Segment
from fusion.types import Floats, Ints


class Ends(NamedTuple):
    """The first and the last node of a way, and its version, 0 where the file has none."""

    first: int
    last: int
    version: int


@dataclass(frozen=True)
class WayEnds:
    """``Ends`` of ways, columns of equal length, by ascending way."""

    way: array[int]
    rows: tuple[array[int], ...]

    def of(self, way: int) -> Ends | None:
        """Of one way; None where no file has it."""
        at = bisect_left(self.way, way)
        if at == len(self.way) or self.way[at] != way:
            return None
        return Ends(*(column[at] for column in self.rows))


def read_way_ends(files: Sequence[Path], ways: Ints) -> WayEnds:
    """Of these ways, ascending, out of the files of regions (``Source.road_files``); ``RoadsError`` of damaged ones."""
    wanted = array("q", ways.tolist())
    found = [array("q") for _ in range(1 + len(Ends._fields))]
    with damage_told(files):
        for way in merged(files, osmium.osm.WAY):
            at = bisect_left(wanted, way.id)
            if at < len(wanted) and wanted[at] == way.id and len(way.nodes):
                row = (way.id, way.nodes[0].ref, way.nodes[len(way.nodes) - 1].ref, way.version)
                for column, value in zip(found, row, strict=True):
                    column.append(value)
    return WayEnds(found[0], tuple(found[1:]))


@dataclass(frozen=True, eq=False)
class Course:
    """The n segments of a whole way in its order, and its nodes at shares of its length: ``share`` (n + 1,), 0..1."""

    segments: tuple[Segment, ...]
    share: Floats
    length_m: float

    @cached_property
    def _number(self) -> dict[int | None, int]:
        return {one.id: k for k, one in enumerate(self.segments)}

    def range_of(self, segment: Segment) -> tuple[float, float]:
        """Where one of the segments begins and ends, shares of the way's length."""
        k = self._number[segment.id]
        return float(self.share[k]), float(self.share[k + 1])

    def nearest(self, share: float) -> int:
        """Which of the n + 1 nodes lies nearest to a share of the length."""
        return int(np.argmin(np.abs(self.share - share)))

    def node(self, number: int) -> int:
        """The number of the node in OpenStreetMap."""
        return self.segments[0].from_node if number == 0 else self.segments[number - 1].to_node


def courses_of(segments: Sequence[Segment], ends: WayEnds) -> dict[int, Course]:
    """By way, of all segments of some ways; without the ways of which only a part or no order is known."""
    n = len(segments)
    if not n:
        return {}
    key = np.array([s.osm_way_id for s in segments])
    ids = np.array([s.stored_id for s in segments])
    nodes = np.array([(s.from_node, s.to_node) for s in segments]).T.ravel()
    xy = np.array([s.coordinates for s in segments], float).transpose(1, 0, 2).reshape(-1, 2)
    place = places(np.tile(key, 2), nodes, xy)
    chains = chains_of(key, ids, place[:n], place[n:])
    of_way: dict[int, list[list[Segment]]] = {}
    for a, b in pairwise(chains.first.tolist()):
        chain = [segments[row] for row in chains.rows[a:b].tolist()]
        of_way.setdefault(chain[0].osm_way_id, []).append(chain)
    found = {}
    for way, runs in of_way.items():
        of = ends.of(way)
        if of is None or len(runs) > 1:
            continue
        chain = _from(runs[0], of.first)
        if (chain[0].from_node, chain[-1].to_node) == (of.first, of.last):
            metres = np.concatenate([[0.0], np.cumsum([one.length_m for one in chain])])
            if metres[-1] > 0:
                found[way] = Course(tuple(chain), metres / metres[-1], float(metres[-1]))
    return found


def _from(chain: list[Segment], node: int) -> list[Segment]:
    """A ring from this node on; any other chain as it is."""
    if chain[0].from_node != chain[-1].to_node:
        return chain
    at = next((k for k, one in enumerate(chain) if one.from_node == node), 0)
    return chain[at:] + chain[:at]
