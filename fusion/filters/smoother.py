"""A linear Gaussian filter and smoother over steps with scalar measurements, in plain arrays.

The smoother is the disturbance form of the fixed-interval smoother (Bryson & Frazier 1969; Durbin & Koopman 2012,
4.4-4.5 and 6.4): it inverts nothing, so states that are constant or that nobody measures do no harm, and it yields the
leave-one-out residual of every measurement on the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fusion.filters.recursions import run_backward, run_forward
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

    @cached_property
    def first_row(self) -> Ints:
        """Where each step's measurements begin, shape (n + 1,)."""
        return np.searchsorted(self.step, np.arange(len(self.transition) + 1)).astype(np.int64)

    @cached_property
    def seen(self) -> Bools:
        """The states (d,) that measurements see, or that hang together with such; the others take their own way."""
        linked = (self.covariance != 0) | self._moves
        linked |= np.any(self.noise[1:] != 0, axis=0)
        linked |= linked.T
        seen = np.any(self.design != 0, axis=0)
        for _ in seen:
            seen = seen | np.any(linked[seen], axis=0)
        return np.asarray(seen, np.bool_)

    @cached_property
    def _moves(self) -> Bools:
        """Which entries of a transition are not 0 in every step, (d, d)."""
        return np.asarray(np.any(self.transition[1:] != 0, axis=0))

    def at_levels(self, noise: Floats, variance: Floats) -> LinearModel:
        """The same model with other ``noise`` and ``variance``; what hangs together is not looked for again."""
        other = replace(self, noise=noise, variance=variance)
        vars(other).update({name: getattr(self, name) for name in ("first_row", "seen", "_moves")})
        return other

    def smooth(self) -> Smoothed:
        """Means and covariances of every state given all measurements."""
        n, d = self.transition.shape[:2]
        mean, covariance = np.empty((n, d)), np.zeros((n, d, d))
        scores = self._scores(mean, covariance)
        self._forward(~self.seen, np.zeros(n + 1, np.int64), mean, covariance)
        return Smoothed(**vars(scores), mean=mean, covariance=covariance)

    def scores(self) -> Scores:
        """What ``smooth`` says of the model itself, in half its time."""
        return self._scores(np.empty((0, 0)), np.empty((0, 0, 0)))

    def log_likelihood(self) -> float:
        """That of the measurements, in half the time of ``scores``."""
        return self._forward(self.seen, self.first_row, np.empty((0, 0)), np.empty((0, 0, 0)))[-1]

    def _scores(self, mean: Floats, covariance: Floats) -> Scores:
        """Fills ``mean`` and ``covariance``, where they have room, by the states that are seen."""
        n, d = self.transition.shape[:2]
        moves, innovation, scale, gain, likelihood = self._forward(
            self.seen, self.first_row, mean, covariance
        )
        residual, precision = np.empty(len(self.step)), np.empty(len(self.step))
        pull, pull_precision = np.zeros((n, d)), np.zeros((n, d, d))
        run_backward(
            np.flatnonzero(self.seen), moves, self.transition, self.first_row, self.design, mean, covariance,
            innovation, scale, gain, residual, precision, pull, pull_precision,
        )  # fmt: skip
        return Scores(residual / precision, 1.0 / precision, pull, pull_precision, likelihood)

    def _forward(
        self, wanted: Bools, first_row: Ints, mean: Floats, covariance: Floats
    ) -> tuple[Ints, Floats, Floats, Floats, float]:
        """The filter over some of the states, none of which hangs together with the others."""
        states, m = np.flatnonzero(wanted), len(self.step)
        moves = np.argwhere(self._moves[np.ix_(states, states)])
        innovation, scale, gain = np.empty(m), np.empty(m), np.empty((m, len(states)))
        likelihood = run_forward(
            states, moves, self.transition, self.noise, self.mean, self.covariance, first_row, self.design, self.value,
            self.variance, mean, covariance, innovation, scale, gain,
        )  # fmt: skip
        return moves, innovation, scale, gain, float(likelihood)


StepNoise = Mapping[tuple[int, int], Floats]
"""Entries (n,) of a symmetric matrix (d, d) of each step, by row and column of its lower triangle; the others are 0."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Of each measurement the ``residual`` (m,) that it has against an estimate made without it, with the
    ``residual_variance`` it should have. ``pull`` (n, d) is the gradient of the log-likelihood by the states' change on
    the way to a step, ``pull_precision`` (n, d, d) its covariance.
    """

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

    def noise_score(self, derivative: StepNoise) -> float:
        """The derivative of the log-likelihood by a parameter, by which the steps' noise has ``derivative``.

        The score of Koopman and Shephard (1992): half the trace of (r r' - N) dQ, without the first step.
        """
        total = 0.0
        for (a, b), entry in derivative.items():
            square = self.pull[1:, a] * self.pull[1:, b] - self.pull_precision[1:, a, b]
            total += (0.5 if a == b else 1.0) * float(square @ entry[1:])
        return total


@dataclass(frozen=True, eq=False)
class Smoothed(Scores):
    """... and ``mean`` (n, d) and ``covariance`` (n, d, d) of the states."""

    mean: Floats
    covariance: Floats
