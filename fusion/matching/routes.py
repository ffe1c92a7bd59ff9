"""The way between the states of the best path: over outliers, and over whole chains; compiled."""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.matching.lattice import OFF, ROUTE, SAME, START, TURN, Lattice, Problem
from fusion.matching.viterbi import over_nodes, search_from, within_chain
from fusion.types import Floats, Ints

_BRIDGE_FACTOR = 1.3
"""How much longer than the straight line a way over outliers may be."""


@compiled
def routes(p: Problem, lattice: Lattice, state: Ints, joined: Ints) -> tuple[Ints, Ints]:
    """The chains driven whole between kept samples: those before sample k are start[k] to start[k + 1].

    ``joined[k]`` is the candidate that precedes the state of sample k on the path, or START.
    """
    m, graph = len(state), p.graph
    start, edge = np.zeros(m + 1, np.int64), np.empty(m + 64, np.int64)
    count, stamp = 0, p.reach.stamp.max()
    for k in range(m):
        start[k] = count
        a, b = joined[k], state[k]
        if a == START or lattice.kind[b] != ROUTE:
            continue
        stamp += 1
        head, v = graph.head[p.cand.edge[a]], graph.tail[p.cand.edge[b]]
        left = graph.length_m[p.cand.edge[a] >> 1] - p.cand.at_m[a]
        search_from(graph, p.reach, head, lattice.length_m[b] - left - p.cand.at_m[b] + 1e-3, stamp)
        first = count
        while v != head:
            if count == len(edge):
                edge = np.concatenate((edge, edge))
            edge[count] = p.reach.via[v]
            v = graph.tail[edge[count]]
            count += 1
        edge[first:count] = edge[first:count][::-1].copy()
    start[m] = count
    return start, edge[:count]


@compiled
def bridge(p: Problem, lattice: Lattice, state: Ints, x: Floats, y: Floats) -> Ints:
    """The candidate that precedes each sample's on the path, or START: also over a few samples off the road.

    Outliers are no break: where the vehicle left the road and came back to it within ``bridge_m``, by a way
    not much longer than the straight one, the path goes on.
    """
    m = len(state)
    joined = np.full(m, START, np.int64)
    stamp = p.reach.stamp.max()
    last, gap = -1, False
    for k in range(m):
        gap = gap or p.steps.gap[k]
        if state[k] == OFF:
            continue
        a, b = state[last] if last >= 0 else START, state[k]
        if last >= 0 and not gap:
            if last == k - 1 and lattice.back[b] == a:
                joined[k] = a
            else:
                stamp += 1
                length, kind = _bridge(p, a, b, math.hypot(x[k] - x[last], y[k] - y[last]), stamp)
                if kind >= 0:
                    joined[k], lattice.back[b] = a, a
                    lattice.kind[b], lattice.length_m[b] = kind, length
        last, gap = k, False
    return joined


@compiled
def _bridge(p: Problem, a: int, b: int, chord: float, stamp: int) -> tuple[float, int]:
    """Length and kind of a plausible way between two candidates across samples off the road; kind -1: none."""
    ea, pa, eb, pb = p.cand.edge[a], p.cand.at_m[a], p.cand.edge[b], p.cand.at_m[b]
    whole, bound = p.graph.length_m[ea >> 1], _BRIDGE_FACTOR * chord + p.costs.slack_m
    if chord > p.costs.bridge_m:
        return 0.0, -1
    kind, length = within_chain(ea, pa, whole, eb, pb, p.costs.back_m)
    if kind == SAME:
        return length, SAME if length <= bound else -1
    if kind == TURN or whole - pa > bound:
        return 0.0, -1
    search_from(p.graph, p.reach, p.graph.head[ea], bound - (whole - pa), stamp)
    v = p.graph.tail[eb]
    if p.reach.stamp[v] != stamp:
        return 0.0, -1
    length, turns = over_nodes(ea, pa, whole, eb, pb, p.costs.back_m, p.reach.via[v], p.reach.dist[v])
    return length, ROUTE if length <= bound and not turns else -1
