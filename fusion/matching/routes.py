"""From the lattice to the route: the states of the best path, the ways between them, and why the path is interrupted.

Ways lead over outliers and over whole chains. Segments are not known here: ``stays`` splits chains into them.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.matching.chains import search_from
from fusion.matching.lattice import OFF, ROUTE, SAME, START, TURN, Candidates, Intervals, Lattice
from fusion.matching.path import NO_CONNECTION, NO_ROAD, OUTAGE, Break
from fusion.matching.steps import over_nodes, within_chain
from fusion.matching.viterbi import Model
from fusion.types import Floats, Ints

_BRIDGE_FACTOR = 1.3
"""How much longer than the straight line a way over outliers may be."""


@compiled
def trace(lattice: Lattice, final: int) -> Ints:
    """The best state of every sample, from the last one's back to the first."""
    state = np.full(len(lattice.off_cost), final)
    for k in range(len(state) - 1, 0, -1):
        back = lattice.off_back[k] if state[k] == OFF else lattice.back[state[k]]
        # Over an outage the predecessor is written as -3 - state.
        state[k - 1] = back if back >= 0 or back == OFF else -3 - back
    return state


@compiled
def bridge(model: Model, lattice: Lattice, state: Ints, x: Floats, y: Floats) -> Ints:
    """The candidate that precedes each sample's on the path, or START: also over a few samples off the road.

    Outliers are no break: where the vehicle left the road and came back to it within ``bridge_m``, by a way
    not much longer than the straight one, the path goes on.
    """
    m = len(state)
    joined = np.full(m, START, np.int64)
    stamp = model.reach.stamp.max()
    last, outage = -1, False
    for k in range(m):
        outage = outage or model.intervals.outage[k]
        if state[k] == OFF:
            continue
        a, b = state[last] if last >= 0 else START, state[k]
        if last >= 0 and not outage:
            if last == k - 1 and lattice.back[b] == a:
                joined[k] = a
            else:
                stamp += 1
                length, kind = _bridge(model, a, b, math.hypot(x[k] - x[last], y[k] - y[last]), stamp)
                if kind >= 0:
                    joined[k], lattice.back[b] = a, a
                    lattice.kind[b], lattice.length_m[b] = kind, length
        last, outage = k, False
    return joined


@compiled
def _bridge(model: Model, a: int, b: int, chord: float, stamp: int) -> tuple[float, int]:
    """Length and kind of a plausible way between two candidates across samples off the road; kind -1: none."""
    ea, pa, eb, pb = model.cand.edge[a], model.cand.at_m[a], model.cand.edge[b], model.cand.at_m[b]
    length_m, bound = model.graph.length_m[ea >> 1], _BRIDGE_FACTOR * chord + model.costs.slack_m
    if chord > model.costs.bridge_m:
        return 0.0, -1
    kind, length = within_chain(ea, pa, length_m, eb, pb, model.costs.back_m)
    if kind == SAME:
        return length, SAME if length <= bound else -1
    if kind == TURN or length_m - pa > bound:
        return 0.0, -1
    search_from(model.graph, model.reach, model.graph.head[ea], bound - (length_m - pa), stamp)
    v = model.graph.tail[eb]
    if model.reach.stamp[v] != stamp:
        return 0.0, -1
    length, turns = over_nodes(
        ea, pa, length_m, eb, pb, model.costs.back_m, model.reach.via[v], model.reach.dist[v]
    )
    return length, ROUTE if length <= bound and not turns else -1


@compiled
def routes(model: Model, lattice: Lattice, state: Ints, joined: Ints) -> tuple[Ints, Ints]:
    """The chains driven whole between kept samples: those before sample k are start[k] to start[k + 1].

    ``joined[k]`` is the candidate that precedes the state of sample k on the path, or START.
    """
    m, graph = len(state), model.graph
    start, edge = np.zeros(m + 1, np.int64), np.empty(m + 64, np.int64)
    count, stamp = 0, model.reach.stamp.max()
    for k in range(m):
        start[k] = count
        a, b = joined[k], state[k]
        if a == START or lattice.kind[b] != ROUTE:
            continue
        stamp += 1
        head, v = graph.head[model.cand.edge[a]], graph.tail[model.cand.edge[b]]
        left = graph.length_m[model.cand.edge[a] >> 1] - model.cand.at_m[a]
        search_from(graph, model.reach, head, lattice.length_m[b] - left - model.cand.at_m[b] + 1e-3, stamp)
        first = count
        while v != head:
            if count == len(edge):
                edge = np.concatenate((edge, edge))
            edge[count] = model.reach.via[v]
            v = graph.tail[edge[count]]
            count += 1
        edge[first:count] = edge[first:count][::-1].copy()
    start[m] = count
    return start, edge[:count]


def breaks_of(
    time: Floats, cand: Candidates, intervals: Intervals, state: Ints, joined: Ints
) -> tuple[Break, ...]:
    """Why and when the path is interrupted, from the last sample before to the first after."""
    on = np.flatnonzero(state != OFF)
    empty = np.concatenate([[0], np.cumsum(np.diff(cand.start) == 0)])
    outages = np.concatenate([[0], np.cumsum(intervals.outage)])
    ends = np.flatnonzero(joined[on] == START)
    pairs = [(int(on[i - 1]) if i else -1, int(on[i])) for i in ends]
    if not len(on) or on[-1] < len(state) - 1:
        pairs.append((int(on[-1]) if len(on) else -1, len(state)))
    out = []
    for before, after in pairs:
        if after == 0:
            continue
        if before >= 0 and outages[min(after, len(state) - 1) + 1] > outages[before + 1]:
            reason = OUTAGE
        else:
            reason = NO_ROAD if empty[after] > empty[before + 1] else NO_CONNECTION
        out.append(Break(float(time[max(before, 0)]), reason))
    return tuple(out)
