"""The loops of ``smoother``: forwards through the steps and backwards, over plain arrays.

They know which entries of matrices may differ from 0 at all, and pass over the others: most of a transition is 0 or 1,
and a measurement sees few states.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled, inlined
from fusion.types import Floats, Ints


@inlined
def _carry_half(
    to: Ints, of: Ints, states: Ints, by: Floats, x: Floats, p: Floats, moved: Floats, half: Floats
) -> None:
    """Turn ``x`` (d,) into ``by`` x, and fill ``half`` (d, d) with ``by`` P.

    ``to`` and ``of`` (j,) are the rows and columns of what ``by`` may hold.
    """
    moved[:] = 0.0
    half[:] = 0.0
    for j in range(len(to)):
        a, c = to[j], of[j]
        f = by[states[a], states[c]]
        moved[a] += f * x[c]
        for b in range(len(x)):
            half[a, b] += f * p[c, b]
    x[:] = moved


@inlined
def _carry_other_half(to: Ints, of: Ints, states: Ints, by: Floats, half: Floats, p: Floats) -> None:
    """Add ``half`` times ``by``' to the lower triangle of ``p`` (d, d), and mirror it."""
    for j in range(len(to)):
        b, c = to[j], of[j]
        f = by[states[b], states[c]]
        for a in range(b, len(p)):
            p[a, b] += half[a, c] * f
    for a in range(len(p)):
        for b in range(a):
            p[b, a] = p[a, b]


@compiled
def run_forward(  # noqa: C901, PLR0912 (one loop nest: calls with so many arrays cost more than the sums)
    states: Ints,
    moves: Ints,
    transition: Floats,
    noise: Floats,
    start_mean: Floats,
    start_covariance: Floats,
    first_row: Ints,
    design: Floats,
    value: Floats,
    variance: Floats,
    mean: Floats,
    covariance: Floats,
    innovation: Floats,
    scale: Floats,
    gain: Floats,
) -> float:
    """Fill predicted means and covariances, innovations, their variances and gains; return the log-likelihood.

    Of ``states`` (d,) only. ``moves`` (j, 2): row and column, in ``states``, of what a transition may hold. Means and
    covariances are kept where there is room for them (none: shape (0, ...)); gains (m, d) are in the order of
    ``states``.
    """
    n, d = len(transition), len(states)
    stores = len(mean) > 0
    x, p = start_mean[states], np.empty((d, d))
    for a in range(d):
        for b in range(d):
            p[a, b] = start_covariance[states[a], states[b]]
    moved, half = np.empty(d), np.empty((d, d))
    h, seen, g = np.empty(d), np.empty(d, np.int64), np.empty(d)
    likelihood = 0.0
    for k in range(n):
        if k:
            _carry_half(moves[:, 0], moves[:, 1], states, transition[k], x, p, moved, half)
            for a in range(d):
                for b in range(a + 1):
                    p[a, b] = noise[k, states[a], states[b]]
            _carry_other_half(moves[:, 0], moves[:, 1], states, transition[k], half, p)
        if stores:
            for a in range(d):
                mean[k, states[a]] = x[a]
                for b in range(d):
                    covariance[k, states[a], states[b]] = p[a, b]
        for i in range(first_row[k], first_row[k + 1]):
            s, v = variance[i], value[i]
            count = 0
            for a in range(d):
                h[a] = design[i, states[a]]
                if h[a] != 0.0:
                    seen[count] = a
                    count += 1
            for a in range(d):
                g[a] = 0.0
            for j in range(count):
                b = seen[j]
                for a in range(d):
                    g[a] += p[b, a] * h[b]
            for j in range(count):
                a = seen[j]
                s += h[a] * g[a]
                v -= h[a] * x[a]
            innovation[i], scale[i] = v, s
            likelihood -= 0.5 * (np.log(s) + v * v / s)
            for a in range(d):
                gain[i, a] = g[a]
                share = g[a] / s
                x[a] += share * v
                for b in range(a + 1):
                    p[a, b] = p[b, a] = p[a, b] - share * g[b]
    return likelihood


@compiled
def run_backward(  # noqa: C901, PLR0912
    states: Ints,
    moves: Ints,
    transition: Floats,
    first_row: Ints,
    design: Floats,
    mean: Floats,
    covariance: Floats,
    innovation: Floats,
    scale: Floats,
    gain: Floats,
    residual: Floats,
    precision: Floats,
    pull: Floats,
    pull_precision: Floats,
) -> None:
    """Turn predicted means and covariances into smoothed ones; fill smoothing errors, their precisions and pulls.

    Of ``states`` only, as ``run_forward``.
    """
    n, d = len(transition), len(states)
    stores = len(mean) > 0
    r, big = np.zeros(d), np.zeros((d, d))
    work, along, moved = np.empty((d, d)), np.empty(d), np.empty(d)
    h, seen, g, p = np.empty(d), np.empty(d, np.int64), np.empty(d), np.empty((d, d))
    for k in range(n - 1, -1, -1):
        for i in range(first_row[k + 1] - 1, first_row[k] - 1, -1):
            s = scale[i]
            u, square = innovation[i] / s, 1.0 / s
            count = 0
            for a in range(d):
                h[a], g[a] = design[i, states[a]], gain[i, a] / s
                along[a] = 0.0
                if h[a] != 0.0:
                    seen[count] = a
                    count += 1
            for b in range(d):
                for a in range(d):
                    along[a] += big[b, a] * g[b]
                u -= g[b] * r[b]
            for a in range(d):
                square += g[a] * along[a]
            residual[i], precision[i] = u, square
            # L' N L in two steps, with L = 1 - gain design' / s: multiplied out, a vague start would cost all digits.
            # Only rows and columns of states that are seen change.
            for j in range(count):
                b = seen[j]
                r[b] += h[b] * u
                total = 0.0
                for a in range(d):
                    work[a, b] = big[a, b] - along[a] * h[b]
                    total += g[a] * work[a, b]
                moved[b] = total
            for j in range(count):
                b = seen[j]
                for a in range(d):
                    if h[a] == 0.0:
                        big[a, b] = big[b, a] = work[a, b]
                for other in range(j, count):
                    a = seen[other]
                    big[a, b] = big[b, a] = work[a, b] + h[a] * (h[b] / s - moved[b])
        for a in range(d):
            pull[k, states[a]] = r[a]
            for b in range(d):
                pull_precision[k, states[a], states[b]] = big[a, b]
        if stores:
            for a in range(d):
                for b in range(d):
                    p[a, b] = covariance[k, states[a], states[b]]
                    work[a, b] = 0.0
            for a in range(d):
                for c in range(d):
                    for b in range(d):
                        work[a, b] += p[a, c] * big[c, b]
            for a in range(d):
                for b in range(d):
                    mean[k, states[a]] += p[a, b] * r[b]
                for b in range(a + 1):
                    total = p[a, b]
                    for c in range(d):
                        total -= work[a, c] * p[b, c]
                    covariance[k, states[a], states[b]] = covariance[k, states[b], states[a]] = total
        if k:
            turned = transition[k].T
            _carry_half(moves[:, 1], moves[:, 0], states, turned, r, big, moved, work)
            big[:] = 0.0
            _carry_other_half(moves[:, 1], moves[:, 0], states, turned, work, big)
