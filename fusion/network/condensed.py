"""Condensed passes: what many drives say of one segment in the room of one pass, however many they are.

A pass speaks of the road and of its drive's own errors. With these integrated out, pass by pass, what is left speaks of
the knots of the segment alone, and such pieces are added up, and taken off again when a drive goes. A drive's constants
are taken from what its other passes say of them (``ConstantsInformation``), never from a solution; errors of heights
are free. So a sum says less than its passes would say together: heights are not carried from one segment to the next.

What is left of a constant's error is common to all passes of a drive, but sums take it for independent from segment to
segment; hence ``SHARE_ELSEWHERE``.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from fusion.network.drive_beliefs import LAG_MEAN_S, LAG_SIGMA_S
from fusion.network.drive_constants import FREE_INFORMATION, ConstantsInformation
from fusion.network.pass_factor import (
    CONSTANT_SIGMA,
    CONSTANTS,
    LAG,
    NUISANCES,
    SETTINGS,
    PassFactor,
    symmetric,
)
from fusion.types import Floats

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
PRIOR_OF_NUISANCES = np.append(
    np.array(CONSTANT_SIGMA) ** -2.0, np.full(NUISANCES - len(CONSTANTS), FREE_INFORMATION)
)
PRIOR_OF_NUISANCES[LAG] = 1 / (LAG_MEAN_S[1] ** 2 + LAG_SIGMA_S**2)
PRIOR_MEAN = np.zeros(NUISANCES)
PRIOR_MEAN[LAG] = LAG_MEAN_S[0]


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
        share = believed_share(count)
        knots = len(passes[0].vector) - NUISANCES
        information, vector = np.zeros((knots, knots)), np.zeros(knots)
        accepted = [(p, w) for p, w in zip(passes, weight, strict=True) if w > 0]
        for one, w in accepted:
            said, right = condense(one, w, drive - ConstantsInformation.of_passes([one]), share)
            information += said
            vector += right
        reached = covered_parts([p for p, _ in accepted], [length_m] * len(accepted))
        return cls(
            information,
            vector,
            float(sum(w * max(p.rows, 1) for p, w in accepted)),
            float(sum(np.log(p.roughness) for p, _ in accepted)),
            np.sum(reached, axis=0),
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


def believed_share(count: int) -> float:
    """The share of what a drive of so many passes says of its constants elsewhere that is believed in a sum."""
    return SHARE_ELSEWHERE * min(count / USUAL_PASSES, 1.0)


def covered_parts(passes: Sequence[PassFactor], lengths_m: Sequence[float]) -> Floats:
    """1 for each of the ``PARTS`` whose middle a pass was on, else 0, shape (m, ``PARTS``)."""
    middle = (np.arange(PARTS) + 0.5) * np.array(lengths_m)[:, None] / PARTS
    driven_m = np.array([(p.start_m, p.end_m) for p in passes]).reshape(-1, 2)
    return np.asarray((driven_m[:, :1] <= middle) & (middle <= driven_m[:, 1:]), float)


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
    inside = weight * one.information[np.ix_(gone, gone)] + np.diag(PRIOR_OF_NUISANCES[used])
    value = weight * one.vector[gone] + (PRIOR_OF_NUISANCES * PRIOR_MEAN)[used]
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
