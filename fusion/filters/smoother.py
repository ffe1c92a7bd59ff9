"""A linear Gaussian filter and smoother over steps with scalar measurements, in plain arrays.

The smoother is the disturbance form of the fixed-interval smoother (Bryson & Frazier 1969; Durbin & Koopman 2012,
4.4-4.5 and 6.4): it inverts nothing, so states that are constant or that nobody measures do no harm, and it yields the
leave-one-out residual of every measurement on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class LinearModel:
    """n steps of d states and m scalar measurements, ordered by step.

    ``transition`` (n, d, d) and ``noise`` (n, d, d) lead from step k - 1 to k (the first of each is not used); ``mean``
    (d,) and ``covariance`` (d, d) hold before the first measurement. Measurement i at ``step[i]`` is
    ``value[i] = design[i] @ x + error`` with variance ``variance[i]``.
    """

    transition: Floats
    noise: Floats
    mean: Floats
    covariance: Floats
    step: Ints
    design: Floats
    value: Floats
    variance: Floats

    @property
    def first_row(self) -> Ints:
        """Where each step's measurements begin, shape (n + 1,)."""
        return np.searchsorted(self.step, np.arange(len(self.transition) + 1)).astype(np.int64)

    def log_likelihood(self) -> float:
        """Of the measurements, by the innovations; constants left out."""
        return float(self._filtered(self._seen())[-1])

    def smooth(self) -> Smoothed:
        """Means and covariances of every state given all measurements."""
        seen = self._seen()
        mean, covariance, innovation, scale, gain, likelihood = self._filtered(seen)
        residual, precision = np.empty(len(self.step)), np.empty(len(self.step))
        pull, pull_precision = np.zeros(mean.shape), np.zeros(covariance.shape)
        run_backward(
            np.flatnonzero(seen), self.transition, self.first_row, self.design, mean, covariance, innovation, scale,
            gain, residual, precision, pull, pull_precision,
        )  # fmt: skip
        return Smoothed(
            mean, covariance, residual / precision, 1.0 / precision, pull, pull_precision, float(likelihood)
        )

    def _filtered(self, seen: Bools) -> tuple[Floats, Floats, Floats, Floats, Floats, float]:
        n, d = self.transition.shape[:2]
        m = len(self.step)
        mean, covariance = np.empty((n, d)), np.zeros((n, d, d))
        innovation, scale, gain = np.empty(m), np.empty(m), np.empty((m, d))
        likelihood = 0.0
        for states, first_row in ((seen, self.first_row), (~seen, np.zeros(n + 1, np.int64))):
            likelihood += run_forward(
                np.flatnonzero(states), self.transition, self.noise, self.mean, self.covariance, first_row, self.design,
                self.value, self.variance, mean, covariance, innovation, scale, gain,
            )  # fmt: skip
        return mean, covariance, innovation, scale, gain, likelihood

    def _seen(self) -> Bools:
        """The states (d,) that measurements see, or that hang together with such; the others take their own way."""
        linked = self.covariance != 0
        for matrix in (self.transition, self.noise):
            linked |= np.any(matrix[1:] != 0, axis=0)
        linked |= linked.T
        seen = np.any(self.design != 0, axis=0)
        for _ in seen:
            seen = seen | np.any(linked[seen], axis=0)
        return np.asarray(seen, np.bool_)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """``mean`` (n, d) and ``covariance`` (n, d, d) of the states; of each measurement the ``residual`` (m,) that it has
    against an estimate made without it, with the ``residual_variance`` it should have. ``pull`` (n, d) is the gradient
    of the log-likelihood by the states' change on the way to a step, ``pull_precision`` (n, d, d) its covariance.
    """

    mean: Floats
    covariance: Floats
    residual: Floats
    residual_variance: Floats
    pull: Floats
    pull_precision: Floats
    log_likelihood: float

    @property
    def break_score(self) -> Floats:
        """How many sigmas speak for a sudden change of a state on the way to a step, (n, d) (de Jong & Penzer 1998)."""
        scale = np.sqrt(np.diagonal(self.pull_precision, axis1=1, axis2=2))
        return np.divide(self.pull, scale, out=np.zeros_like(self.pull), where=scale > 0)

    def level_score(self, variance: Floats) -> Floats:
        """Of each measurement the derivative of the log-likelihood by the log of its ``variance``, (m,)."""
        return np.asarray(
            0.5 * variance * (np.square(self.residual / self.residual_variance) - 1 / self.residual_variance)
        )

    def noise_score(self, derivative: Floats) -> float:
        """The derivative of the log-likelihood by a parameter, by which the steps' noise has ``derivative`` (n, d, d).

        The score of Koopman and Shephard (1992): half the trace of (r r' - N) dQ, without the first step.
        """
        square = self.pull[:, :, None] * self.pull[:, None, :] - self.pull_precision
        return 0.5 * float(np.sum(square[1:] * derivative[1:]))


@compiled
def run_forward(  # noqa: C901, PLR0912 (one loop nest: calls with so many arrays cost more than the sums)
    states: Ints,
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

    Of ``states`` only. Most of a transition is 0, and is passed over.
    """
    n, d = len(mean), len(states)
    x, p = start_mean[states], np.empty((d, d))
    for a in range(d):
        for b in range(d):
            p[a, b] = start_covariance[states[a], states[b]]
    moved, half, f, h = np.empty(d), np.empty((d, d)), np.empty((d, d)), np.empty(d)
    likelihood = 0.0
    for k in range(n):
        if k:
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    half[a, b] = 0.0
                for c in range(d):
                    f[a, c] = transition[k, states[a], states[c]]
                    if f[a, c] != 0.0:
                        moved[a] += f[a, c] * x[c]
                        for b in range(d):
                            half[a, b] += f[a, c] * p[c, b]
            for a in range(d):
                x[a] = moved[a]
                for b in range(d):
                    p[a, b] = noise[k, states[a], states[b]]
            for b in range(d):
                for c in range(d):
                    if f[b, c] != 0.0:
                        for a in range(b, d):
                            p[a, b] += half[a, c] * f[b, c]
            for a in range(d):
                for b in range(a):
                    p[b, a] = p[a, b]
        for a in range(d):
            mean[k, states[a]] = x[a]
            for b in range(d):
                covariance[k, states[a], states[b]] = p[a, b]
        for i in range(first_row[k], first_row[k + 1]):
            s, v = variance[i], value[i]
            for a in range(d):
                h[a] = design[i, states[a]]
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += p[a, b] * h[b]
                gain[i, a] = total
                s += h[a] * total
                v -= h[a] * x[a]
            innovation[i], scale[i] = v, s
            likelihood -= 0.5 * (np.log(s) + v * v / s)
            for a in range(d):
                x[a] += gain[i, a] * v / s
                for b in range(a + 1):
                    p[a, b] = p[b, a] = p[a, b] - gain[i, a] * gain[i, b] / s
    return likelihood


@compiled
def run_backward(  # noqa: C901, PLR0912
    states: Ints,
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
    n, d = len(mean), len(states)
    r, big = np.zeros(d), np.zeros((d, d))
    work, along, moved, h = np.empty((d, d)), np.empty(d), np.empty(d), np.empty(d)
    p, f = np.empty((d, d)), np.empty((d, d))
    for k in range(n - 1, -1, -1):
        for i in range(first_row[k + 1] - 1, first_row[k] - 1, -1):
            s = scale[i]
            u, square = innovation[i] / s, 1.0 / s
            for a in range(d):
                h[a] = design[i, states[a]]
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += big[a, b] * gain[i, b]
                along[a] = total
                u -= gain[i, a] * r[a] / s
            for a in range(d):
                square += gain[i, a] * along[a] / (s * s)
            residual[i], precision[i] = u, square
            for a in range(d):
                r[a] += h[a] * u
            # L' N L in two steps, with L = 1 - gain design' / s: multiplied out, a vague start would cost all digits.
            for b in range(d):
                moved[b] = 0.0
                for a in range(d):
                    work[a, b] = big[a, b] - along[a] * h[b] / s
                    moved[b] += gain[i, a] * work[a, b]
            for a in range(d):
                for b in range(a + 1):
                    total = work[a, b] + h[a] * (h[b] - moved[b]) / s
                    big[a, b] = big[b, a] = total
        for a in range(d):
            pull[k, states[a]] = r[a]
            for b in range(d):
                pull_precision[k, states[a], states[b]] = big[a, b]
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
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    work[a, b] = 0.0
                    f[a, b] = transition[k, states[a], states[b]]
            for c in range(d):
                for a in range(d):
                    if f[c, a] != 0.0:
                        moved[a] += f[c, a] * r[c]
                        for b in range(d):
                            work[a, b] += f[c, a] * big[c, b]
            for a in range(d):
                r[a] = moved[a]
                for b in range(d):
                    big[a, b] = 0.0
            for c in range(d):
                for b in range(d):
                    if f[c, b] != 0.0:
                        for a in range(b, d):
                            big[a, b] += work[a, c] * f[c, b]
            for a in range(d):
                for b in range(a):
                    big[b, a] = big[a, b]
