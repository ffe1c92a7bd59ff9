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

from fusion.filters.recursions import Lanes, run_backward, run_forward
from fusion.types import Bools, Floats, Ints

LANES = 4
"""States are packed into a multiple of so many lanes: the loops are compiled for each number of lanes that occurs."""

Entries = Mapping[tuple[int, int], Floats]
"""Entries (n,) of a matrix (d, d) of each step, by row and column; the others are 0. Of a symmetric matrix those of the
lower triangle."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """n steps of d states and m scalar measurements, ordered by step.

    ``transition`` and ``noise`` lead from step k - 1 to k (the first of each is not used); ``mean`` (d,) and
    ``covariance`` (d, d) hold before the first measurement. Measurement i at ``step[i]`` is
    ``value[i] = design[i] @ x + error`` with variance ``variance[i]``.
    """

    steps: int
    transition: Entries
    noise: Entries
    mean: Floats
    covariance: Floats
    step: Ints
    design: Floats
    value: Floats
    variance: Floats

    @cached_property
    def _seen(self) -> Bools:
        """The states (d,) that measurements see, or that hang together with such; the others take their own way."""
        linked = self.covariance != 0
        for pair in (*self.transition, *self.noise):
            linked[pair] = True
        linked |= linked.T
        seen = np.any(self.design != 0, axis=0)
        for _ in seen:
            seen = seen | np.any(linked[seen], axis=0)
        return np.asarray(seen, np.bool_)

    @cached_property
    def _packed(self) -> _Packed:
        """The states that are seen, with all measurements."""
        return _Packed.of(self, self._seen, len(self.step))

    def at_levels(self, noise: Entries, transition: Entries, variance: Floats) -> LinearModel:
        """The same with other ``variance``, and with other values of entries that it has."""
        every, moves = {**self.noise, **noise}, {**self.transition, **transition}
        other = replace(self, noise=every, transition=moves, variance=variance)
        packed = self._packed.at_levels(noise, transition, variance)
        vars(other).update(_seen=self._seen, _packed=packed)
        return other

    def smooth(self) -> Smoothed:
        """Means and covariances of every state given all measurements."""
        d = len(self.mean)
        mean, covariance = np.empty((self.steps, d)), np.zeros((self.steps, d, d))
        scores = self._packed.run(mean, covariance)
        if not self._seen.all():
            _Packed.of(self, ~self._seen, 0).predict(mean, covariance)
        return Smoothed(**vars(scores), mean=mean, covariance=covariance)

    def scores(self, followed: int = -1) -> Scores:
        """What ``smooth`` says of the model itself, in a third of its time; see ``Scores.carry_score``."""
        return self._packed.run(np.empty((0, 0)), np.empty((0, 0, 0)), followed)


@dataclass(frozen=True, eq=False)
class _Packed:
    """Some of a model's states, none of which hangs together with the others, as the loops take them.

    ``carried`` and ``shaken``: which of the lanes' columns holds each entry of transitions and of the steps' noise.
    """

    carried: dict[tuple[int, int], int]
    shaken: dict[tuple[int, int], int]
    lanes: Lanes

    @classmethod
    def of(cls, model: LinearModel, wanted: Bools, rows: int) -> _Packed:
        """The states (d,) that are ``wanted``, with the first ``rows`` measurements."""
        states = np.flatnonzero(wanted)
        d, width = len(states), LANES * -(-max(len(states), 1) // LANES)
        mean, covariance, design = np.zeros(width), np.zeros((width, width)), np.zeros((rows, width))
        mean[:d], covariance[:d, :d] = model.mean[states], model.covariance[np.ix_(states, states)]
        design[:, :d] = model.design[:rows, states]
        carries, to, of, carried = _columns(model.transition, wanted, model.steps)
        shakes, row, column, shaken = _columns(model.noise, wanted, model.steps)
        first_row = np.searchsorted(model.step[:rows], np.arange(model.steps + 1)).astype(np.int64)
        lanes = Lanes(
            states, (0,) * width, to, of, carried, row, column, shaken, mean, covariance, first_row, design,
            model.value[:rows], model.variance[:rows],
        )  # fmt: skip
        return cls(carries, shakes, lanes)

    def at_levels(self, noise: Entries, transition: Entries, variance: Floats) -> _Packed:
        """See ``LinearModel.at_levels``."""
        carried, shaken = self.lanes.carried.copy(), self.lanes.shaken.copy()
        for known, columns, entries in ((self.carried, carried, transition), (self.shaken, shaken, noise)):
            for pair in entries.keys() & known.keys():
                columns[:, known[pair]] = entries[pair]
        return replace(self, lanes=self.lanes._replace(carried=carried, shaken=shaken, variance=variance))

    def predict(self, mean: Floats, covariance: Floats) -> None:
        """Fills ``mean`` and ``covariance`` by these states without measurements."""
        none, width = np.empty(0), len(self.lanes.width)
        run_forward(
            self.lanes, 0, mean, covariance, none, none, np.empty((0, width)), np.empty((0, width + 1))
        )

    def run(self, mean: Floats, covariance: Floats, followed: int = -1) -> Scores:
        """Fills ``mean`` and ``covariance``, where they have room, by these states."""
        lanes, states = self.lanes, self.lanes.states
        n, w, m = len(lanes.carried), len(lanes.width), len(lanes.value)
        steps = n * (followed in states)
        innovation, scale, gain, before = np.empty(m), np.empty(m), np.empty((m, w)), np.empty((steps, w + 1))
        lane = int(np.searchsorted(states, followed))
        likelihood = run_forward(lanes, lane, mean, covariance, innovation, scale, gain, before)
        residual, precision, pull = np.empty(m), np.empty(m), np.empty((n, w))
        pull_precision, carry_pull = np.empty((n, len(lanes.row))), np.empty((steps, w))
        run_backward(
            lanes, mean, covariance, innovation, scale, gain, before, residual, precision, pull,
            pull_precision, carry_pull,
        )  # fmt: skip
        lane_of = {int(state): k for k, state in enumerate(states)}
        return Scores(
            residual / precision, 1.0 / precision, {state: pull[:, k] for state, k in lane_of.items()},
            {pair: pull_precision[:, k] for pair, k in self.shaken.items()},
            {(state, followed): carry_pull[:, k] for state, k in lane_of.items()} if steps else {},
            float(likelihood),
        )  # fmt: skip


def _columns(
    entries: Entries, wanted: Bools, steps: int
) -> tuple[dict[tuple[int, int], int], Ints, Ints, Floats]:
    """The place of each entry among those of the states that are ``wanted``, their lanes, and values (n, entries)."""
    own = [pair for pair in entries if wanted[pair[0]]]
    row, column = (np.cumsum(wanted) - 1)[np.array(own, np.int64).reshape(-1, 2)].T.copy()
    values = np.array([entries[pair] for pair in own]).reshape(-1, steps)
    return {pair: k for k, pair in enumerate(own)}, row, column, values.T.copy()


@dataclass(frozen=True, eq=False)
class Scores:
    """Of each measurement the ``residual`` (m,) that it has against an estimate made without it, with the
    ``residual_variance`` it should have. ``pull`` (n,) of each state that is seen is the gradient of the log-likelihood
    by the state's change on the way to a step, ``pull_precision`` their covariance where the steps have noise.
    ``carry_pull`` is the gradient by the transitions' column that was followed.
    """

    residual: Floats
    residual_variance: Floats
    pull: Mapping[int, Floats]
    pull_precision: Entries
    carry_pull: Entries
    log_likelihood: float

    def break_score(self, state: int) -> Floats:
        """How many sigmas speak for a sudden change of a state that the steps' noise changes anyway, on the way to a
        step, (n,) (de Jong & Penzer 1998)."""
        if state not in self.pull:
            return np.zeros(1)
        scale = np.sqrt(self.pull_precision[state, state])
        return np.divide(self.pull[state], scale, out=np.zeros(len(scale)), where=scale > 0)

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
            if a in self.pull:
                square = self.pull[a][1:] * self.pull[b][1:] - self.pull_precision[a, b][1:]
                total += (0.5 if a == b else 1.0) * float(square @ entry[1:])
        return total

    def carry_score(self, derivative: Entries) -> float:
        """... by a parameter, by which the transitions have ``derivative`` in the column that was followed.

        The trace of (r x' - N T P) dT', with the smoothed state x and the covariance P of the filter a step before.
        """
        return float(sum(self.carry_pull[pair][1:] @ entry[1:] for pair, entry in derivative.items()))


@dataclass(frozen=True, eq=False)
class Smoothed(Scores):
    """... and ``mean`` (n, d) and ``covariance`` (n, d, d) of the states."""

    mean: Floats
    covariance: Floats
