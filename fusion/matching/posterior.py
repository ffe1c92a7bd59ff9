"""How probable the best path is: forward-backward over the possible steps of a drive (compiled), and what lowers it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.matching.lattice import (
    LONG_STEP_S,
    OFF,
    START,
    Candidates,
    Costs,
    Intervals,
    Lattice,
    Transitions,
)
from fusion.types import Floats, Ints


class Posterior(NamedTuple):
    """How probable the best path is: four probabilities for each kept sample k.

    ``at``: the sample lies on the chain of its state. The others are of the step from sample k - 1. ``out``: it
    touches the chain that it leaves. ``into``: it touches the chain that it reaches. ``between``: it goes from one to
    the other.
    """

    at: Floats
    out: Floats
    into: Floats
    between: Floats


class _Chances(NamedTuple):
    """Likelihoods of steps (``weight``), of candidates, and by sample of being ``off`` the road and its ``switch``."""

    weight: Floats
    likelihood: Floats
    off: Floats
    switch: Floats


@compiled
def posterior(
    cand: Candidates, intervals: Intervals, transitions: Transitions, state: Ints, costs: Costs
) -> Posterior:
    """Probabilities of the states and steps of the path, under the costs divided by ``temperature``.

    Rabiner 1989, III A and B, with each column of alpha and beta scaled to sum 1.
    """
    cool = 1.0 / costs.temperature
    chances = _Chances(
        np.exp(-cool * transitions.cost[: transitions.start[-1]]),
        np.exp(-cool * cand.cost),
        np.exp(-cool * cand.off),
        np.exp(-cool * intervals.switch),
    )
    alpha = _forward(cand, intervals, transitions, chances)
    beta = _backward(cand, intervals, transitions, chances)
    return _of_path(cand, intervals, transitions, state, chances, alpha, beta)


def doubt_unseen_ways(
    chance: Posterior, intervals: Intervals, costs: Costs, lattice: Lattice, state: Ints, joined: Ints
) -> Posterior:
    """The same with a lower ``between`` where no sample saw the way.

    Only the shortest way between two places is ever looked at. In seconds without a position another way may have been
    driven. The more the length of the shortest one differs from the straight line, or from the distance by the speeds,
    the lower the probability becomes, down to half of what it was.
    """
    before = np.concatenate([[START], state[:-1]])
    length = lattice.length_m[np.maximum(state, 0)] if len(lattice.length_m) else np.zeros(len(state))
    expected = np.fmax(intervals.chord_m, intervals.driven_m)
    cost = np.abs(length - expected) / (costs.beta_m + costs.beta_share * np.maximum(expected - 50.0, 0.0))
    doubt = np.where(intervals.lapse_s > LONG_STEP_S, 0.5 + 0.5 * np.exp(-0.25 * cost), 1.0)
    between = np.where((joined >= 0) & (joined != before), 0.5, chance.between * doubt)
    return chance._replace(between=between)


@compiled
def _forward(
    cand: Candidates, intervals: Intervals, transitions: Transitions, chances: _Chances
) -> tuple[Floats, Floats]:
    """Alpha of every candidate and of being off the road."""
    weight, likelihood, off, switch = chances
    start, outage = cand.start, intervals.outage
    first_step, source, target = transitions.start, transitions.source, transitions.target
    m = len(off)
    alpha, alpha_off = np.zeros(len(likelihood)), np.zeros(m)
    for k in range(m):
        a0, b0, b1 = start[max(k - 1, 0)], start[k], start[k + 1]
        if k == 0 or outage[k]:
            alpha[b0:b1] = likelihood[b0:b1]
            alpha_off[k] = off[k]
        else:
            for i in range(first_step[k], first_step[k + 1]):
                alpha[target[i]] += alpha[source[i]] * weight[i]
            alpha_off[k] = off[k] * (alpha_off[k - 1] + alpha[a0:b0].sum() * switch[k])
            for b in range(b0, b1):
                alpha[b] = (alpha[b] + alpha_off[k - 1] * switch[k - 1]) * likelihood[b]
        _scale(alpha, b0, b1, alpha_off, k)
    return alpha, alpha_off


@compiled
def _backward(
    cand: Candidates, intervals: Intervals, transitions: Transitions, chances: _Chances
) -> tuple[Floats, Floats]:
    """Beta of every candidate and of being off the road."""
    weight, likelihood, off, switch = chances
    start, outage = cand.start, intervals.outage
    first_step, source, target = transitions.start, transitions.source, transitions.target
    m = len(off)
    beta, beta_off = np.zeros(len(likelihood)), np.ones(m)
    for k in range(m - 1, -1, -1):
        b0, b1 = start[k], start[k + 1]
        if k == m - 1 or outage[k + 1]:
            beta[b0:b1] = 1.0
        else:
            for i in range(first_step[k + 1], first_step[k + 2]):
                b = target[i]
                beta[source[i]] += weight[i] * likelihood[b] * beta[b]
            beta_off[k] = off[k + 1] * beta_off[k + 1]
            for b in range(b1, start[k + 2]):
                beta_off[k] += switch[k] * likelihood[b] * beta[b]
            for a in range(b0, b1):
                beta[a] += switch[k + 1] * off[k + 1] * beta_off[k + 1]
        _scale(beta, b0, b1, beta_off, k)
    return beta, beta_off


@inlined
def _scale(values: Floats, begin: int, end: int, off: Floats, k: int) -> None:
    """Scale a column to sum 1."""
    total = off[k]
    for b in range(begin, end):
        total += values[b]
    if total > 0.0:
        off[k] /= total
        for b in range(begin, end):
            values[b] /= total


@inlined
def _on_chain(start: Ints, chain: Ints, k: int, edge: int, gamma: Floats) -> float:
    """The probability that sample k lies on a directed chain."""
    total = 0.0
    for b in range(start[k], start[k + 1]):
        if chain[b] == edge:
            total += gamma[b]
    return total


@compiled
def _of_path(
    cand: Candidates,
    intervals: Intervals,
    transitions: Transitions,
    state: Ints,
    chances: _Chances,
    forward: tuple[Floats, Floats],
    backward: tuple[Floats, Floats],
) -> Posterior:
    """Sum the probabilities of all states and steps that agree with the path."""
    weight, likelihood = chances.weight, chances.likelihood
    start, chain, outage = cand.start, cand.edge, intervals.outage
    first_step, source, target = transitions.start, transitions.source, transitions.target
    (alpha, alpha_off), (beta, beta_off) = forward, backward
    m = len(state)
    at, out, into, between = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    gamma = alpha * beta
    for k in range(m):
        total = alpha_off[k] * beta_off[k]
        for b in range(start[k], start[k + 1]):
            total += gamma[b]
        for b in range(start[k], start[k + 1]):
            gamma[b] /= max(total, 1e-300)
        if state[k] == OFF:
            continue
        edge = chain[state[k]]
        at[k] = min(_on_chain(start, chain, k, edge, gamma), 1.0)
        if k == 0 or outage[k] or state[k - 1] == OFF or chain[state[k - 1]] == edge:
            continue
        left = chain[state[k - 1]]
        whole, from_left, in_left, in_edge = 0.0, 0.0, 0.0, 0.0
        for i in range(first_step[k], first_step[k + 1]):
            a, b = source[i], target[i]
            p = alpha[a] * weight[i] * likelihood[b] * beta[b]
            whole += p
            if chain[a] == left and chain[b] == edge:
                from_left += p
            if chain[a] == left and chain[b] == left:
                in_left += p
            if chain[a] == edge and chain[b] == edge:
                in_edge += p
        # The steps between candidates have their share of all; the rest goes over the off-road state.
        on_road = gamma[start[k] : start[k + 1]].sum()
        share = on_road / max(whole, 1e-300)
        between[k] = from_left * share
        out[k] = at[k - 1] + _on_chain(start, chain, k, left, gamma) - in_left * share
        into[k] = at[k] + _on_chain(start, chain, k - 1, edge, gamma) - in_edge * share
    return Posterior(at, np.clip(out, 0.0, 1.0), np.clip(into, 0.0, 1.0), np.clip(between, 0.0, 1.0))
