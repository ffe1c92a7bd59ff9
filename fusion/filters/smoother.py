"""A linear Gaussian filter and smoother over steps with scalar measurements, in plain arrays.

The smoother is the disturbance form of the fixed-interval smoother (Bryson & Frazier 1969; Durbin & Koopman 2012,
4.4-4.5 and 6.4): it inverts nothing, so states that are constant or that nobody measures do no harm, and it yields the
leave-one-out residual of every measurement on the way.

Long models are gone through in pieces, with the same result: forwards only what is known where each begins is kept, and
on the way back each is gone through once more (checkpoints). So what the loops note of every step takes room for one
piece, and covariances are shown piece by piece (``Look``).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fusion.filters.recursions import Lanes, run_backward, run_forward
from fusion.types import Bools, Floats, Ints

LANES = 4
"""States are packed into a multiple of so many lanes: the loops are compiled for each number of lanes that occurs."""

PIECE_STEPS = 1 << 16
"""Steps of a piece: nine hours at two epochs a second. Shorter models are one piece, and gone through once each way."""

Look = Callable[[slice, Floats], None]
"""Is shown the steps of each piece, from the last to the first, and their covariances (k, d, d)."""

_NOWHERE, _NOTHING = np.empty((0, 0)), np.empty((0, 0, 0))

Entries = Mapping[tuple[int, int], Floats]
"""Entries (n,) of a matrix (d, d) of each step, by row and column; the others are 0. Of a symmetric matrix those of the
lower triangle."""


def go_on() -> None:
    """Nothing is to be seen to between two pieces."""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """n steps of d states and m scalar measurements, ordered by step.

    ``transition`` and ``noise`` lead from step k - 1 to k (the first of each is not used); ``mean`` (d,) and
    ``covariance`` (d, d) hold before the first measurement. Measurement i at ``step[i]`` is
    ``value[i] = design[i] @ x + error`` with variance ``variance[i]``. ``between`` is called before each piece of a
    long model is gone through, and may raise.
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
    between: Callable[[], None] = go_on

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

    def smooth(self, look: Look = lambda *_: None, *, states: Collection[int] | None = None) -> Smoothed:
        """Means and variances of every state given all measurements; ``look`` is shown their covariances.

        With ``states`` only of those among them that a measurement sees: the others are 0, and take no memory.
        """
        d = len(self.mean)
        mean, variance = (np.zeros((self.steps, d), order="F") for _ in range(2))
        others = _Unseen.of(self, ~self._seen if states is None else np.zeros(d, np.bool_))
        told = [k for k in range(d) if states is None or (self._seen[k] and k in states)]

        def keep(piece: slice, means: Floats, covariance: Floats) -> None:
            others.predict(piece, means, covariance)
            for state in told:
                mean[piece, state], variance[piece, state] = means[:, state], covariance[:, state, state]
            look(piece, covariance)

        scores = self._packed.run(self.between, keep=keep)
        return Smoothed(**vars(scores), mean=mean, variance=variance)

    def scores(self, followed: int = -1) -> Scores:
        """What ``smooth`` says of the model itself, in a third of its time; see ``Scores.carry_score``."""
        return self._packed.run(self.between, followed=followed)

    def _piece(self, piece: slice) -> LinearModel:
        """Some steps of it, without their measurements."""
        none, d = np.empty(0), len(self.mean)
        moves, shakes = (
            {pair: entry[piece] for pair, entry in every.items()} for every in (self.transition, self.noise)
        )
        steps = piece.stop - piece.start
        start = self.mean, self.covariance
        return LinearModel(steps, moves, shakes, *start, np.empty(0, np.int64), np.empty((0, d)), none, none)


def _pieces(steps: int) -> list[slice]:
    """The steps, piece by piece."""
    return [slice(a, min(a + PIECE_STEPS, steps)) for a in range(0, max(steps, 1), PIECE_STEPS)]


@dataclass(frozen=True, eq=False)
class _Packed:
    """Some of a model's states, none of which hangs together with the others, as the loops take them.

    ``carried`` and ``shaken``: which of the lanes' columns holds each entry of transitions and of the steps' noise.
    """

    carried: dict[tuple[int, int], int]
    shaken: dict[tuple[int, int], int]
    lanes: Lanes
    size: int
    """How many states the model has"""

    @classmethod
    def of(cls, model: LinearModel, wanted: Bools, rows: int) -> _Packed:
        """The states (d,) that are ``wanted``, with the first ``rows`` measurements."""
        states = np.flatnonzero(wanted)
        d, width = len(states), LANES * -(-max(len(states), 1) // LANES)
        mean, covariance, design = np.zeros(width), np.zeros((width, width)), np.zeros((rows, width))
        mean[:d], covariance[:d, :d] = model.mean[states], model.covariance[np.ix_(states, states)]
        design[:, :d] = model.design[:rows][:, wanted]
        carries, to, of, carried = _columns(model.transition, wanted, model.steps)
        shakes, row, column, shaken = _columns(model.noise, wanted, model.steps)
        first_row = np.searchsorted(model.step[:rows], np.arange(model.steps + 1)).astype(np.int64)
        lanes = Lanes(
            states, (0,) * width, to, of, carried, row, column, shaken, mean, covariance, first_row, design,
            model.value[:rows], model.variance[:rows],
        )  # fmt: skip
        return cls(carries, shakes, lanes, len(wanted))

    def at_levels(self, noise: Entries, transition: Entries, variance: Floats) -> _Packed:
        """See ``LinearModel.at_levels``."""
        carried = _with_columns(self.lanes.carried, self.carried, transition)
        shaken = _with_columns(self.lanes.shaken, self.shaken, noise)
        return replace(self, lanes=self.lanes._replace(carried=carried, shaken=shaken, variance=variance))

    def run(
        self,
        between: Callable[[], None],
        followed: int = -1,
        keep: Callable[[slice, Floats, Floats], None] | None = None,
    ) -> Scores:
        """Goes through these states; ``keep`` is shown the means (k, d) and covariances of each piece."""
        lanes, states = self.lanes, self.lanes.states
        n, w, m = len(lanes.carried), len(lanes.width), len(lanes.value)
        steps, size = n * (followed in states), self.size if keep else 0
        lane = int(np.searchsorted(states, followed))
        residual, precision, pull = np.empty(m), np.empty(m), np.empty((n, w))
        pull_precision, carry_pull = np.empty((n, len(lanes.row))), np.empty((steps, w))
        pieces, likelihood = _pieces(n), 0.0
        x, p, r, big = lanes.mean.copy(), lanes.covariance.copy(), np.zeros(w), np.zeros((w, w))
        begins = []
        for piece in pieces[:-1]:
            between()
            begins.append((x.copy(), p.copy()))
            likelihood += _forward(_cut(lanes, piece), piece, x, p)
        begins.append((x, p))
        for piece, begin in zip(pieces[::-1], begins[::-1], strict=True):
            between()
            rows = slice(lanes.first_row[piece.start], lanes.first_row[piece.stop])
            k, there, count = piece.stop - piece.start, _cut(lanes, piece), rows.stop - rows.start
            means, covariance = np.zeros((k if keep else 0, size)), np.zeros((k if keep else 0, size, size))
            said = np.empty(count), np.empty(count), np.empty((count, w))
            before = np.empty((k if steps else 0, w + 1))
            last = run_forward(there, piece.start > 0, *begin, lane, means, covariance, *said, before)
            likelihood += last if piece is pieces[-1] else 0.0
            run_backward(
                there, piece.start > 0, r, big, means, covariance, *said, before, residual[rows],
                precision[rows], pull[piece], pull_precision[piece], carry_pull[piece],
            )  # fmt: skip
            if keep:
                keep(piece, means, covariance)
        lane_of = {int(state): k for k, state in enumerate(states)}
        return Scores(
            residual / precision, 1.0 / precision, {state: pull[:, k] for state, k in lane_of.items()},
            {pair: pull_precision[:, k] for pair, k in self.shaken.items()},
            {(state, followed): carry_pull[:, k] for state, k in lane_of.items()} if steps else {},
            float(likelihood),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Unseen:
    """States that no measurement sees: ``begins`` is what is known of them before each piece."""

    model: LinearModel
    wanted: Bools
    begins: dict[int, tuple[Floats, Floats]]

    @classmethod
    def of(cls, model: LinearModel, wanted: Bools) -> _Unseen:
        """These states (d,) of the model, maybe none."""
        begins: dict[int, tuple[Floats, Floats]] = {}
        if wanted.any():
            pieces = _pieces(model.steps)
            lanes = _Packed.of(model._piece(slice(0, 0)), wanted, 0).lanes
            x, p = lanes.mean, lanes.covariance
            for piece in pieces:
                begins[piece.start] = x.copy(), p.copy()
                if piece is not pieces[-1]:
                    _forward(_Packed.of(model._piece(piece), wanted, 0).lanes, piece, x, p)
        return cls(model, wanted, begins)

    def predict(self, piece: slice, mean: Floats, covariance: Floats) -> None:
        """Fills ``mean`` and ``covariance`` of the piece by these states."""
        if self.begins:
            lanes = _Packed.of(self.model._piece(piece), self.wanted, 0).lanes
            _forward(lanes, piece, *self.begins[piece.start], mean, covariance)


def _cut(lanes: Lanes, piece: slice) -> Lanes:
    """Some steps, with their measurements."""
    first = lanes.first_row[piece.start : piece.stop + 1]
    rows = slice(first[0], first[-1])
    return lanes._replace(
        carried=lanes.carried[piece], shaken=lanes.shaken[piece], first_row=first - first[0],
        design=lanes.design[rows], value=lanes.value[rows], variance=lanes.variance[rows],
    )  # fmt: skip


def _forward(
    lanes: Lanes, piece: slice, x: Floats, p: Floats, mean: Floats = _NOWHERE, covariance: Floats = _NOTHING
) -> float:
    """Only forwards through a piece, from ``x`` and ``p`` on, which are changed; the log-likelihood."""
    none, w = np.empty(0), len(lanes.width)
    room = none, none, np.empty((0, w)), np.empty((0, w + 1))
    return float(run_forward(lanes, piece.start > 0, x, p, 0, mean, covariance, *room))


def _with_columns(columns: Floats, known: Mapping[tuple[int, int], int], entries: Entries) -> Floats:
    """The columns with other values of those entries that are among them."""
    pairs = entries.keys() & known.keys()
    changed = columns.copy() if pairs else columns
    for pair in pairs:
        changed[:, known[pair]] = entries[pair]
    return changed


def _columns(
    entries: Entries, wanted: Bools, steps: int
) -> tuple[dict[tuple[int, int], int], Ints, Ints, Floats]:
    """The place of each entry among those of the states that are ``wanted``, their lanes, and values (n, entries)."""
    own = [pair for pair in entries if wanted[pair[0]]]
    row, column = (np.cumsum(wanted) - 1)[np.array(own, np.int64).reshape(-1, 2)].T.copy()
    values = np.empty((steps, len(own)))
    for k, pair in enumerate(own):
        values[:, k] = entries[pair]
    return {pair: k for k, pair in enumerate(own)}, row, column, values


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

    def of_measurements(self) -> Scores:
        """What it says of measurements alone, which takes a third of the memory."""
        return Scores(self.residual, self.residual_variance, {}, {}, {}, self.log_likelihood)

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
    """... and ``mean`` and ``variance`` (n, d) of the states."""

    mean: Floats
    variance: Floats
