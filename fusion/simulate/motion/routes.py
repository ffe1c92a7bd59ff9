"""Routes through the town: legal, turning round only at dead ends, preferring what is undriven.

Knows roads and driving times by class of road; how a vehicle really moves along a route stands in ``vehicle``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from fusion.simulate.scene.town import Town
from fusion.types import Floats, Ints

CRUISE_MPS = {
    "motorway": 30.0,
    "motorway_link": 16.0,
    "primary": 17.0,
    "secondary": 15.0,
    "tertiary": 13.5,
    "unclassified": 12.0,
    "residential": 9.0,
    "living_street": 4.5,
    "service": 5.5,
    "track": 6.0,
}
"""Free speed by road class."""
MOTORWAYS = ["motorway", "motorway_link"]
_SLOWDOWN_S = 1.5
"""Seconds that a segment costs beyond its length over its speed, on average (turns, stops)."""


@dataclass(frozen=True)
class Route:
    """Segments one after another; ``forward`` is True where one is driven from from_node to to_node."""

    segment: Ints
    forward: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.segment)


@dataclass(frozen=True)
class Arcs:
    """The segments in their legal directions, and which arc may follow which."""

    town: Town
    segment: Ints
    forward: NDArray[np.bool_]
    tail: Ints
    head: Ints
    degree: Ints
    """Number of open segments' ends at each of the town's nodes."""

    @classmethod
    def of(cls, town: Town, closed: NDArray[np.bool_] | None = None) -> Arcs:
        """The legal arcs of a town: a one-way segment has one, any other two, a closed one none."""
        shut = np.zeros(len(town.roads), bool) if closed is None else closed
        with_way = np.flatnonzero((town.roads.oneway >= 0) & ~shut)
        against = np.flatnonzero((town.roads.oneway <= 0) & ~shut)
        ends = np.r_[town.start[~shut], town.end[~shut]]
        return cls(
            town,
            np.r_[with_way, against],
            np.r_[np.ones(len(with_way), bool), np.zeros(len(against), bool)],
            np.r_[town.start[with_way], town.end[against]],
            np.r_[town.end[with_way], town.start[against]],
            np.bincount(ends, minlength=len(town.node_id)).astype(np.int64),
        )

    def __len__(self) -> int:
        return len(self.segment)

    @cached_property
    def seconds(self) -> Floats:
        """Driving time of each arc, about."""
        speed = np.array([CRUISE_MPS[h] for h in self.town.roads.highway])
        return np.asarray((self.town.length_m / speed + _SLOWDOWN_S)[self.segment])

    @cached_property
    def followers(self) -> tuple[Ints, Ints]:
        """Pairs (arc, next arc): every continuation but turning round, which only a dead end allows."""
        order = np.argsort(self.tail, kind="stable")
        first = np.searchsorted(self.tail[order], self.head, side="left")
        last = np.searchsorted(self.tail[order], self.head, side="right")
        here = np.repeat(np.arange(len(self)), last - first)
        offset = np.arange(len(here)) - np.repeat(np.cumsum(last - first) - (last - first), last - first)
        there = order[np.repeat(first, last - first) + offset]
        back = self.segment[here] == self.segment[there]
        dead_end = self.degree[self.head[here]] == 1
        keep = ~back | dead_end
        return here[keep], there[keep]

    def graph(self, seconds: Floats) -> csr_array:
        """Sparse matrix of costs: entry (i, j) is the time of arc j, where j may follow i."""
        here, there = self.followers
        return csr_array((seconds[there], (here, there)), shape=(len(self), len(self)))


def plan_route(
    town: Town,
    duration_s: float,
    rng: np.random.Generator,
    *,
    visits: Ints | None = None,
    first: NDArray[np.bool_] | None = None,
    closed: NDArray[np.bool_] | None = None,
) -> Route:
    """Plan a route of at least ``duration_s`` (by cruising speeds) from a random place.

    It goes from least-visited segment to least-visited segment, each time to one that is near by driving
    times that chance changes from leg to leg. ``visits`` [segments] counts earlier passes and is updated;
    segments of the mask ``first`` count as the most wanted until they are driven, those of ``closed`` are not
    driven.
    """
    arcs = Arcs.of(town, closed)
    visits = np.zeros(len(town.roads), np.int64) if visits is None else visits
    remaining = np.zeros(len(town.roads), bool) if first is None else np.asarray(first) & (visits == 0)
    chosen = [int(rng.integers(len(arcs)))]
    _count(arcs, chosen, visits, remaining)
    elapsed = 0.0
    while elapsed < duration_s:
        leg = _next_leg(arcs, chosen[-1], visits, remaining, rng)
        _count(arcs, leg, visits, remaining)
        chosen += leg
        elapsed += float(arcs.seconds[leg].sum())
    path = np.array(chosen)
    return Route(arcs.segment[path], arcs.forward[path])


def _count(arcs: Arcs, leg: list[int], visits: Ints, remaining: NDArray[np.bool_]) -> None:
    np.add.at(visits, arcs.segment[leg], 1)
    remaining[arcs.segment[leg]] = False


def _next_leg(
    arcs: Arcs, here: int, visits: Ints, remaining: NDArray[np.bool_], rng: np.random.Generator
) -> list[int]:
    """The arcs from the end of ``here`` to the nearest arc of the most wanted sort, that one included."""
    rank = np.where(remaining, -1, visits)[arcs.segment]
    seconds = arcs.seconds * rng.uniform(0.6, 1.4, len(arcs))
    far, before = dijkstra(arcs.graph(seconds), indices=here, return_predecessors=True)
    reached = np.isfinite(far)
    reached[here] = False
    goal_rank = rank[reached].min()
    far = np.where(reached & (rank == goal_rank), far, np.inf)
    arc, leg = int(np.argmin(far)), []
    while arc != here:
        leg.append(arc)
        arc = int(before[arc])
    return leg[::-1]


def structures(town: Town) -> NDArray[np.bool_]:
    """The segments every demonstration should show: bridges, tunnel, motorway, ramps, roundabouts."""
    special = np.isin(town.roads.highway.astype(str), MOTORWAYS)
    return np.asarray(special | town.roads.bridge | town.roads.tunnel)
