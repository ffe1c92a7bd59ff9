"""What all drives say: their passes, and how the errors that they carry along hang together.

Every drive's own errors are unknowns (``fusion.network.unknowns``). Whole passes and the way of a height sensor from
one pass to the next have heavy tails, found in rounds of reweighting. What is believed of roads is not known here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fusion.network.equations import Blocks, Solution
from fusion.network.pass_factor import (
    CONSTANT_SIGMA,
    EAST,
    ENTRY,
    EXIT,
    HEIGHT_SENSORS,
    LAG,
    NORTH,
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


class DriveBeliefs:
    """What all drives say: their passes, and how the errors that they carry along hang together."""

    def __init__(self, drives: Mapping[int, Sequence[PassFactor]], road: RoadUnknowns) -> None:
        self.names = sorted(drives)
        self.passes = {d: sorted(drives[d], key=lambda p: p.sequence) for d in self.names}
        size = road.size
        self.unknowns: dict[int, DriveUnknowns] = {}
        for d in self.names:
            self.unknowns[d] = DriveUnknowns(self.passes[d], size)
            size = self.unknowns[d].end
        lags = [u.lag for u in self.unknowns.values() if u.lag is not None]
        self.lag_mean = size if lags else None
        self.size = size + bool(lags)
        self.fixed = self._beliefs(lags)
        self.walks = self._walks()
        self._number = {d: k for k, d in enumerate(self.names)}
        self.pass_scale = np.ones(len(self.names))
        self.overruled: set[int] = set()
        """Segments whose sums (``fusion.network.condensed``) are accepted no longer"""
        self.groups = self._groups(road)

    def _beliefs(self, lags: list[int]) -> list[Blocks]:
        out = []
        for u in self.unknowns.values():
            kinds = np.array(list(u.constants.items()), np.int64).reshape(-1, 2)
            kinds = kinds[kinds[:, 1] != LAG]
            sigma = np.array(CONSTANT_SIGMA)[kinds[:, 1]]
            out.append(Blocks.of_rows(kinds[:, :1], np.ones((len(kinds), 1)), 0.0, sigma**2))
            for s in range(len(HEIGHT_SENSORS)):
                first = u.of_pass[u.of_pass[:, ENTRY.start + s] >= 0, ENTRY.start + s][:1]
                out.append(
                    Blocks.of_rows(first[:, None], np.ones((len(first), 1)), 0.0, START_SIGMA_M[s] ** 2)
                )
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
        for d in self.names:
            u, passes = self.unknowns[d], self.passes[d]
            first_s, last_s = (
                np.array([getattr(p, f"{n}_time_s") for p in passes]) for n in ("first", "last")
            )
            rate = np.array([p.walk_m2_per_s for p in passes])
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
        return Blocks.of_rows(np.concatenate(pairs), np.array([-1.0, 1.0]), 0.0, np.concatenate(variance))

    def _groups(self, road: RoadUnknowns) -> list[tuple[list[tuple[int, int]], Blocks, Floats, Floats]]:
        """Passes with equal numbers of unknowns: which, their blocks, squares and numbers of measurements."""
        by_size: dict[tuple[int, bytes], list[tuple[int, int]]] = {}
        for d in self.names:
            used = self.unknowns[d].of_pass >= 0
            for k, one in enumerate(self.passes[d]):
                by_size.setdefault((len(one.vector), used[k].tobytes()), []).append((d, k))
        out = []
        for (size, used_bytes), members in by_size.items():
            factors = [self.passes[d][k] for d, k in members]
            used = np.frombuffer(used_bytes, bool)
            columns = np.flatnonzero(np.concatenate([np.ones(size - used.size, bool), used]))
            own = np.array([self.unknowns[d].of_pass[k] for d, k in members])[:, used]
            rows = np.array([f.segment for f in factors])
            blocks = Blocks(
                np.concatenate([road.variables(rows), own], axis=1),
                np.array([f.information for f in factors])[:, columns[:, None], columns],
                np.array([f.vector for f in factors])[:, columns],
                np.ones(len(members)),
            )
            squares = np.array([f.square for f in factors])
            out.append((members, blocks, squares, np.array([max(f.rows, 1) for f in factors], float)))
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
        return [*self.fixed, self.walks, *(b for _, b, _, _ in self.groups)]

    def learn(self, solution: Solution, first: bool) -> None:
        """Weigh passes and the ways between them by what the solution says of them.

        After the ``first`` solution only the ways: a jump between two passes tears at both until it is let go.
        """
        if len(self.walks.variables):
            self._learn_walks(self.walks.expected_squares(solution))
        if first:
            return
        misfits = self.misfits(solution)
        self._learn_scales(misfits)
        self._learn_overruled(misfits)
        for (members, blocks, _, _), misfit in zip(self.groups, misfits, strict=True):
            blocks.weight = _pass_weight(misfit, self._scales_of(members))
            if self.overruled:
                passes = [self.passes[d][k] for d, k in members]
                blocks.weight[[p.condensed > 0 and p.segment in self.overruled for p in passes]] = 0.0

    def _learn_scales(self, misfits: list[Floats]) -> None:
        """How much worse each drive's passes fit than it believes of itself: its place, and what it has no model of."""
        number = np.concatenate([[self._number[d] for d, _ in g[0]] for g in self.groups])
        misfit = np.concatenate(misfits)
        order = np.argsort(number, kind="stable")
        first = np.searchsorted(number[order], np.arange(len(self.names) + 1))
        for k, (a, b) in enumerate(zip(first[:-1].tolist(), first[1:].tolist(), strict=True)):
            self.pass_scale[k] = _scale(misfit[order[a:b]])

    def _learn_overruled(self, misfits: list[Floats]) -> None:
        """Where most of the passes contradict a solution with a sum in it, the sum goes: the newest drives know what
        the road is now. Else what is new would be rejected for ever, since it never becomes the most."""
        condensed = {p.segment for passes in self.passes.values() for p in passes if p.condensed}
        against = dict.fromkeys(condensed, 0)
        for (members, _, _, _), misfit in zip(self.groups if condensed else (), misfits, strict=False):
            contradicts = misfit > REJECT_SIGMAS**2 * self._scales_of(members)
            for (d, k), wrong in zip(members, contradicts.tolist(), strict=True):
                one = self.passes[d][k]
                if one.segment in condensed and not one.condensed:
                    against[one.segment] += 1 if wrong else -1
        self.overruled |= {segment for segment, most in against.items() if most > 0}

    def _scales_of(self, members: list[tuple[int, int]]) -> Floats:
        return np.array([self.pass_scale[self._number[d]] for d, _ in members])

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
                square - 2 * np.sum(b.vector * solution.x[b.variables], axis=1) + b.squares(solution.x), 0.0
            )
            / rows
            for _, b, square, rows in self.groups
        ]


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
