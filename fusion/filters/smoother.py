"""A linear Gaussian filter and smoother over steps with scalar measurements, in plain arrays.

The smoother is the disturbance form of the fixed-interval smoother (Bryson & Frazier 1969; Durbin & Koopman 2012,
4.4-4.5 and 6.4): it inverts nothing, so states that are constant or that nobody measures do no harm, and it yields the
leave-one-out residual of every measurement on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats, Ints


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
        return float(self._filtered()[-1])

    def smooth(self) -> Smoothed:
        """Means and covariances of every state given all measurements."""
        mean, covariance, innovation, scale, gain, likelihood = self._filtered()
        residual, precision = np.empty(len(self.step)), np.empty(len(self.step))
        pull, pull_precision = np.empty(mean.shape), np.empty(covariance.shape)
        run_backward(
            self.transition, self.first_row, self.design, mean, covariance, innovation, scale, gain,
            residual, precision, pull, pull_precision,
        )  # fmt: skip
        return Smoothed(
            mean, covariance, residual / precision, 1.0 / precision, pull, pull_precision, float(likelihood)
        )

    def _filtered(self) -> tuple[Floats, Floats, Floats, Floats, Floats, float]:
        n, d = self.transition.shape[:2]
        m = len(self.step)
        mean, covariance = np.empty((n, d)), np.empty((n, d, d))
        innovation, scale, gain = np.empty(m), np.empty(m), np.empty((m, d))
        likelihood = run_forward(
            self.transition, self.noise, self.mean, self.covariance, self.first_row, self.design, self.value,
            self.variance, mean, covariance, innovation, scale, gain,
        )  # fmt: skip
        return mean, covariance, innovation, scale, gain, likelihood


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
    """Fill predicted means and covariances, innovations, their variances and gains; return the log-likelihood."""
    n, d = mean.shape
    x, p = start_mean.copy(), start_covariance.copy()
    moved, half = np.empty(d), np.empty((d, d))
    likelihood = 0.0
    for k in range(n):
        if k:
            f = transition[k]
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    moved[a] += f[a, b] * x[b]
                    half[a, b] = 0.0
                    for c in range(d):
                        half[a, b] += f[a, c] * p[c, b]
            for a in range(d):
                x[a] = moved[a]
                for b in range(a + 1):
                    total = noise[k, a, b]
                    for c in range(d):
                        total += half[a, c] * f[b, c]
                    p[a, b] = p[b, a] = total
        mean[k], covariance[k] = x, p
        for i in range(first_row[k], first_row[k + 1]):
            s, v = variance[i], value[i]
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += p[a, b] * design[i, b]
                gain[i, a] = total
                s += design[i, a] * total
                v -= design[i, a] * x[a]
            innovation[i], scale[i] = v, s
            likelihood -= 0.5 * (np.log(s) + v * v / s)
            for a in range(d):
                x[a] += gain[i, a] * v / s
                for b in range(a + 1):
                    p[a, b] = p[b, a] = p[a, b] - gain[i, a] * gain[i, b] / s
    return likelihood


@compiled
def run_backward(  # noqa: C901, PLR0912
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
    """Turn predicted means and covariances into smoothed ones; fill smoothing errors, their precisions and pulls."""
    n, d = mean.shape
    r, big = np.zeros(d), np.zeros((d, d))
    work, along, moved = np.empty((d, d)), np.empty(d), np.empty(d)
    for k in range(n - 1, -1, -1):
        for i in range(first_row[k + 1] - 1, first_row[k] - 1, -1):
            s = scale[i]
            u, square = innovation[i] / s, 1.0 / s
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
                r[a] += design[i, a] * u
            # L' N L in two steps, with L = 1 - gain design' / s: multiplied out, a vague start would cost all digits.
            for b in range(d):
                moved[b] = 0.0
                for a in range(d):
                    work[a, b] = big[a, b] - along[a] * design[i, b] / s
                    moved[b] += gain[i, a] * work[a, b]
            for a in range(d):
                for b in range(a + 1):
                    total = work[a, b] + design[i, a] * (design[i, b] - moved[b]) / s
                    big[a, b] = big[b, a] = total
        pull[k], pull_precision[k] = r, big
        p = covariance[k].copy()
        for a in range(d):
            for b in range(d):
                total = 0.0
                for c in range(d):
                    total += p[a, c] * big[c, b]
                work[a, b] = total
        for a in range(d):
            for b in range(d):
                mean[k, a] += p[a, b] * r[b]
            for b in range(a + 1):
                total = p[a, b]
                for c in range(d):
                    total -= work[a, c] * p[c, b]
                covariance[k, a, b] = covariance[k, b, a] = total
        if k:
            f = transition[k]
            for a in range(d):
                moved[a] = 0.0
                for b in range(d):
                    moved[a] += f[b, a] * r[b]
                    total = 0.0
                    for c in range(d):
                        total += f[c, a] * big[c, b]
                    work[a, b] = total
            for a in range(d):
                r[a] = moved[a]
                for b in range(a + 1):
                    total = 0.0
                    for c in range(d):
                        total += work[a, c] * f[c, b]
                    big[a, b] = big[b, a] = total
