"""Positions to segments, each from the one before over the roads that lead there (Al Assaad 2020, 1.3.1.2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.matching.chains import ChainGraph, Reach, search_from
from fusion.matching.lattice import Candidates
from fusion.published.matchers.base import PointMatcher, PointMatches, Samples
from fusion.published.matchers.chain_network import ChainNetwork
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints

_NONE = -1


class _Rules(NamedTuple):
    """The settings of ``Topological`` that the compiled loop takes."""

    detour: float
    slack_m: float
    back_m: float
    turn_round: float
    start_cost: float
    start_margin: float
    doubt: float
    patience: int
    outage_s: float
    fastest_mps: float


@dataclass(frozen=True)
class Topological(PointMatcher):
    """Each position on a road that can be reached from the match before it.

    It begins at a position whose place is beyond doubt, the anchor ("point d'appui"). From then on only places are
    candidates to which a way leads that the vehicle can have driven since: no longer than ``detour`` times the
    straight line plus ``slack_m`` (m), and no faster than ``fastest_mps`` (m/s). Of these the lightest is taken, by
    weight (d / sigma)^2 / 2 for the distance d plus turn (1 - cos a), softly bounded by ``turn_cap``, for the
    angle a between the heading and the direction of driving, plus ``turn_round`` for turning round on the road.

    On one-way roads a match may lie ``back_m`` (m) behind the one before: positions err along the road too.
    ``radius_m``: no place farther than that is a candidate, m. An anchor's weight is at most ``start_cost``, and
    that of any place that cannot be reached from it within ``slack_m`` at least ``start_margin`` more. The vehicle
    is lost after ``patience`` positions in a row without a candidate or with one that weighs ``doubt`` more than the
    best place anywhere, or after ``outage_s`` (s) without a match; then another anchor is sought. A position that is
    no anchor, or at which the vehicle gets lost, has no match: between matches of neighbouring positions no more
    than ``outage_s`` apart there is always such a way. Without headings the direction of driving is that of the way; on
    the first road it is the one in which that was drawn, and turning round is not seen before the next junction.
    """

    sigma_m: float = 10.0
    turn: float = 8.0
    turn_cap: float = 5.0
    turn_round: float = 1.0
    detour: float = 1.5
    slack_m: float = 30.0
    back_m: float = 18.0
    radius_m: float = 50.0
    start_cost: float = 2.0
    start_margin: float = 1.0
    doubt: float = 3.0
    patience: int = 3
    outage_s: float = 180.0
    fastest_mps: float = 70.0

    name: ClassVar[str] = "topological"
    description: ClassVar[str] = "from a sure start, the best segment that can have been reached"
    source: ClassVar[str] = "Al Assaad 2020, 1.3.1.2; after Greenfeld 2002 and Velaga et al. 2009"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """The chains of the network."""
        roads = ChainNetwork.of(network)
        rules = _Rules(*(getattr(self, name) for name in _Rules._fields))

        def found(samples: Samples) -> PointMatches:
            rows = samples.known()
            s = samples.take(rows)
            places = roads.places(s, self.radius_m, self.sigma_m, self.turn, self.turn_cap)
            ahead, behind = Reach.of(roads.graph), Reach.of(roads.graph)
            chosen = _follow(roads.graph, places, s.time_s, s.x_m, s.y_m, ahead, behind, rules)
            rows, chosen = rows[chosen != _NONE], chosen[chosen != _NONE]
            return roads.matches(len(samples), rows, places.edge[chosen], places.at_m[chosen])

        return found


@compiled
def way_m(
    graph: ChainGraph,
    ahead: Reach,
    behind: Reach,
    stamp: int,
    ea: int,
    pa: float,
    eb: int,
    pb: float,
    back_m: float,
) -> float:
    """Metres from place pa on directed chain ea to place pb on eb, infinite where no way was found.

    ``ahead`` has been searched from the head of ea, ``behind`` from its tail; what they reached bears the stamp.
    """
    chain = ea >> 1
    length = graph.length_m[chain]
    may_return = graph.both[chain]
    way = np.inf
    if eb >> 1 == chain:
        onward = (pb if eb == ea else length - pb) - pa
        if onward >= 0.0 or may_return or -onward <= back_m:
            way = abs(onward)
    via = graph.tail[eb]
    if ahead.stamp[via] == stamp:
        way = min(way, length - pa + ahead.dist[via] + pb)
    if behind.stamp[via] == stamp and (may_return or pa <= back_m):
        way = min(way, pa + behind.dist[via] + pb)
    return way


@compiled
def _anchor(graph: ChainGraph, places: Candidates, k: int, ahead: Reach, behind: Reach, rules: _Rules) -> int:
    """The best place of sample k if it is beyond doubt, else _NONE."""
    best, least = _NONE, rules.start_cost
    for j in range(places.start[k], places.start[k + 1]):
        if places.cost[j] <= least:
            best, least = j, places.cost[j]
    if best == _NONE:
        return _NONE
    ea, pa = places.edge[best], places.at_m[best]
    search_from(graph, ahead, graph.head[ea], rules.slack_m, k)
    search_from(graph, behind, graph.tail[ea], rules.slack_m, k)
    for j in range(places.start[k], places.start[k + 1]):
        if places.cost[j] >= least + rules.start_margin:
            continue
        way = way_m(graph, ahead, behind, k, ea, pa, places.edge[j], places.at_m[j], rules.back_m)
        if way > rules.slack_m:
            return _NONE
    return best


@compiled
def _step(
    graph: ChainGraph,
    places: Candidates,
    k: int,
    last: int,
    bound: float,
    ahead: Reach,
    behind: Reach,
    rules: _Rules,
) -> tuple[int, bool]:
    """The lightest place of sample k within reach of place ``last`` (_NONE: none), and whether it is in doubt."""
    ea, pa = places.edge[last], places.at_m[last]
    search_from(graph, ahead, graph.head[ea], bound, k)
    search_from(graph, behind, graph.tail[ea], bound, k)
    best, least, lightest = _NONE, np.inf, np.inf
    for j in range(places.start[k], places.start[k + 1]):
        eb, pb, weight = places.edge[j], places.at_m[j], places.cost[j]
        lightest = min(lightest, weight)
        if eb == ea ^ 1:
            weight += rules.turn_round
        if weight < least and way_m(graph, ahead, behind, k, ea, pa, eb, pb, rules.back_m) <= bound:
            best, least = j, weight
    return best, best == _NONE or least > lightest + rules.doubt


@compiled
def _follow(
    graph: ChainGraph,
    places: Candidates,
    time: Floats,
    x: Floats,
    y: Floats,
    ahead: Reach,
    behind: Reach,
    rules: _Rules,
) -> Ints:
    """For each sample the number of its place, _NONE for none."""
    n = len(time)
    chosen = np.full(n, _NONE)
    last, at, misses = _NONE, -1, 0
    for k in range(n):
        if last != _NONE and time[k] - time[at] > rules.outage_s:
            last = _NONE
        if last == _NONE:
            last, at, misses = _anchor(graph, places, k, ahead, behind, rules), k, 0
            chosen[k] = last
            continue
        moved = math.hypot(x[k] - x[at], y[k] - y[at])
        bound = rules.slack_m + min(rules.detour * moved, rules.fastest_mps * (time[k] - time[at]))
        best, doubtful = _step(graph, places, k, last, bound, ahead, behind, rules)
        misses = misses + 1 if doubtful else 0
        if misses >= rules.patience:
            last = _NONE
        elif best != _NONE:
            chosen[k], last, at = best, best, k
    return chosen
