"""Viterbi over the candidates of a drive, with bounded shortest paths between them; compiled.

Helpers take whole groups of arrays, which costs nothing: they are pasted into the loop. This file finds the best path;
``posterior`` says how probable it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph, Reach, search_from
from fusion.matching.lattice import (
    LONG_STEP_S,
    OFF,
    ROUTE,
    SAME,
    START,
    TURN,
    Candidates,
    Costs,
    Intervals,
    Lattice,
    Transitions,
)

_DRIVEN_FACTOR = 1.15  # how much longer than the distance driven by the speeds a step may be


class Model(NamedTuple):
    """The hidden Markov model of one drive, and memory to search the network in."""

    graph: ChainGraph
    cand: Candidates
    intervals: Intervals
    reach: Reach
    costs: Costs


@inlined
def _step_cost(length: float, chord: float, driven: float, costs: Costs) -> float:
    """Cost of a path length, given the straight distance and what the speeds say."""
    expected = chord if math.isnan(driven) else max(driven, chord)
    return abs(length - expected) / (costs.beta_m + costs.beta_share * max(expected - 50.0, 0.0))


@inlined
def within_chain(ea: int, pa: float, length: float, eb: int, pb: float, back_m: float) -> tuple[int, float]:
    """Kind and length of the step from a place on a chain of some length to another, kind -1 if on none with it."""
    if ea == eb and pb >= pa - back_m:
        return SAME, max(pb - pa, 0.0)
    if ea == (eb ^ 1):
        return TURN, abs(length - pb - pa)
    return -1, 0.0


@inlined
def over_nodes(
    ea: int, pa: float, length: float, eb: int, pb: float, back_m: float, via: int, dist: float
) -> tuple[float, bool]:
    """Length of a step over the node at the end of chain ea, and whether it turns round on arriving.

    ``via`` is the chain by which the search reached the tail of eb (-1: it began there), ``dist`` how far.
    Infinite where the step is one along the chain.
    """
    if (eb == (ea ^ 1) and via < 0) or (ea == eb and pb >= pa - back_m):
        return np.inf, False
    return length - pa + dist + pb, via == (eb ^ 1)


@inlined
def _relax(
    lattice: Lattice,
    transitions: Transitions,
    count: int,
    a: int,
    b: int,
    cost: float,
    kind: int,
    length: float,
) -> int:
    """Note a possible step and keep it where it is the best yet; the new count."""
    transitions.source[count], transitions.target[count], transitions.cost[count] = a, b, cost
    total = lattice.cost[a] + cost
    if total < lattice.cost[b]:
        lattice.cost[b], lattice.back[b] = total, a
        lattice.kind[b], lattice.length_m[b] = kind, length
    return count + 1


@inlined
def _link_within(
    model: Model, lattice: Lattice, transitions: Transitions, k: int, a: int, bound: float, count: int
) -> int:
    """The steps from candidate a along its chain; the new count."""
    graph, cand, intervals, _, costs = model
    chord, driven, edge, at = intervals.chord_m[k], intervals.driven_m[k], cand.edge, cand.at_m
    ea, pa, length_m = edge[a], at[a], graph.length_m[edge[a] >> 1]
    for b in range(cand.start[k], cand.start[k + 1]):
        kind, length = within_chain(ea, pa, length_m, edge[b], at[b], costs.back_m)
        if kind >= 0 and length <= bound:
            cost = _step_cost(length, chord, driven, costs) + (costs.u_turn if kind == TURN else 0.0)
            count = _relax(lattice, transitions, count, a, b, cost, kind, length)
    return count


@inlined
def _link_over(
    model: Model,
    lattice: Lattice,
    transitions: Transitions,
    k: int,
    a: int,
    bound: float,
    count: int,
    stamp: int,
) -> int:
    """The steps from candidate a over the node at the end of its chain, searched from; the new count."""
    graph, cand, intervals, reach, costs = model
    chord, driven, edge, at = intervals.chord_m[k], intervals.driven_m[k], cand.edge, cand.at_m
    tail, reached, dist, via = graph.tail, reach.stamp, reach.dist, reach.via
    ea, pa, length_m = edge[a], at[a], graph.length_m[edge[a] >> 1]
    for b in range(cand.start[k], cand.start[k + 1]):
        v = tail[edge[b]]
        if reached[v] != stamp:
            continue
        length, turns = over_nodes(ea, pa, length_m, edge[b], at[b], costs.back_m, via[v], dist[v])
        if length <= bound:
            cost = _step_cost(length, chord, driven, costs) + (costs.u_turn if turns else 0.0)
            count = _relax(lattice, transitions, count, a, b, cost, ROUTE, length)
    return count


@inlined
def _nearest_to(graph: ChainGraph, cand: Candidates, lattice: Lattice, k: int, a: int, bound: float) -> float:
    """The least way, within the bound, of sample k's candidates to the node that a drives to.

    Infinite if one before a drives there: it has been searched from.
    """
    edge, at, head, length, cost = cand.edge, cand.at_m, graph.head, graph.length_m, lattice.cost
    node, shortest = head[edge[a]], np.inf
    for other in range(cand.start[k], cand.start[k + 1]):
        left = length[edge[other] >> 1] - at[other]
        if head[edge[other]] == node and left <= bound and cost[other] < np.inf:
            if other < a:
                return np.inf
            shortest = min(shortest, left)
    return shortest


@inlined
def _link(
    model: Model, lattice: Lattice, transitions: Transitions, k: int, bound: float, count: int, stamp: int
) -> tuple[int, int]:
    """All steps from sample k - 1 to k no longer than the bound; the new counts of steps and searches."""
    graph, cand = model.graph, model.cand
    edge, head = cand.edge, graph.head
    for a in range(cand.start[k - 1], cand.start[k]):
        if lattice.cost[a] == np.inf:
            continue
        count = _link_within(model, lattice, transitions, k, a, bound, count)
        if graph.length_m[edge[a] >> 1] - cand.at_m[a] > bound:
            continue
        shortest = _nearest_to(graph, cand, lattice, k - 1, a, bound)
        if shortest > bound:
            continue
        stamp += 1
        search_from(graph, model.reach, head[edge[a]], bound - shortest, stamp)
        for other in range(a, cand.start[k]):
            if head[edge[other]] == head[edge[a]] and lattice.cost[other] < np.inf:
                count = _link_over(model, lattice, transitions, k, other, bound, count, stamp)
    return count, stamp


@inlined
def _best(cand: Candidates, lattice: Lattice, k: int) -> tuple[int, float]:
    """The best state at sample k, candidate or OFF, and its cost."""
    state, cost = OFF, lattice.off_cost[k]
    for a in range(cand.start[k], cand.start[k + 1]):
        if lattice.cost[a] < cost:
            state, cost = a, lattice.cost[a]
    return state, cost


@inlined
def _begin(cand: Candidates, lattice: Lattice, k: int) -> None:
    """A column of the lattice without steps from the one before: the first, and those after an outage.

    Over an outage the predecessor is written as -3 - state, so that it cannot be taken for a step.
    """
    back, base = START, 0.0
    if k > 0:
        state, base = _best(cand, lattice, k - 1)
        back = -3 - state
    for b in range(cand.start[k], cand.start[k + 1]):
        lattice.cost[b], lattice.back[b] = base + cand.cost[b], back
    lattice.off_cost[k], lattice.off_back[k] = base + cand.off[k], back


@inlined
def _finish(cand: Candidates, intervals: Intervals, costs: Costs, lattice: Lattice, k: int) -> None:
    """Leave the road or come back to it, add the likelihood of sample k everywhere, and drop far worse candidates."""
    point = cand.off[k]
    lattice.off_cost[k], lattice.off_back[k] = lattice.off_cost[k - 1] + point, OFF
    for a in range(cand.start[k - 1], cand.start[k]):
        total = lattice.cost[a] + intervals.switch[k] + point
        if total < lattice.off_cost[k]:
            lattice.off_cost[k], lattice.off_back[k] = total, a
    back_on, least = lattice.off_cost[k - 1] + intervals.switch[k - 1], np.inf
    for b in range(cand.start[k], cand.start[k + 1]):
        if back_on < lattice.cost[b]:
            lattice.cost[b], lattice.back[b] = back_on, OFF
        lattice.cost[b] += cand.cost[b]
        least = min(least, lattice.cost[b])
    for b in range(cand.start[k], cand.start[k + 1]):
        if lattice.cost[b] > least + costs.beam:
            lattice.cost[b] = np.inf


@compiled
def viterbi(model: Model) -> tuple[Lattice, Transitions, int]:
    """The best path through all samples, every step that was possible, and the state of the last sample.

    The states are candidates or OFF. A step may be as long as the straight distance (or the distance driven) plus a
    slack. Where nothing is reached so, or where more than seconds pass, it may be twice that distance plus the slack.
    """
    cand, intervals, costs = model.cand, model.intervals, model.costs
    m, total = len(intervals.outage), len(cand.edge)
    lattice = Lattice(
        np.full(total, np.inf),
        np.full(total, START, np.int64),
        np.zeros(total, np.int64),
        np.zeros(total),
        np.full(m, np.inf),
        np.full(m, START, np.int64),
    )
    transitions = Transitions(
        np.zeros(m + 1, np.int64), np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    )
    count, stamp = 0, 0
    for k in range(m):
        transitions.start[k] = count
        if k == 0 or intervals.outage[k]:
            _begin(cand, lattice, k)
            continue
        pairs = (cand.start[k] - cand.start[k - 1]) * (cand.start[k + 1] - cand.start[k])
        if count + 2 * pairs > len(transitions.source):
            transitions = _room(transitions, count, 2 * pairs)
        chord, driven, lapse = intervals.chord_m[k], intervals.driven_m[k], intervals.lapse_s[k]
        expected = chord if math.isnan(driven) else max(chord, _DRIVEN_FACTOR * driven)
        for factor in (1.0 if lapse <= LONG_STEP_S else 2.0, 2.0):
            bound = min(factor * expected, costs.fastest_mps * lapse) + costs.slack_m
            now, stamp = _link(model, lattice, transitions, k, bound, count, stamp)
            if now > count:
                break
        count = now
        _finish(cand, intervals, costs, lattice, k)
    transitions.start[m] = count
    return lattice, transitions, _best(cand, lattice, m - 1)[0]


@compiled
def _room(transitions: Transitions, count: int, more: int) -> Transitions:
    """The same steps with room for more."""
    size = 2 * (count + more) + 1024
    source, target, cost = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size)
    source[:count], target[:count] = transitions.source[:count], transitions.target[:count]
    cost[:count] = transitions.cost[:count]
    return Transitions(transitions.start, source, target, cost)
