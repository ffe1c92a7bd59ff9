"""The loops of ``smoother``: forwards through the steps and backwards, over plain arrays.

States stand in lanes, whose number the compiler knows: it unrolls what runs over them. The loops know which entries of
matrices may differ from 0 at all, and pass over the others: most of a transition is 0 or 1, and a measurement sees few
states.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled_vector, inlined
from fusion.types import Floats, Ints


class Lanes(NamedTuple):
    """A model (``smoother.LinearModel``) as the loops take it, of w lanes; those beyond its states hold zeros.

    ``states`` (d,) are the numbers of the states in the lanes, ``width`` is a tuple of w numbers. ``carried`` (n, j)
    are the entries of transitions at rows ``to`` and columns ``of`` (j,), ``shaken`` (n, e) those of the steps' noise
    at ``row`` and ``column`` (e,) of the lower triangle. ``mean`` (w,), ``covariance`` (w, w) and ``design`` (m, w) are
    in the order of the lanes.
    """

    states: Ints
    width: tuple[int, ...]
    to: Ints
    of: Ints
    carried: Floats
    row: Ints
    column: Ints
    shaken: Floats
    mean: Floats
    covariance: Floats
    first_row: Ints
    design: Floats
    value: Floats
    variance: Floats


@inlined
def _carry_half(to: Ints, of: Ints, by: Floats, x: Floats, p: Floats, moved: Floats, half: Floats) -> None:
    """Turn ``x`` (w,) into T x, and fill ``half`` (w, w) with T P; ``by`` (j,) are the entries of T."""
    w = len(x)
    for a in range(w):
        moved[a] = 0.0
        for b in range(w):
            half[a, b] = 0.0
    for j in range(len(to)):
        a, c, f = to[j], of[j], by[j]
        moved[a] += f * x[c]
        for b in range(w):
            half[a, b] += f * p[c, b]
    for a in range(w):
        x[a] = moved[a]


@inlined
def _carry_other_half(
    width: tuple[int, ...], to: Ints, of: Ints, by: Floats, half: Floats, p: Floats
) -> None:
    """Fill ``p`` (w, w) with ``half`` T'; its lower triangle is right, whatever rounding does to the other."""
    w = len(width)
    for a in range(w):
        for b in range(w):
            p[a, b] = 0.0
    for j in range(len(to)):
        a, c, f = to[j], of[j], by[j]
        for b in range(w):
            p[a, b] += f * half[b, c]


@inlined
def _mirror(width: tuple[int, ...], p: Floats) -> None:
    """Copy the lower triangle of ``p`` (w, w) to the upper one."""
    for a in range(len(width)):
        for b in range(a):
            p[b, a] = p[a, b]


@compiled_vector
def run_forward(  # noqa: C901, PLR0912 (one loop nest: calls with so many arrays cost more than the sums)
    lanes: Lanes,
    goes_on: bool,
    x: Floats,
    p: Floats,
    followed: int,
    mean: Floats,
    covariance: Floats,
    innovation: Floats,
    scale: Floats,
    gain: Floats,
    before: Floats,
) -> float:
    """Fill predicted means and covariances, innovations, their variances and gains; return the log-likelihood.

    ``x`` (w,) and ``p`` (w, w) are what is known before the first measurement, or, where the filter ``goes_on``, before
    the step that leads to it; in the end they are what is known after the last one. Means and covariances, of all
    states, what is said of measurements and ``before`` (n, w + 1) are kept where there is room for them (none: n = 0).
    ``before`` holds what the step k - 1 knew of the state in the lane ``followed``: its covariance with the states at
    step k, and its mean.
    """
    states, width, to, of, carried, row, column, shaken, _, _, first_row, design, value, variance = lanes
    n, d, w = len(carried), len(states), len(width)
    moved, g, own_gain, half = np.empty(w), np.empty(w), np.empty(w), np.empty((w, w))
    likelihood, product = 0.0, 1.0
    for k in range(n):
        if k or goes_on:
            _mirror(width, p)  # but for a step of time only the lower triangle is kept right
            if len(before):
                before[k, w] = x[followed]
            _carry_half(to, of, carried[k], x, p, moved, half)
            if len(before):
                for a in range(w):
                    before[k, a] = half[a, followed]
            _carry_other_half(width, to, of, carried[k], half, p)
            for j in range(len(row)):
                p[row[j], column[j]] += shaken[k, j]
        if len(mean):
            for a in range(d):
                mean[k, states[a]] = x[a]
                for b in range(a + 1):
                    covariance[k, states[a], states[b]] = covariance[k, states[b], states[a]] = p[a, b]
        for i in range(first_row[k], first_row[k + 1]):
            s, v = variance[i], value[i]
            for a in range(w):
                g[a] = 0.0
            for a in range(w):
                h = design[i, a]
                if h != 0.0:
                    v -= h * x[a]
                    for b in range(a + 1):
                        g[b] += h * p[a, b]
                    for b in range(a + 1, w):
                        g[b] += h * p[b, a]
            for a in range(w):
                s += design[i, a] * g[a]
            for a in range(w):
                own_gain[a] = g[a] / s
            if len(innovation):
                innovation[i], scale[i] = v, s
                for a in range(w):
                    gain[i, a] = own_gain[a]
            likelihood -= 0.5 * v * v / s
            product *= s  # one logarithm for many
            if not 1e-100 < product < 1e100:
                likelihood -= 0.5 * math.log(product)
                product = 1.0
            for a in range(w):
                share = own_gain[a]
                x[a] += share * v
                for b in range(a + 1):
                    p[a, b] -= share * g[b]
    return likelihood - 0.5 * math.log(product)


@compiled_vector
def run_backward(  # noqa: C901, PLR0912
    lanes: Lanes,
    goes_on: bool,
    r: Floats,
    big: Floats,
    mean: Floats,
    covariance: Floats,
    innovation: Floats,
    scale: Floats,
    gain: Floats,
    before: Floats,
    residual: Floats,
    precision: Floats,
    pull: Floats,
    pull_precision: Floats,
    carry_pull: Floats,
) -> None:
    """Turn predicted means and covariances into smoothed ones; fill smoothing errors, their precisions and pulls.

    ``r`` (w,) and ``big`` (w, w) are the pull of what comes after the last step and its precision, in the end, where
    the filter ``goes_on`` from steps before, the pull and precision of all this on the last of those; else of nothing.
    ``pull_precision`` (n, e) is that of the entries of the steps' noise. ``carry_pull`` (n, w) is the gradient of the
    log-likelihood by the column of the transition that ``before`` followed.
    """
    states, width, to, of, carried, row, column, _, _, _, first_row, design, _, _ = lanes
    n, d, w = len(carried), len(states), len(width)
    p, half = np.zeros((w, w)), np.empty((w, w))
    along, moved, g, seen = np.empty(w), np.empty(w), np.empty(w), np.empty(w, np.int64)
    for k in range(n - 1, -1, -1):
        for i in range(first_row[k + 1] - 1, first_row[k] - 1, -1):
            s = scale[i]
            u, square = innovation[i] / s, 1.0 / s
            for a in range(w):
                g[a] = gain[i, a]
                along[a] = 0.0
            for b in range(w):
                share = gain[i, b]
                for a in range(w):
                    along[a] += share * big[b, a]
            for a in range(w):
                u -= g[a] * r[a]
                square += g[a] * along[a]
            residual[i], precision[i] = u, square
            # L' N L in two steps, with L = 1 - gain design' / s: multiplied out, a vague start would cost all digits.
            # Only rows and columns of states that are seen change.
            count = 0
            for b in range(w):
                h = design[i, b]
                if h != 0.0:
                    seen[count] = b
                    count += 1
                    r[b] += h * u
                    total = 0.0
                    for a in range(w):
                        big[b, a] -= h * along[a]
                        total += g[a] * big[b, a]
                    moved[b] = h / s - total
            for j in range(count):
                b = seen[j]
                for other in range(count):
                    big[b, seen[other]] += design[i, seen[other]] * moved[b]
            for j in range(count):
                b = seen[j]
                for a in range(w):
                    big[a, b] = big[b, a]
        for a in range(w):
            pull[k, a] = r[a]
        for j in range(len(row)):
            pull_precision[k, j] = big[row[j], column[j]]
        if len(mean):
            for a in range(d):
                for b in range(d):
                    p[a, b] = covariance[k, states[a], states[b]]
            for a in range(w):
                for b in range(w):
                    half[a, b] = 0.0
                for c in range(w):
                    for b in range(w):
                        half[a, b] += p[a, c] * big[c, b]
            for a in range(d):
                for b in range(d):
                    mean[k, states[a]] += p[a, b] * r[b]
                for b in range(a + 1):
                    total = p[a, b]
                    for c in range(w):
                        total -= half[a, c] * p[b, c]
                    covariance[k, states[a], states[b]] = covariance[k, states[b], states[a]] = total
        if k or goes_on:
            if len(before):
                x = before[k, w]
                for a in range(w):
                    x += before[k, a] * r[a]
                for a in range(w):
                    carry_pull[k, a] = r[a] * x
                for b in range(w):
                    share = before[k, b]
                    for a in range(w):
                        carry_pull[k, a] -= share * big[b, a]
            _carry_half(of, to, carried[k], r, big, moved, half)
            _carry_other_half(width, of, to, carried[k], half, big)
            _mirror(width, big)
