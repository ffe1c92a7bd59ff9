"""Drawing a scene line by line: each line becomes a street whose nodes a mapper might have set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fusion.simulate.scene.plan import BRIDGE, GROUND, Kind, Plan, ring
from fusion.types import Floats
from published.particle.scene.alignment import at, nearest, node_places

MOTORWAY = Kind("motorway", GROUND, 1)
RAMP = Kind("motorway_link", GROUND, 1)
ROAD = Kind("tertiary")
STREET = Kind("residential")
LONGEST_M = {"motorway": 200.0, "motorway_link": 80.0, "tertiary": 130.0, "residential": 90.0}
"""Longest distance between the nodes of a straight road."""

_HALF_BRIDGE_M = 24.0
_CLEARANCE_M = 6.8
_RING_M = 28.0

Point = tuple[float, float]
"""A place on the board: metres east and north."""


@dataclass(frozen=True)
class Drawn:
    """A line of the board with the nodes on it; ``places_m`` is how far along the line each node lies."""

    line: Floats
    nodes: list[int]
    places_m: Floats

    def node_near(self, point: Point) -> int:
        """The node nearest to a place, measured along the line."""
        return self.nodes[int(np.argmin(np.abs(self.places_m - nearest(self.line, point))))]

    @property
    def middle(self) -> int:
        """The node halfway."""
        return self.nodes[int(np.argmin(np.abs(self.places_m - self.places_m[-1] / 2)))]


@dataclass
class Board:
    """A plan while it is drawn, and its lines by name."""

    plan: Plan
    drawn: dict[str, Drawn] = field(default_factory=dict)

    def xy(self, node: int) -> Point:
        """Where a node lies."""
        return self.plan.x_m[node], self.plan.y_m[node]

    def lay(
        self,
        key: str,
        line: Floats,
        kind: Kind,
        *,
        name: str | None = None,
        ends: tuple[int | None, int | None] = (None, None),
        joins: Sequence[Point] = (),
        bridges: Sequence[Point] = (),
        banked: bool = False,
    ) -> Drawn:
        """Draw a street along a line, shape (n, 2).

        ``ends`` are nodes that exist already at its ends, ``joins`` places that need a node. At each place of
        ``bridges`` it is a bridge of some 50 m, with a node in the middle. A ``banked`` street may leave the ground.
        """
        middles = [nearest(line, b) for b in bridges]
        decks = [(m - _HALF_BRIDGE_M, m + _HALF_BRIDGE_M) for m in middles]
        forced = [*(nearest(line, j) for j in joins), *middles, *(edge for deck in decks for edge in deck)]
        places = node_places(line, LONGEST_M[kind.highway], forced)
        points = at(line, places)
        inner = [self.plan.node(x, y) for x, y in points[1:-1]]
        first, last = (
            self.plan.node(*points[k]) if end is None else end for k, end in ((0, ends[0]), (-1, ends[1]))
        )
        nodes = [first, *inner, last]
        centres = (places[1:] + places[:-1]) / 2
        above = [any(a < c < b for a, b in decks) for c in centres]
        self.plan.street(name, nodes, [kind._replace(structure=BRIDGE) if up else kind for up in above])
        if banked:
            self.plan.embanked.update(nodes)
        self.drawn[key] = Drawn(line, nodes, places)
        return self.drawn[key]

    def roundabout(self, name: str, centre: Point, *, banked: bool = False) -> list[int]:
        """Draw a roundabout; its k-th node lies k / 8 of a turn anticlockwise from east."""
        circle = ring(self.plan, *centre, _RING_M)
        self.plan.street(name, [*circle, circle[0]], Kind("tertiary", GROUND, 1, "roundabout"))
        if banked:
            self.plan.embanked.update(circle)
        return circle

    def over(self, upper: str, lower: Sequence[str], place: Point) -> None:
        """Keep the bridge of one line clear of the lines below it."""
        under = [self.drawn[key].node_near(place) for key in lower]
        self.plan.clearances.append((self.drawn[upper].node_near(place), under, _CLEARANCE_M))

    def leave(self, ramp: str, carriageway: str) -> None:
        """Keep the carriageway's grade where a ramp leaves it."""
        link, road = self.drawn[ramp].nodes, self.drawn[carriageway].nodes
        k = road.index(link[0])
        self.plan.merges.append((road[k - 1], road[k], link[1]))

    def enter(self, ramp: str, carriageway: str) -> None:
        """Keep the ramp's grade where it enters a carriageway."""
        link, road = self.drawn[ramp].nodes, self.drawn[carriageway].nodes
        k = road.index(link[-1])
        self.plan.merges.append((link[-2], road[k], road[k + 1]))
