"""Condensed passes: what many drives say of one segment in the room of one pass, however many they are.

A pass speaks of the road and of its drive's own errors. With these integrated out, pass by pass, what is left speaks of
the knots of the segment alone, and such pieces are added up, and taken off again when a drive goes. A drive's constants
are taken from what its other passes say of them (``ConstantsInformation``), never from a solution; errors of heights
are free. So a sum says less than its passes would say together: heights are not carried from one segment to the next.

What is left of a constant's error is common to all passes of a drive, but sums take it for independent from segment to
segment; hence ``SHARE_ELSEWHERE``.

In the solution of a part of a network, the constants of a drive stay unknowns. Its passes outside speak of them too:
each of them alone, over a road of which nothing is known but that grades are small, never the drive's own posterior.
What other drives know of the roads outside is left unsaid, so this is never too much. It is what the whole drive says
less what it says inside.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from fusion.network.drive_beliefs import LAG_MEAN_S, LAG_SIGMA_S
from fusion.network.equations import Blocks
from fusion.network.pass_factor import (
    CONSTANT_SIGMA,
    CONSTANTS,
    LAG,
    NUISANCES,
    SETTINGS,
    PassFactor,
    symmetric,
)
from fusion.network.road_beliefs import GRADE_SIGMA
from fusion.network.unknowns import DriveUnknowns
from fusion.types import Floats, Ints

FREE_INFORMATION = 1e-6
"""Heights, and errors of height sensors, are free: a sigma of a kilometre (1/m^2)."""
ROUNDING = 1e-9
"""Of sums from which all is taken off again, less than this share is left."""


@dataclass(frozen=True, eq=False)
class ConstantsInformation:
    """Information (n, n) and vector (n,) over constants of a drive: ``keys`` (n, 2), ascending, are (kind, setting).

    ``kind`` is the number in ``CONSTANTS``; the setting is 0 for constants that have none (``SETTINGS``).
    """

    keys: Ints
    information: Floats
    vector: Floats

    @classmethod
    def nothing(cls) -> Self:
        """Of no pass."""
        return cls(np.empty((0, 2), np.int64), np.zeros((0, 0)), np.zeros(0))

    @classmethod
    def of_passes(cls, passes: Sequence[PassFactor], weight: Floats | None = None) -> Self:
        """What passes of one drive say, each on its own; ``weight`` (m,) is how much each is believed."""
        if not passes:
            return cls.nothing()
        weight = np.ones(len(passes)) if weight is None else weight
        setting = np.zeros((len(passes), len(CONSTANTS)), np.int64)
        for kind, name in SETTINGS.items():
            setting[:, kind] = [getattr(p, name) for p in passes]
        every = np.stack([np.broadcast_to(np.arange(len(CONSTANTS)), setting.shape), setting], axis=2)
        keys, number = np.unique(every.reshape(-1, 2), axis=0, return_inverse=True)
        number = number.reshape(setting.shape)
        information, vector = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
        size = np.array([len(p.vector) for p in passes])
        for n in np.unique(size):
            mine = np.flatnonzero(size == n)
            said, right = _marginals([passes[k] for k in mine.tolist()], weight[mine])
            at = number[mine]
            np.add.at(information, (at[:, :, None], at[:, None, :]), said)
            np.add.at(vector, at, right)
        informed = np.diagonal(information) > 0
        order = np.flatnonzero(informed)
        return cls(keys[order], information[np.ix_(order, order)], vector[order])

    def __add__(self, other: ConstantsInformation) -> ConstantsInformation:
        return self._with(other, 1.0)

    def __sub__(self, other: ConstantsInformation) -> ConstantsInformation:
        left = self._with(other, -1.0)
        # Of what only the other spoke, rounding is left; it would tie together what has nothing to do with each other.
        combined = self._with(other, 0.0).information
        informed = np.flatnonzero(np.diagonal(left.information) > ROUNDING * np.diagonal(combined))
        return ConstantsInformation(
            left.keys[informed], left.information[np.ix_(informed, informed)], left.vector[informed]
        )

    def widened(self, widening: float) -> ConstantsInformation:
        """The same of passes whose sigmas are ``widening`` times as large (``PassFactor.widened``)."""
        less = widening**-2.0
        return (
            self
            if widening == 1.0
            else ConstantsInformation(self.keys, less * self.information, less * self.vector)
        )

    def _with(self, other: ConstantsInformation, sign: float) -> ConstantsInformation:
        keys, where = np.unique(np.concatenate([self.keys, other.keys]), axis=0, return_inverse=True)
        where = where.ravel()
        information, vector = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
        for at, one, share in ((where[: len(self.keys)], self, 1.0), (where[len(self.keys) :], other, sign)):
            information[np.ix_(at, at)] += share * one.information
            vector[at] += share * one.vector
        return ConstantsInformation(keys, information, vector)

    def onto(self, keys: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
        """Information and vector over these constants; the others are integrated out, with what is believed of each."""
        at = {(int(kind), int(mount)): k for k, (kind, mount) in enumerate(self.keys)}
        known = np.array([key in at for key in keys], bool)
        shared = np.array([at[key] for key in keys if key in at], np.int64)
        gone = np.setdiff1d(np.arange(len(self.keys)), shared)
        prior = np.array(CONSTANT_SIGMA)[self.keys[gone, 0]] ** -2.0
        across = self.information[np.ix_(gone, shared)]
        solved = np.linalg.solve(
            self.information[np.ix_(gone, gone)] + np.diag(prior),
            np.column_stack([across, self.vector[gone]]),
        )
        information, vector = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
        information[np.ix_(known, known)] = (
            self.information[np.ix_(shared, shared)] - across.T @ solved[:, :-1]
        )
        vector[known] = self.vector[shared] - across.T @ solved[:, -1]
        return information, vector

    def encode(self) -> bytes:
        """As little-endian doubles: how many, keys, vector, upper triangle."""
        upper = self.information[np.triu_indices(len(self.keys))]
        numbers = [np.array([len(self.keys)]), self.keys.ravel(), self.vector, upper]
        return np.concatenate(numbers).astype("<f8").tobytes()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The inverse of ``encode``, bit for bit."""
        values = np.frombuffer(data, "<f8").astype(np.float64)
        n = int(values[0])
        keys, vector, upper = np.split(values[1:], [2 * n, 3 * n])
        return cls(keys.astype(np.int64).reshape(n, 2), symmetric(upper, n), vector.copy())


def _marginals(passes: Sequence[PassFactor], weight: Floats) -> tuple[Floats, Floats]:
    """Information (m, k, k) and vector (m, k) of each pass over the k ``CONSTANTS``; all over equally many knots."""
    weighted = weight[:, None, None] * np.array([p.information for p in passes])
    right = weight[:, None] * np.array([p.vector for p in passes])
    n = weighted.shape[1]
    knots, count = n - NUISANCES, len(CONSTANTS)
    nuisances = np.arange(knots, knots + count)
    gone = np.concatenate([np.arange(knots), np.arange(knots + count, n)])
    prior = np.full(len(gone), FREE_INFORMATION)
    prior[1:knots:2] = GRADE_SIGMA**-2
    inside = weighted[:, gone[:, None], gone] + np.diag(prior)
    across = weighted[:, gone[:, None], nuisances]
    solved = np.linalg.solve(inside, np.concatenate([across, right[:, gone, None]], axis=2))
    back = across.transpose(0, 2, 1) @ solved
    information = weighted[:, nuisances[:, None], nuisances] - back[:, :, :-1]
    return 0.5 * (information + information.transpose(0, 2, 1)), right[:, nuisances] - back[:, :, -1]


def outside_blocks(
    said: Mapping[int, ConstantsInformation], unknowns: Mapping[int, DriveUnknowns]
) -> list[Blocks]:
    """The equations of all drives that have passes elsewhere."""
    out = []
    for name in sorted(set(said) & set(unknowns)):
        spoken = set(map(tuple, said[name].keys.tolist()))
        keys = [key for key in unknowns[name].keys if key in spoken]
        information, vector = said[name].onto(keys)
        variables = np.array([[unknowns[name].keys[key] for key in keys]], np.int64)
        out.append(Blocks(variables, information[None], vector[None], np.ones(1)))
    return [b for b in out if b.variables.size]


PARTS = 16
"""Equal parts of a segment for each of which a sum counts the passes that were there: passes can be taken off again,
and a road is a few hundred metres at most between two nodes."""
SHARE_ELSEWHERE = 0.5
"""Of what a drive says of its constants elsewhere, so much is believed in a sum. With 48 of 60 drives over 40 segments
in sums, sigmas are 0.95 to 1.00 of those of all drives with 1, 1.00 to 1.05 with 0.5, up to 1.7 with 0."""
USUAL_PASSES = 40
"""Of drives with fewer passes less is believed, in proportion: the fewer passes a constant is known from, the larger is
its error beside theirs (0.76 of the sigma with 1 and drives of four passes, 1.05 so)."""

_HEAD = 6
_PRIOR = np.append(np.array(CONSTANT_SIGMA) ** -2.0, np.full(NUISANCES - len(CONSTANTS), FREE_INFORMATION))
_PRIOR[LAG] = 1 / (LAG_MEAN_S[1] ** 2 + LAG_SIGMA_S**2)
_MEAN = np.zeros(NUISANCES)
_MEAN[LAG] = LAG_MEAN_S[0]


@dataclass(frozen=True, eq=False)
class CondensedPasses:
    """Information (n, n) and vector (n,) over the n knots of a segment, of passes that are accepted.

    ``rows`` is the number of their measurements, each as often as its pass counts; ``log_roughness`` the sum of the
    logarithms of what they learned of it (1/m), ``covered`` (``PARTS``,) how many of them were on each part. What is
    taken off makes a sum with all signs turned.
    """

    information: Floats
    vector: Floats
    rows: float
    log_roughness: float
    covered: Floats
    passes: int
    drives: int
    observations: int

    @classmethod
    def of_drive(
        cls,
        passes: Sequence[PassFactor],
        weight: Sequence[float],
        drive: ConstantsInformation,
        count: int,
        length_m: float,
    ) -> Self:
        """What the passes of one drive over one segment say, each ``weight`` times (0: it is not accepted).

        ``drive`` is what all ``count`` passes of the drive say of its constants; ``length_m`` is what the knots assume.
        """
        share = SHARE_ELSEWHERE * min(count / USUAL_PASSES, 1.0)
        knots = len(passes[0].vector) - NUISANCES
        information, vector = np.zeros((knots, knots)), np.zeros(knots)
        accepted = [(p, w) for p, w in zip(passes, weight, strict=True) if w > 0]
        covered = np.zeros(PARTS)
        middle = (np.arange(PARTS) + 0.5) * length_m / PARTS
        for one, w in accepted:
            said, right = condense(one, w, drive - ConstantsInformation.of_passes([one]), share)
            information += said
            vector += right
            covered += (one.start_m <= middle) & (middle <= one.end_m)
        return cls(
            information,
            vector,
            float(sum(w * max(p.rows, 1) for p, w in accepted)),
            float(sum(np.log(p.roughness) for p, _ in accepted)),
            covered,
            len(accepted),
            int(bool(accepted)),
            sum(p.observations for p, _ in accepted),
        )

    def __add__(self, other: CondensedPasses) -> CondensedPasses:
        return CondensedPasses(*map(operator.add, _VALUES(self), _VALUES(other)))

    def __neg__(self) -> CondensedPasses:
        return CondensedPasses(*map(operator.neg, _VALUES(self)))

    def factor(self, segment: int, length_m: float) -> PassFactor:
        """The sum in the place of one pass of a drive without errors of its own.

        Its passes were weighed one by one when they were added. The sum is judged as a whole by how much worse it fits
        than it would by itself: where that is nothing it counts as it stands.
        """
        knots = len(self.vector)
        information = np.zeros((knots + NUISANCES, knots + NUISANCES))
        information[:knots, :knots] = self.information
        reached = np.flatnonzero(self.covered > 0)
        low, high = (reached[0], reached[-1] + 1) if len(reached) else (0, 0)
        return PassFactor(
            segment=segment,
            sequence=0,
            mount=0,
            information=information,
            vector=np.append(self.vector, np.zeros(NUISANCES)),
            square=_explained(self.information, self.vector) + self.rows,
            rows=max(round(self.rows), 1),
            walk_m2_per_s=(0.0, 0.0),
            start_m=float(low * length_m / PARTS),
            end_m=float(high * length_m / PARTS),
            roughness=float(np.exp(self.log_roughness / self.passes)),
            observations=self.observations,
            first_time_s=0.0,
            last_time_s=0.0,
            condensed=self.passes,
        )

    def encode(self) -> bytes:
        """As little-endian doubles."""
        head = [
            len(self.vector), self.rows, self.log_roughness, self.passes, self.drives, self.observations,
        ]  # fmt: skip
        upper = self.information[np.triu_indices(len(self.vector))]
        return np.concatenate([head, self.covered, self.vector, upper]).astype("<f8").tobytes()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The inverse of ``encode``, bit for bit."""
        values = np.frombuffer(data, "<f8").astype(np.float64)
        n = int(values[0])
        head, covered, vector, upper = np.split(values, np.cumsum([_HEAD, PARTS, n]))
        passes, drives, observations = (int(v) for v in head[3:])
        rows, rough = float(head[1]), float(head[2])
        return cls(symmetric(upper, n), vector, rows, rough, covered, passes, drives, observations)


_VALUES = operator.attrgetter(*(spec.name for spec in fields(CondensedPasses)))


def condense(
    one: PassFactor, weight: float, elsewhere: ConstantsInformation, share: float = 1.0
) -> tuple[Floats, Floats]:
    """Information (n, n) and vector (n,) of a pass that counts ``weight`` times over its n knots alone.

    The drive's own errors are integrated out: constants with what is believed of any and what the drive says of them
    ``elsewhere``, of which a ``share`` is believed, errors of heights with nothing.
    """
    n = len(one.vector)
    knots = n - NUISANCES
    used = np.flatnonzero(one.used)
    constants = used[used < len(CONSTANTS)]
    keys = [(int(k), int(getattr(one, SETTINGS[k])) if k in SETTINGS else 0) for k in constants]
    known, right = elsewhere.onto(keys)
    gone = knots + used
    inside = weight * one.information[np.ix_(gone, gone)] + np.diag(_PRIOR[used])
    value = weight * one.vector[gone] + (_PRIOR * _MEAN)[used]
    inside[: len(keys), : len(keys)] += share * known
    value[: len(keys)] += share * right
    across = weight * one.information[np.ix_(gone, np.arange(knots))]
    solved = np.linalg.solve(inside, np.column_stack([across, value]))
    information = weight * one.information[:knots, :knots] - across.T @ solved[:, :-1]
    return 0.5 * (information + information.T), weight * one.vector[:knots] - across.T @ solved[:, -1]


def _explained(information: Floats, vector: Floats) -> float:
    """What the best fit of a likelihood explains of its square: vector' information^-1 vector."""
    scale = np.sqrt(np.maximum(np.diagonal(information), 1e-30))
    best, *_ = np.linalg.lstsq(information / np.outer(scale, scale), vector / scale, rcond=1e-13)
    return float(vector @ (best / scale))
