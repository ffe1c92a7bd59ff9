"""The possible steps from one kept sample to the next: along a chain, back on it, or over nodes; for compiled loops.

A loop that reads an array from a group counts the array's users anew each time, which takes longer than the arithmetic.
Therefore these helpers take single arrays, and so do loops over them; they are pasted in, so that many cost nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import inlined
from fusion.matching.lattice import LONG_STEP_S, ROUTE, SAME, TURN, Costs
from fusion.types import Floats, Ints

_DRIVEN_FACTOR = 1.15  # how much longer than the distance driven by the speeds a step may be


class Step(NamedTuple):
    """What a step between two kept samples may be: no longer than ``bound_m``, best ``expected_m`` long, less probable
    by the factor e for each ``spread_m`` of difference; ``back_m`` and ``u_turn`` as in ``Costs``.
    """

    bound_m: float
    expected_m: float
    spread_m: float
    back_m: float
    u_turn: float


@inlined
def allowed_step(chord: float, driven: float, lapse: float, widened: bool, costs: Costs) -> Step:
    """What a step may be over a straight distance (m), the distance by the speeds (NaN: unknown) and a time (s)."""
    unknown = math.isnan(driven)
    longest = chord if unknown else max(chord, _DRIVEN_FACTOR * driven)
    expected = chord if unknown else max(chord, driven)
    factor = 2.0 if widened or lapse > LONG_STEP_S else 1.0
    bound = min(factor * longest, costs.fastest_mps * lapse) + costs.slack_m
    spread = costs.beta_m + costs.beta_share * max(expected - 50.0, 0.0)
    return Step(bound, expected, spread, costs.back_m, costs.u_turn)


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
def link_within(
    edge: Ints,
    at: Floats,
    length_m: Floats,
    source: Ints,
    target: Ints,
    cost: Floats,
    kind: NDArray[np.int8],
    step_m: Floats,
    count: int,
    a: int,
    begin: int,
    end: int,
    step: Step,
) -> int:
    """Note the steps from candidate a along its chain to those from ``begin`` to ``end``; the new count."""
    ea, pa = edge[a], at[a]
    whole = length_m[ea >> 1]
    for b in range(begin, end):
        way, length = within_chain(ea, pa, whole, edge[b], at[b], step.back_m)
        if way >= 0 and length <= step.bound_m:
            source[count], target[count], kind[count], step_m[count] = a, b, way, length
            turning = step.u_turn if way == TURN else 0.0
            cost[count] = abs(length - step.expected_m) / step.spread_m + turning
            count += 1
    return count


@inlined
def link_over(
    edge: Ints,
    at: Floats,
    length_m: Floats,
    tail: Ints,
    dist: Floats,
    via: Ints,
    reached: Ints,
    stamp: int,
    source: Ints,
    target: Ints,
    cost: Floats,
    kind: NDArray[np.int8],
    step_m: Floats,
    count: int,
    a: int,
    begin: int,
    end: int,
    step: Step,
) -> int:
    """As ``link_within``, the steps over the node at the end of the chain of a, which has been searched from."""
    ea, pa = edge[a], at[a]
    whole = length_m[ea >> 1]
    for b in range(begin, end):
        eb = edge[b]
        v = tail[eb]
        if reached[v] != stamp:
            continue
        length, turns = over_nodes(ea, pa, whole, eb, at[b], step.back_m, via[v], dist[v])
        if length <= step.bound_m:
            source[count], target[count], kind[count], step_m[count] = a, b, ROUTE, length
            turning = step.u_turn if turns else 0.0
            cost[count] = abs(length - step.expected_m) / step.spread_m + turning
            count += 1
    return count


@inlined
def nearest_to(
    edge: Ints,
    at: Floats,
    length_m: Floats,
    head: Ints,
    cost: Floats,
    first: int,
    a: int,
    end: int,
    bound: float,
) -> float:
    """The least way, within the bound, of the candidates from ``first`` to ``end`` to the node that a drives to.

    Infinite if one before a drives there: it has been searched from.
    """
    node, shortest = head[edge[a]], np.inf
    for other in range(first, end):
        left = length_m[edge[other] >> 1] - at[other]
        if head[edge[other]] == node and left <= bound and cost[other] < np.inf:
            if other < a:
                return np.inf
            shortest = min(shortest, left)
    return shortest
