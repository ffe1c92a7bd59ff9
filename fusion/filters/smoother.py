"""A linear Gaussian filter and smoother over steps with scalar measurements, in plain arrays.

The smoother is the disturbance form of the fixed-interval smoother (Bryson & Frazier 1969; Durbin & Koopman 2012,
4.4-4.5 and 6.4): it inverts nothing, so states that are constant or that nobody measures do no harm, and it yields the
leave-one-out residual of every measurement on the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fusion.filters.recursions import Lanes, run_backward, run_forward
from fusion.types import Bools, Floats, Ints

LANES = 4
"""States are packed into a multiple of so many lanes: the loops are compiled for each number of lanes that occurs."""
_NO_MEANS, _NO_COVARIANCES = np.empty((0, 0)), np.empty((0, 0, 0))

Entries = Mapping[tuple[int, int], Floats]
"""Entries (n,) of a matrix (d, d) of each step, by row and column; the others are 0. Of a symmetric matrix those of the
lower triangle."""


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
    def _moves(self) -> Bools:
        """Which entries of a transition are not 0 in every step, (d, d)."""
        return np.asarray(np.any(self.transition[1:] != 0, axis=0))

    @cached_property
    def _shaken(self) -> Bools:
        """Which entries of the steps' noise are not 0 in every step, (d, d); of every state its own."""
        return np.asarray(np.any(self.noise[1:] != 0, axis=0) | np.eye(len(self.mean), dtype=bool))

    def _seen(self) -> Bools:
        """The states (d,) that measurements see, or that hang together with such; the others take their own way."""
        linked = (self.covariance != 0) | self._moves | self._shaken
        linked |= linked.T
        seen = np.any(self.design != 0, axis=0)
        for _ in seen:
            seen = seen | np.any(linked[seen], axis=0)
        return np.asarray(seen, np.bool_)

    @cached_property
    def core(self) -> Core:
        """The states that are seen, with all measurements."""
        return self._part(self._seen(), len(self.step))

    def smooth(self) -> Smoothed:
        """Means and covariances of every state given all measurements."""
        n, d = self.transition.shape[:2]
        mean, covariance = np.empty((n, d)), np.zeros((n, d, d))
        blind = np.ones(d, bool)
        blind[self.core.states] = False
        scores = self.core.run(mean, covariance)
        if blind.any():
            self._part(blind, 0).run(mean, covariance)
        return Smoothed(**vars(scores), mean=mean, covariance=covariance)

    def _part(self, wanted: Bools, rows: int) -> Core:
        """Some of the states, none of which hangs together with the others, and the first ``rows`` measurements."""
        states = np.flatnonzero(wanted)
        square = np.ix_(states, states)
        to, of = np.argwhere(self._moves[square]).T.copy()
        row, column = np.argwhere(np.tril(self._shaken[square])).T.copy()
        d, width = len(states), LANES * -(-max(len(states), 1) // LANES)
        mean, covariance, design = np.zeros(width), np.zeros((width, width)), np.zeros((rows, width))
        mean[:d], covariance[:d, :d] = self.mean[states], self.covariance[square]
        design[:, :d] = self.design[:rows, states]
        first_row = np.searchsorted(self.step[:rows], np.arange(len(self.transition) + 1)).astype(np.int64)
        carried = np.ascontiguousarray(self.transition[:, states[to], states[of]])
        shaken = np.ascontiguousarray(self.noise[:, states[row], states[column]])
        lanes = Lanes(
            (0,) * width, to, of, carried, row, column, shaken, mean, covariance, first_row, design,
            self.value[:rows], self.variance[:rows],
        )  # fmt: skip
        return Core(states, len(wanted), lanes)


@dataclass(frozen=True, eq=False)
class Core:
    """Some of the ``count`` states of a model, numbered ``states`` (d,), packed for the loops."""

    states: Ints
    count: int
    lanes: Lanes

    def at_levels(self, noise: Entries, transition: Entries, variance: Floats) -> Core:
        """The same with other ``variance`` (m,), and with other entries of the steps' noise and of the transitions.

        Only where such entries are not 0 in every step already.
        """
        shaken, carried = self.lanes.shaken.copy(), self.lanes.carried.copy()
        for known, columns, entries in (
            (self._names(self.lanes.row, self.lanes.column), shaken, noise),
            (self._names(self.lanes.to, self.lanes.of), carried, transition),
        ):
            for name in entries.keys() & known.keys():
                columns[:, known[name]] = entries[name]
        return Core(
            self.states, self.count, self.lanes._replace(shaken=shaken, carried=carried, variance=variance)
        )

    def _names(self, rows: Ints, columns: Ints) -> dict[tuple[int, int], int]:
        """The place of each entry, by its row and column."""
        pairs = zip(self.states[rows].tolist(), self.states[columns].tolist(), strict=True)
        return {name: k for k, name in enumerate(pairs)}

    def scores(self, followed: int = -1) -> Scores:
        """What ``smooth`` says of the model itself, in a fraction of its time; see ``Scores.carry_score``."""
        return self.run(_NO_MEANS, _NO_COVARIANCES, followed)

    def run(self, mean: Floats, covariance: Floats, followed: int = -1) -> Scores:
        """Fills ``mean`` and ``covariance``, where they have room, by these states."""
        lanes, d = self.lanes, len(self.states)
        n, w, m = len(lanes.carried), len(lanes.width), len(lanes.value)
        kept = n if len(mean) else 0
        own_mean, own_covariance = np.empty((kept, w)), np.empty((kept, w, w))
        lane = int(np.searchsorted(self.states, followed))
        steps = n if followed in self.states else 0
        innovation, scale, gain, before = np.empty(m), np.empty(m), np.empty((m, w)), np.empty((steps, w + 1))
        likelihood = run_forward(lanes, lane, own_mean, own_covariance, innovation, scale, gain, before)
        residual, precision, pull = np.empty(m), np.empty(m), np.empty((n, w))
        pull_precision, carry_pull = np.empty((n, len(lanes.row))), np.zeros((steps, w))
        run_backward(
            lanes, own_mean, own_covariance, innovation, scale, gain, before, residual, precision, pull,
            pull_precision, carry_pull,
        )  # fmt: skip
        if kept:
            mean[:, self.states] = own_mean[:, :d]
            covariance[:, self.states[:, None], self.states] = own_covariance[:, :d, :d]
        names = self._names(lanes.row, lanes.column)
        return Scores(
            residual / precision, 1.0 / precision, self._spread(pull),
            {name: pull_precision[:, k] for name, k in names.items()}, self._spread(carry_pull), float(likelihood),
        )  # fmt: skip

    def _spread(self, lanes: Floats) -> Floats:
        """Columns of all states, with zeros for those that are not here."""
        out = np.zeros((len(lanes), self.count))
        out[:, self.states] = lanes[:, : len(self.states)]
        return out


@dataclass(frozen=True, eq=False)
class Scores:
    """Of each measurement the ``residual`` (m,) that it has against an estimate made without it, with the
    ``residual_variance`` it should have. ``pull`` (n, d) is the gradient of the log-likelihood by the states' change on
    the way to a step, ``pull_precision`` its covariance: on the diagonal, and where the steps have noise.
    ``carry_pull`` (n, d) is the gradient by the transitions' column that was followed.
    """

    residual: Floats
    residual_variance: Floats
    pull: Floats
    pull_precision: Entries
    carry_pull: Floats
    log_likelihood: float

    def break_score(self, state: int) -> Floats:
        """How many sigmas speak for a sudden change of a state on the way to a step, (n,) (de Jong & Penzer 1998)."""
        scale = np.sqrt(self.pull_precision.get((state, state), np.zeros(len(self.pull))))
        return np.divide(self.pull[:, state], scale, out=np.zeros(len(scale)), where=scale > 0)

    def level_score(self, variance: Floats) -> Floats:
        """Of each measurement the derivative of the log-likelihood by the log of its ``variance``, (m,)."""
        return np.asarray(
            0.5 * variance * (np.square(self.residual / self.residual_variance) - 1 / self.residual_variance)
        )

    def noise_score(self, derivative: Entries) -> float:
        """The derivative of the log-likelihood by a parameter, by which the steps' noise has ``derivative``.

        The score of Koopman and Shephard (1992): half the trace of (r r' - N) dQ, without the first step.
        """
        total = 0.0
        for (a, b), entry in derivative.items():
            if (a, b) in self.pull_precision:
                square = self.pull[1:, a] * self.pull[1:, b] - self.pull_precision[a, b][1:]
                total += (0.5 if a == b else 1.0) * float(square @ entry[1:])
        return total

    def carry_score(self, derivative: Mapping[int, Floats]) -> float:
        """... by a parameter, by which rows of the transitions' column that was followed have ``derivative``.

        The trace of (r x' - N T P) dT', with the smoothed state x and the covariance P of the filter a step before.
        """
        return float(sum(self.carry_pull[1:, a] @ entry[1:] for a, entry in derivative.items()))


@dataclass(frozen=True, eq=False)
class Smoothed(Scores):
    """... and ``mean`` (n, d) and ``covariance`` (n, d, d) of the states."""

    mean: Floats
    covariance: Floats
