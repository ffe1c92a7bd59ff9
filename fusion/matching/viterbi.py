"""Viterbi over the candidates of a drive, with bounded shortest paths between them; compiled.

This file finds the best path; ``steps`` says which steps there are, ``posterior`` how probable the path is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled, inlined
from fusion.matching.chains import ChainGraph, Reach, search_arrays
from fusion.matching.lattice import OFF, START, Candidates, Costs, Intervals, Lattice, Transitions
from fusion.matching.steps import allowed_step, link_over, link_within, nearest_to
from fusion.types import Floats, Ints


class Model(NamedTuple):
    """The hidden Markov model of one drive, and memory to search the network in."""

    graph: ChainGraph
    cand: Candidates
    intervals: Intervals
    reach: Reach
    costs: Costs


@compiled
def viterbi(model: Model) -> tuple[Lattice, Transitions, int]:
    """The best path through all samples, every step that was possible, and the state of the last sample.

    The states are candidates or OFF. A step may be as long as the straight distance (or the distance driven) plus a
    slack. Where nothing is reached so, or where more than seconds pass, it may be twice that distance plus the slack.
    """
    m, total = len(model.intervals.outage), len(model.cand.edge)
    lattice = Lattice(
        np.full(total, np.inf),
        np.full(total, START, np.int64),
        np.zeros(total, np.int8),
        np.zeros(total),
        np.full(m, np.inf),
        np.full(m, START, np.int64),
    )
    transitions = _room(np.zeros(m + 1, np.int64), 4 * total + 256)
    k, count, stamp = 0, 0, 0
    while True:
        k, count, stamp = _walk(model, lattice, transitions, k, count, stamp)
        if k == m:
            break
        transitions = _larger(transitions, count)
    transitions.start[m] = count
    return lattice, transitions, _best(model.cand.start, lattice.cost, lattice.off_cost, m - 1)[0]


@compiled
def _walk(  # noqa: C901 (one loop nest: a helper with so many arrays took longer than the steps)
    model: Model, lattice: Lattice, transitions: Transitions, k: int, count: int, stamp: int
) -> tuple[int, int, int]:
    """Go on from sample k as long as there is room for steps: the sample that has none, the new counts.

    All arrays are taken out of their groups before the loop (``steps`` says why), and none is replaced in it.
    """
    graph, (start, edge, at, point, off_point), intervals, reach, costs = model
    chord, driven, lapse, outage, switch = intervals
    head, tail, length_m = graph.head, graph.tail, graph.length_m
    out_start, out_edge = graph.out_start, graph.out_edge
    dist, via, reached, heap_key, heap_node = reach
    cost, back, kind, way_m, off_cost, off_back = lattice
    first_step, source, target, step_cost, step_kind, step_m = transitions
    m = len(outage)
    while k < m:
        first, begin, end = start[max(k - 1, 0)], start[k], start[k + 1]
        first_step[k] = count
        if k == 0 or outage[k]:
            _begin(start, point, off_point, cost, back, off_cost, off_back, k)
            k += 1
            continue
        if count + 2 * (begin - first) * (end - begin) > len(source):
            break
        now = count
        for widened in range(2):
            step = allowed_step(chord[k], driven[k], lapse[k], widened > 0, costs)
            for a in range(first, begin):
                if cost[a] == np.inf:
                    continue
                now = link_within(
                    edge, at, length_m, source, target, step_cost, step_kind, step_m, now, a, begin, end, step
                )
                node = head[edge[a]]
                if length_m[edge[a] >> 1] - at[a] > step.bound_m:
                    continue
                shortest = nearest_to(edge, at, length_m, head, cost, first, a, begin, step.bound_m)
                if shortest > step.bound_m:
                    continue
                stamp += 1
                search_arrays(
                    out_start, out_edge, head, length_m, dist, via, reached, heap_key, heap_node,
                    node, step.bound_m - shortest, stamp,
                )  # fmt: skip
                for other in range(a, begin):  # one search serves all that drive to the same node
                    if head[edge[other]] == node and cost[other] < np.inf:
                        now = link_over(
                            edge, at, length_m, tail, dist, via, reached, stamp,
                            source, target, step_cost, step_kind, step_m, now, other, begin, end, step,
                        )  # fmt: skip
            if now > count:
                break
        _relax(source, target, step_cost, step_kind, step_m, cost, back, kind, way_m, count, now)
        count = now
        _finish(start, point, off_point, switch, cost, back, off_cost, off_back, costs.beam, k)
        k += 1
    return k, count, stamp


@inlined
def _relax(
    source: Ints,
    target: Ints,
    step_cost: Floats,
    step_kind: NDArray[np.int8],
    step_m: Floats,
    cost: Floats,
    back: Ints,
    kind: NDArray[np.int8],
    way_m: Floats,
    begin: int,
    end: int,
) -> None:
    """Of the steps from ``begin`` to ``end`` keep the best one to each candidate."""
    for i in range(begin, end):
        a, b = source[i], target[i]
        total = cost[a] + step_cost[i]
        if total < cost[b]:
            cost[b], back[b], kind[b], way_m[b] = total, a, step_kind[i], step_m[i]


@inlined
def _best(start: Ints, cost: Floats, off_cost: Floats, k: int) -> tuple[int, float]:
    """The best state at sample k, candidate or OFF, and its cost."""
    state, least = OFF, off_cost[k]
    for a in range(start[k], start[k + 1]):
        if cost[a] < least:
            state, least = a, cost[a]
    return state, least


@inlined
def _begin(
    start: Ints,
    point: Floats,
    off_point: Floats,
    cost: Floats,
    back: Ints,
    off_cost: Floats,
    off_back: Ints,
    k: int,
) -> None:
    """A column of the lattice without steps from the one before: the first, and those after an outage.

    Over an outage the predecessor is written as -3 - state, so that it cannot be taken for a step.
    """
    predecessor, base = START, 0.0
    if k > 0:
        state, base = _best(start, cost, off_cost, k - 1)
        predecessor = -3 - state
    for b in range(start[k], start[k + 1]):
        cost[b], back[b] = base + point[b], predecessor
    off_cost[k], off_back[k] = base + off_point[k], predecessor


@inlined
def _finish(
    start: Ints,
    point: Floats,
    off_point: Floats,
    switch: Floats,
    cost: Floats,
    back: Ints,
    off_cost: Floats,
    off_back: Ints,
    beam: float,
    k: int,
) -> None:
    """Leave the road or come back to it, add the likelihood of sample k everywhere, and drop far worse candidates."""
    off_cost[k], off_back[k] = off_cost[k - 1] + off_point[k], OFF
    for a in range(start[k - 1], start[k]):
        total = cost[a] + switch[k] + off_point[k]
        if total < off_cost[k]:
            off_cost[k], off_back[k] = total, a
    back_on, least = off_cost[k - 1] + switch[k - 1], np.inf
    for b in range(start[k], start[k + 1]):
        if back_on < cost[b]:
            cost[b], back[b] = back_on, OFF
        cost[b] += point[b]
        least = min(least, cost[b])
    for b in range(start[k], start[k + 1]):
        if cost[b] > least + beam:
            cost[b] = np.inf


@compiled
def _room(start: Ints, size: int) -> Transitions:
    """Room for so many steps."""
    return Transitions(
        start,
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size),
        np.empty(size, np.int8),
        np.empty(size),
    )


@compiled
def _larger(old: Transitions, count: int) -> Transitions:
    """The first ``count`` steps with twice as much room."""
    new = _room(old.start, 2 * len(old.source))
    new.source[:count], new.target[:count] = old.source[:count], old.target[:count]
    new.cost[:count], new.kind[:count] = old.cost[:count], old.kind[:count]
    new.length_m[:count] = old.length_m[:count]
    return new
