"""Positions to segments, a few together as a curve (Al Assaad 2020, 1.3.1.1.3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.matching.chains import ChainGraph, position_of, rank_at, share_at
from fusion.matching.lattice import Candidates
from fusion.published.matchers.base import PointMatcher, PointMatches, Samples
from fusion.published.matchers.chain_network import ChainNetwork
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints

_DEEPEST = 24
"""Most junctions that a curve may pass on one side of its place."""

_MOST_BRANCHES = 5000
"""Most stretches between junctions that are tried on one side of a place."""


@dataclass(frozen=True)
class CurveToCurve(PointMatcher):
    """The road whose curve lies nearest to the curve of a few positions.

    The curve of a position is the ``points`` positions before it and as many after. Through each place near it go
    curves along the roads in either direction, turning off at junctions in every way that may be driven, as
    long as the curve of positions times ``stretch`` plus ``slack_m`` (m). A curve's distance is the sum of the
    distances of the positions to it, taken in order: none may lie behind the one before by more than a segment.
    The place with the least sum is the match; the order gives the direction of driving, no heading is used.
    ``radius_m``: no place farther than that from the position is a candidate, m. A curve of positions goes no
    farther than ``longest_m`` (m) to either side, as ever more curves of roads would have to be tried: positions
    farther apart than that are each by itself.
    """

    points: int = 5
    stretch: float = 1.2
    slack_m: float = 10.0
    radius_m: float = 50.0
    longest_m: float = 250.0

    name: ClassVar[str] = "curve-to-curve"
    description: ClassVar[str] = (
        "the road whose curve has the least summed distance to some positions in order"
    )
    source: ClassVar[str] = "Al Assaad 2020, 1.3.1.1.3; after White et al. 2000"

    def prepare(self, network: RoadNetwork) -> Callable[[Samples], PointMatches]:
        """The chains of the network, and which follow on which, either way along the drive."""
        roads = ChainNetwork.of(network)
        ways = _ways(roads.graph)
        settings = self.points, self.stretch, self.slack_m, self.longest_m

        def found(samples: Samples) -> PointMatches:
            rows = samples.known()
            s = samples.take(rows)
            places = roads.places(s, self.radius_m, math.sqrt(0.5))  # the cost is the squared distance
            edge, at = _fit(roads.graph, ways, places, s.x_m, s.y_m, *settings)
            return roads.matches(len(samples), rows, edge, at)

        return found


class _Ways(NamedTuple):
    """Directed chains by the node at which they begin: those to drive on to, and those to have come from, reversed."""

    onward_start: Ints
    onward: Ints
    back_start: Ints
    back: Ints


class _Branch(NamedTuple):
    """Memory for a curve that is being followed, per junction passed: the sums of the first j positions, what is left
    of its length, the directed chain, and which of those that follow on it is next.
    """

    total: Floats
    left: Floats
    on: Ints
    cursor: Ints


def _ways(graph: ChainGraph) -> _Ways:
    came = graph.out_edge ^ 1
    nodes = graph.tail[came]
    order = np.argsort(nodes, kind="stable")
    start = np.searchsorted(nodes[order], np.arange(len(graph.arrivals) + 1)).astype(np.int64)
    return _Ways(graph.out_start, graph.out_edge, start, came[order])


@compiled
def _offset(shape: Floats, r: int, x: float, y: float, low: float, high: float) -> float:
    """Distance of (x, y) from the part of segment r between two shares of it."""
    dx, dy = x - shape[r, 0], y - shape[r, 1]
    share = min(max((dx * shape[r, 2] + dy * shape[r, 3]) * shape[r, 4], low), high)
    return math.hypot(dx - share * shape[r, 2], dy - share * shape[r, 3])


@compiled
def _extend(
    graph: ChainGraph, edge: int, begin_m: float, budget: float, x: Floats, y: Floats, total: Floats
) -> float:
    """Lengthen a curve by a directed chain from a place on it; what remains of the budget.

    ``total[j]`` is the least sum of the first j positions over the curve so far, in order: each further segment
    may take any number of them that come after those taken before.
    """
    chain = edge >> 1
    first, last = graph.first[chain], graph.first[chain + 1] - 1
    length = graph.length_m[chain]
    onward = edge % 2 == 0
    place = begin_m if onward else length - begin_m
    r = first if onward else last
    low, high = 0.0, 1.0
    if begin_m > 0.0:
        r = rank_at(graph, chain, place)
        share = share_at(graph, r, place)
        low, high = (share, 1.0) if onward else (0.0, share)
    left = budget
    while first <= r <= last and left > 0.0:
        span = (graph.cum_m[r + 1] if r < last else length) - graph.cum_m[r]
        if span * (high - low) > left:
            low, high = (low, low + left / span) if onward else (high - left / span, high)
        for j in range(1, len(x) + 1):
            taken = total[j - 1] + _offset(graph.shape, r, x[j - 1], y[j - 1], low, high)
            total[j] = min(total[j], taken)
        left -= span * (high - low)
        low, high = 0.0, 1.0
        r += 1 if onward else -1
    return left


@compiled
def _bound(total: Floats, left: float, px: float, py: float, x: Floats, y: Floats) -> float:
    """What the sum cannot fall below when the curve goes on from (px, py) for no more than is left."""
    n = len(x)
    least, rest = total[n], 0.0
    for j in range(n - 1, -1, -1):
        rest += max(math.hypot(x[j] - px, y[j] - py) - left, 0.0)
        least = min(least, total[j] + rest)
    return float(least)


@compiled
def _grow(
    graph: ChainGraph,
    edge: int,
    begin_m: float,
    budget: float,
    x: Floats,
    y: Floats,
    total: Floats,
    best: float,
) -> tuple[float, float]:
    """``_extend``; what remains of the budget, none if no way on can be better than the best; and the best."""
    left = _extend(graph, edge, begin_m, budget, x, y, total)
    best = min(best, total[len(x)])
    px, py = position_of(graph, edge, graph.length_m[edge >> 1])
    return left if _bound(total, left, px, py, x, y) < best else 0.0, best


@compiled
def _least_sum(
    graph: ChainGraph,
    start: Ints,
    following: Ints,
    edge: int,
    at_m: float,
    x: Floats,
    y: Floats,
    budget: float,
    limit: float,
    branch: _Branch,
) -> float:
    """The least sum of distances of positions, in order, to a curve from a place; infinite if not below limit.

    Curves are followed one branch after another, as long as they can still be the best; ``branch`` is memory.
    """
    n = len(x)
    total, left, on, cursor = branch
    px, py = position_of(graph, edge, at_m)
    total[0, 0] = 0.0
    for j in range(n):
        total[0, j + 1] = total[0, j] + math.hypot(x[j] - px, y[j] - py)
    left[0], best = _grow(graph, edge, at_m, budget, x, y, total[0], limit)
    on[0], cursor[0] = edge, start[graph.head[edge]]
    depth, branches = 0, 0
    while depth >= 0:
        i, end = cursor[depth], start[graph.head[on[depth]] + 1]
        if i == end or left[depth] <= 0.0 or depth == _DEEPEST or branches == _MOST_BRANCHES:
            depth -= 1
            continue
        cursor[depth] += 1
        following_edge = following[i]
        if following_edge == on[depth] ^ 1:
            continue
        depth, branches = depth + 1, branches + 1
        for j in range(n + 1):
            total[depth, j] = total[depth - 1, j]
        left[depth], best = _grow(graph, following_edge, 0.0, left[depth - 1], x, y, total[depth], best)
        on[depth], cursor[depth] = following_edge, start[graph.head[following_edge]]
    return float(best) if best < limit else np.inf


@compiled
def _window(x: Floats, y: Floats, k: int, step: int, points: int, longest_m: float) -> tuple[int, float]:
    """How many samples belong to the curve of sample k on one side, and the length of that side."""
    count, way = 0, 0.0
    while count < points:
        i = k + step * (count + 1)
        if i < 0 or i >= len(x):
            break
        longer = way + math.hypot(x[i] - x[i - step], y[i] - y[i - step])
        if longer > longest_m:
            break
        count, way = count + 1, longer
    return count, way


@compiled
def _fit(
    graph: ChainGraph,
    ways: _Ways,
    places: Candidates,
    x: Floats,
    y: Floats,
    points: int,
    stretch: float,
    slack_m: float,
    longest_m: float,
) -> tuple[Ints, Floats]:
    """For each sample the directed chain (-1: none) and place on it whose curve has the least sum."""
    n = len(x)
    edge, at = np.full(n, -1), np.full(n, np.nan)
    branch = _Branch(
        np.empty((_DEEPEST + 1, points + 1)),
        np.empty(_DEEPEST + 1),
        np.empty(_DEEPEST + 1, np.int64),
        np.empty(_DEEPEST + 1, np.int64),
    )
    for k in range(n):
        after, ahead = _window(x, y, k, 1, points, longest_m)
        before, behind = _window(x, y, k, -1, points, longest_m)
        xa, ya = x[k + 1 : k + 1 + after], y[k + 1 : k + 1 + after]
        xb, yb = x[k - before : k][::-1].copy(), y[k - before : k][::-1].copy()
        ahead, behind = slack_m + stretch * ahead, slack_m + stretch * behind
        least = np.inf
        for j in range(places.start[k], places.start[k + 1]):
            e, p = places.edge[j], places.at_m[j]
            total = math.sqrt(places.cost[j])
            if total >= least:
                continue
            total += _least_sum(
                graph, ways.onward_start, ways.onward, e, p, xa, ya, ahead, least - total, branch
            )
            if total >= least:
                continue
            q = graph.length_m[e >> 1] - p
            total += _least_sum(
                graph, ways.back_start, ways.back, e ^ 1, q, xb, yb, behind, least - total, branch
            )
            if total < least:
                least, edge[k], at[k] = total, e, p
    return edge, at
