"""Names that a map shows beside roads: places, waters and numbers of roads, read in the pass that reads the roads."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import accumulate, compress
from typing import Any, Literal

import numpy as np

from fusion.types import Floats

Layer = Literal["places", "water", "roads"]
"""A point with a name; a line with a name; a line with the number of a road."""

PLACES = ("city", "town", "village", "suburb", "hamlet")
WATERS = ("river", "canal", "stream")
WATER_TAGS = tuple(("waterway", kind) for kind in WATERS)
NUMBERED = ("motorway", "trunk", "primary", "secondary", "tertiary")
"""The classes of roads whose numbers (``ref``) a map shows."""
LONGEST_NAME = 200
"""Characters. What is longer is no name that a map could show."""

_MOST_X, _MOST_Y = 1_800_000_000, 900_000_000  # 1e-7 degrees


@dataclass
class MapNames:
    """n names, each with the id of its node or way in OpenStreetMap, its kind there, and where it is."""

    layer: list[Layer] = field(default_factory=list)
    osm_id: list[int] = field(default_factory=list)
    kind: list[str] = field(default_factory=list)
    name: list[str] = field(default_factory=list)
    population: list[int | None] = field(default_factory=list)
    """Of places, where it is known."""
    points: list[int] = field(default_factory=list)
    """Of each: one, or of a line at least two."""
    x: array[int] = field(default_factory=lambda: array("i"))
    """Of all points, 1e-7 degrees."""
    y: array[int] = field(default_factory=lambda: array("i"))

    def __len__(self) -> int:
        return len(self.osm_id)

    def node(self, node: Any) -> None:
        """Take a place (an osmium node), if it has a name; osmium calls this."""
        kind, at = node.tags.get("place"), node.location
        if kind in PLACES and at.valid():
            people = _people(node.tags.get("population"))
            self._add("places", node.id, kind, node.tags.get("name"), people, (at.x,), (at.y,))

    def way(self, way: Any) -> None:
        """Take a water that has a name, or a road that has a number: an osmium way whose nodes have their places."""
        tag = way.tags.get
        water, road = tag("waterway"), tag("highway")
        if water in WATERS:
            self._add_line("water", way, water, tag("name"))
        if road in NUMBERED:
            self._add_line("roads", way, road, tag("ref"))

    def lines_deg(self) -> Iterator[Floats]:
        """Of each its points, longitude and latitude, degrees, shape (points, 2)."""
        both = np.column_stack([np.frombuffer(self.x, np.int32), np.frombuffer(self.y, np.int32)])
        ends = list(accumulate(self.points))
        for points, end in zip(self.points, ends, strict=True):
            yield both[end - points : end] / 1e7

    def _add_line(self, layer: Layer, way: Any, kind: str, name: str | None) -> None:
        if not name:
            return
        x, y = array("q", [n.x for n in way.nodes]), array("q", [n.y for n in way.nodes])
        # Nodes that the extract lacks have no place.
        known = [abs(a) <= _MOST_X and abs(b) <= _MOST_Y for a, b in zip(x, y, strict=True)]
        if sum(known) > 1:
            self._add(layer, way.id, kind, name, None, compress(x, known), compress(y, known))

    def _add(
        self, layer: Layer, osm_id: int, kind: str, name: str | None, people: int | None, x: Any, y: Any
    ) -> None:
        plain = " ".join((name or "").replace("\x00", " ").split())
        if not plain or len(plain) > LONGEST_NAME:
            return
        before = len(self.x)
        self.x.extend(x)
        self.y.extend(y)
        self.points.append(len(self.x) - before)
        self.layer.append(layer)
        self.osm_id.append(osm_id)
        self.kind.append(kind)
        self.name.append(plain)
        self.population.append(people)


def _people(text: str | None) -> int | None:
    """A population as people write it: 12345, 12 345 or 12.345; None for anything else."""
    digits = (text or "").translate({ord(mark): None for mark in " .,'\u202f\u00a0"})
    return int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 10 else None
