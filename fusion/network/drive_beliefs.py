"""What all drives say: their passes, and how the errors that they carry along hang together.

Every drive's own errors are unknowns (``fusion.network.unknowns``). Whole passes and the way of a height sensor from
one pass to the next have heavy tails, found in rounds of reweighting. What is believed of roads is not known here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.network.equations import Asked, Blocks, Solution
from fusion.network.pass_columns import PassColumns
from fusion.network.pass_factor import (
    CONSTANT_SIGMA,
    EAST,
    ENTRY,
    EXIT,
    HEIGHT_SENSORS,
    LAG,
    NORTH,
    NUISANCES,
    PassFactor,
)
from fusion.network.unknowns import DriveUnknowns, RoadUnknowns
from fusion.types import Floats, Ints

PASS_FREEDOM = 4.0
"""Degrees of freedom of a pass's misfit for each of its measurements."""
REJECT_SIGMAS = 4.0
"""Passes that miss the solution by more than they state, for each of their measurements, are not accepted."""
WALK_FREEDOM = 2.0
"""Degrees of freedom of a height error's step from pass to pass: fixes jump."""
WALK_PRIOR_COUNT = 10.0
"""Imaginary steps that hold a drive's rate to what it learned of itself."""
SCALE_PRIOR_COUNT = 10.0
"""Imaginary passes that fit as well as their drive believes."""
START_SIGMA_M = (30.0, 300.0)
"""Errors of ``HEIGHT_SENSORS`` where a drive begins: datums, and the pressure of the day."""
LAG_MEAN_S = (1.5, 1.0)
"""Mean lag of altimeters, s, and its sigma: between none and the three seconds that slow filters take."""
LAG_SIGMA_S = 2.0
"""Altimeters' lags about their mean, s."""


@dataclass(frozen=True, eq=False)
class PassGroup:
    """Passes with equal numbers of unknowns: ``members`` (m,) of the table of all, and their equations."""

    members: Ints
    blocks: Blocks
    square: Floats
    rows: Floats
    """How many measurements each sums"""


class DriveBeliefs:
    """What all drives say: their passes, and how the errors that they carry along hang together.

    ``factors`` are the passes of the table one by one; without them what they say is added to the equations elsewhere.
    """

    def __init__(
        self, passes: PassColumns, road: RoadUnknowns, factors: Sequence[PassFactor] | None = None
    ) -> None:
        self.passes = passes
        self.names, self.where = passes.of_drives()
        self.number = np.repeat(np.arange(len(self.names)), [w.stop - w.start for w in self.where])
        """Of each pass, that of its drive in ``names``"""
        size = road.size
        self.unknowns: dict[int, DriveUnknowns] = {}
        for d, mine in zip(self.names, self.where, strict=True):
            self.unknowns[d] = DriveUnknowns(passes.take(mine), size)
            size = self.unknowns[d].end
        self.of_pass = np.concatenate(
            [np.empty((0, NUISANCES), np.int64), *(u.of_pass for u in self.unknowns.values())]
        )
        lags = [u.lag for u in self.unknowns.values() if u.lag is not None]
        self.lag_mean = size if lags else None
        self.size = size + bool(lags)
        self.fixed = self._beliefs(lags)
        self.walks = self._walks()
        self.pass_scale = np.ones(len(self.names))
        self.overruled = np.empty(0, np.int64)
        """Segments whose sums (``fusion.network.condensed``) are accepted no longer"""
        self.groups = self._groups(road, factors)

    def _beliefs(self, lags: list[int]) -> list[Blocks]:
        every = [q for u in self.unknowns.values() for q in u.constants.items()]
        kinds = np.array(every, np.int64).reshape(-1, 2)
        kinds = kinds[kinds[:, 1] != LAG]
        sigma = np.array(CONSTANT_SIGMA)[kinds[:, 1]]
        out = [Blocks.of_rows(kinds[:, :1], np.ones((len(kinds), 1)), 0.0, sigma**2)]
        for s, start_m in enumerate(START_SIGMA_M):
            known = np.flatnonzero(self.of_pass[:, ENTRY.start + s] >= 0)
            _, first = np.unique(self.number[known], return_index=True)
            begin = self.of_pass[known[first], ENTRY.start + s]
            out.append(Blocks.of_rows(begin[:, None], np.ones((len(begin), 1)), 0.0, start_m**2))
        if lags:
            out.append(
                Blocks.of_rows(
                    np.array([[self.lag_mean]]), np.ones((1, 1)), LAG_MEAN_S[0], LAG_MEAN_S[1] ** 2
                )
            )
            pairs = np.column_stack([lags, np.full(len(lags), self.lag_mean)])
            out.append(Blocks.of_rows(pairs, np.array([1.0, -1.0]), 0.0, LAG_SIGMA_S**2))
        return [b for b in out if len(b.variables)]

    def _walks(self) -> Blocks:
        """From one pass to the next an error walks on; over a second, where the passes meet."""
        pairs, variance, series = [np.empty((0, 2), np.int64)], [np.empty(0)], [np.empty(0, np.int64)]
        for mine, u in zip(self.where, self.unknowns.values(), strict=True):
            first_s, last_s = self.passes.first_time_s[mine], self.passes.last_time_s[mine]
            rate = self.passes.walk_m2_per_s[mine]
            for s in range(len(HEIGHT_SENSORS)):
                before, after = u.joints(s)
                pairs.append(
                    np.column_stack([u.of_pass[before, EXIT.start + s], u.of_pass[after, ENTRY.start + s]])
                )
                apart = np.maximum(first_s[after] - last_s[before], 0.0) + 1.0
                variance.append(apart * rate[after, s])
                series.append(np.full(len(before), len(series)))
        self.walk_series = np.concatenate(series)
        self.walk_scale = np.ones(len(series) + 1)
        out = Blocks.of_rows(np.concatenate(pairs), np.array([-1.0, 1.0]), 0.0, np.concatenate(variance))
        out.asked = Asked.EXPECTED
        return out

    def _groups(self, road: RoadUnknowns, factors: Sequence[PassFactor] | None) -> list[PassGroup]:
        """Passes with equal numbers of unknowns, those first that come first."""
        passes = self.passes
        out = []
        for members in passes.alike():
            used = passes.used[members[0]]
            variables = np.concatenate(
                [road.variables(passes.segment[members]), self.of_pass[members][:, used]], axis=1
            )
            if factors is None:
                blocks = Blocks.elsewhere(variables, members)
            else:
                said = said_by([factors[k] for k in members.tolist()])
                blocks = Blocks(variables, *said, np.ones(len(members)))
            blocks.asked = Asked.MISFIT
            rows = np.maximum(passes.rows[members], 1).astype(float)
            out.append(PassGroup(members, blocks, passes.square[members], rows))
        return out

    @property
    def late(self) -> Ints:
        """The unknowns that so many passes speak of that they had better be eliminated after them, (m,)."""
        of_all = [
            q for u in self.unknowns.values() for q, kind in u.constants.items() if kind not in (EAST, NORTH)
        ]
        return np.array([*of_all, *([] if self.lag_mean is None else [self.lag_mean])], np.int64)

    def blocks(self) -> list[Blocks]:
        """All equations."""
        return [*self.fixed, self.walks, *(group.blocks for group in self.groups)]

    def learn(self, solution: Solution, first: bool) -> None:
        """Weigh passes and the ways between them by what the solution says of them.

        After the ``first`` solution only the ways: a jump between two passes tears at both until it is let go.
        """
        if len(self.walks.variables):
            self._learn_walks(solution.expected_squares(self.walks))
        if first:
            return
        misfits = self.misfits(solution)
        self._learn_scales(misfits)
        self._learn_overruled(misfits)
        for group, misfit in zip(self.groups, misfits, strict=True):
            weight = _pass_weight(misfit, self.pass_scale[self.number[group.members]])
            told = self.passes.condensed[group.members] > 0
            weight[told & np.isin(self.passes.segment[group.members], self.overruled)] = 0.0
            group.blocks.weight = weight

    def _learn_scales(self, misfits: list[Floats]) -> None:
        """How much worse each drive's passes fit than it believes of itself: its place, and what it has no model of."""
        number = np.concatenate([self.number[group.members] for group in self.groups])
        misfit = np.concatenate(misfits)
        order = np.argsort(number, kind="stable")
        first = np.searchsorted(number[order], np.arange(len(self.names) + 1))
        for k, (a, b) in enumerate(zip(first[:-1].tolist(), first[1:].tolist(), strict=True)):
            self.pass_scale[k] = _scale(misfit[order[a:b]])

    def _learn_overruled(self, misfits: list[Floats]) -> None:
        """Where most of the passes contradict a solution with a sum in it, the sum goes: the newest drives know what
        the road is now. Else what is new would be rejected for ever, since it never becomes the most."""
        condensed, segment = self.passes.condensed > 0, self.passes.segment
        if not condensed.any():
            return
        members = np.concatenate([group.members for group in self.groups])
        contradicts = np.concatenate(misfits) > REJECT_SIGMAS**2 * self.pass_scale[self.number[members]]
        recent = ~condensed[members]
        against = np.bincount(segment[members][recent], np.where(contradicts[recent], 1.0, -1.0))
        sums = np.unique(segment[condensed])
        sums = sums[sums < len(against)]
        self.overruled = np.union1d(self.overruled, sums[against[sums] > 0])

    def _learn_walks(self, squares: Floats) -> None:
        """How much each drive's errors walk beyond what it knew of itself, and where they jump."""
        series = self.walk_series
        for _ in range(5):
            weight = (WALK_FREEDOM + 1) / (WALK_FREEDOM + squares / self.walk_scale[series])
            total = np.bincount(series, weight * squares, minlength=len(self.walk_scale))
            count = np.bincount(series, minlength=len(self.walk_scale))
            self.walk_scale = (total + WALK_PRIOR_COUNT) / (count + WALK_PRIOR_COUNT)
        self.walks.weight = (
            (WALK_FREEDOM + 1) / (WALK_FREEDOM + squares / self.walk_scale[series]) / self.walk_scale[series]
        )

    def misfits(self, solution: Solution) -> list[Floats]:
        """Chi-square of each pass for each of its measurements, group by group."""
        return [
            np.maximum(
                group.square - 2 * solution.products(group.blocks) + solution.squares(group.blocks), 0.0
            )
            / group.rows
            for group in self.groups
        ]


def said_by(factors: Sequence[PassFactor]) -> tuple[Floats, Floats]:
    """Information and vectors of passes with equal unknowns, over the knots and what they use of the drive's own."""
    used = factors[0].used
    columns = np.flatnonzero(np.append(np.ones(len(factors[0].vector) - NUISANCES, np.bool_), used))
    information = np.array([f.information for f in factors])[:, columns[:, None], columns]
    return information, np.array([f.vector for f in factors])[:, columns]


def _scale(misfit: Floats) -> float:
    """How many times worse these passes of a drive fit than it believes; those that contradict the network have no
    part in it, unless they are the most."""
    usual = np.ones(min(int(SCALE_PRIOR_COUNT), len(misfit) + 1))  # with more of them the middle is 1 as well
    scale = max(float(np.median(np.concatenate([misfit, usual]))), 1.0)
    for _ in range(5):
        weight = _pass_weight(misfit, np.full(len(misfit), scale)) * scale
        scale = max(float(weight @ misfit + SCALE_PRIOR_COUNT) / (len(misfit) + SCALE_PRIOR_COUNT), 1.0)
    return scale


def _pass_weight(misfit: Floats, scale: Floats) -> Floats:
    scaled = misfit / scale
    weight = (PASS_FREEDOM + 1) / (PASS_FREEDOM + scaled)
    return np.asarray(weight * np.minimum(1.0, REJECT_SIGMAS**2 / np.maximum(scaled, 1e-9)) / scale)
