"""The slopes of the network, found again around the segments whose passes changed, and nowhere else.

``drive_passes`` -> a ``Solution``. Nothing is written and nobody kept waiting: the caller reads in one snapshot, and
what becomes of the solution is in ``swap``.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from sqlalchemy.orm import Session

from app.network.condensed import MOST_CONDENSED, OldPass, condensed_over, passes_to_condense, portions
from app.network.control import control_on
from app.network.passes import StoredPass, by_drive, passes_over, said_elsewhere
from app.network.surroundings import Surroundings, stored_terrain, surroundings
from fusion.network.adjust import adjust
from fusion.network.condensed import CondensedPasses
from fusion.network.curve import knot_length
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.subnetwork import Subnetwork, subnetwork_around
from fusion.types import Bools

SETTLED_SIGMAS = 0.025
"""Slopes just outside of what is published may move by so much; if they move farther, the window was too small. What
settling the whole changes is to stay below 0.1 sigma."""

SCALES = (1.0, 8.0)
"""The library's radii are multiplied by these in turn until the slopes are settled: where one is not enough, two and
four seldom are, and cost as much again."""

LARGEST_GROWING = 1_000
"""Windows of more segments do not grow: what they leave is the next settling's. Changes reach far where little is
known, and there roads are few; a window twice as wide has four times as many."""

SETTLING_SCALE = 2.0
"""Of the one window in which a cell of a network is solved that is solved whole."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The slopes of a window of the surroundings, of the passes that are over it, drive by drive."""

    around: Surroundings
    window: Subnetwork
    drives: list[list[StoredPass]]
    result: Adjustment | None
    """None where nothing was to be solved"""
    sums: list[tuple[int, CondensedPasses]] = field(default_factory=list)
    """By segment, what the old passes over it say besides"""

    def settled(self) -> bool:
        """Whether slopes outside of what is published stay as they are."""
        if self.result is None:
            return True
        solved = self.window.solved
        moved = np.abs(self.result.slope_percent - self.around.slope_percent[solved])
        far = moved > SETTLED_SIGMAS * self.around.slope_sigma_percent[solved]
        return not np.any(far[self.window.ring[solved]])

    def heard(self) -> list[tuple[StoredPass, bool]]:
        """Every pass with the verdict over it."""
        if self.result is None:
            return []
        verdicts = self.result.accepted
        return [(p, verdicts[k, p.factor.sequence]) for k, said in enumerate(self.drives) for p in said]

    def accepted_drives(self) -> Counter[int]:
        """How many drives are heard on each segment, those of its sum among them."""
        count = Counter(
            segment for segment, _ in {(p.factor.segment, p.drive_id) for p, good in self.heard() if good}
        )
        for k, (segment, one) in enumerate(self.sums, len(self.drives)):
            count[segment] += one.drives * (self.result is not None and self.result.accepted[k, 0])
        return count

    def old_passes(self, shown: Bools) -> list[OldPass]:
        """The passes over rows that are ``shown`` that are beyond their jury, and how much each counted."""
        if self.result is None:
            return []
        mine = set(self.around.ids[shown & self.window.solved].tolist())
        weight, over = self.result.weight, dict[int, list[OldPass]]()
        for k, said in enumerate(self.drives):
            for p in said:
                name = (k, p.factor.sequence)
                if p.id is not None and p.factor.segment in mine:
                    heard = weight[name] if self.result.accepted[name] else 0.0
                    over.setdefault(p.factor.segment, []).append(OldPass(p.id, p.drive_id, p.factor, heard))
        old = (p for segment in sorted(over) for p in passes_to_condense(over[segment]))
        return next(portions(old, MOST_CONDENSED), [])


def solve_around(session: Session, touched: Collection[int]) -> tuple[Solution, Bools]:
    """Solve again around ``touched`` segments; the solution, and which rows of its surroundings it is to be shown of.

    The window grows until the change has died away at its edge: where little was measured, it reaches farther. Gaps
    that hang on what lies outside of the window wait until the whole is settled.
    """
    for scale in SCALES:
        solution = _solve(session, touched, scale)
        if solution.settled() or np.count_nonzero(solution.window.solved) > LARGEST_GROWING:
            break
    window = solution.window
    return solution, window.published & ~window.outward


def settle_cell(session: Session, segment_ids: Collection[int]) -> Solution:
    """Solve one cell of a network that is solved whole: these segments are all that it has of the network.

    What was found before has no part in it, so slopes do not depend on which cell came first.
    """
    return _solve(session, segment_ids, SETTLING_SCALE)


def lag_among_all(session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor]) -> float | None:
    """How late the drive's altimeter is, s, if it said ``factors``, whose segments are database ids; None: it has none.

    Nothing is written, and what is stored of the drive itself has no part in it, so the network need not be owned.
    """
    instead = [StoredPass(None, drive_id, True, factor) for factor in factors]
    solution = _solve(session, {f.segment for f in factors}, SCALES[0], instead)
    if solution.result is None:
        return None
    lags = solution.result.lag_s
    return next((lags.get(k) for k, said in enumerate(solution.drives) if said[0].drive_id == drive_id), None)


def _solve(
    session: Session, touched: Collection[int], scale: float, instead: Sequence[StoredPass] = ()
) -> Solution:
    """``instead``: what one drive says in place of what is stored of it."""
    around = surroundings(session, touched, scale)
    again = np.isin(around.ids, list(touched))
    driven = around.driven | np.isin(around.ids, [p.factor.segment for p in instead])
    window = subnetwork_around(around.table, driven, again, around.drives >= 0, scale)
    ids = around.ids[window.solved].tolist()
    if not ids:
        return Solution(around, window, [], None)
    row_of = {segment: row for row, segment in enumerate(ids)}
    own = {p.drive_id for p in instead}
    passes = [p for p in passes_over(session, ids) if p.drive_id not in own]
    drives = by_drive([*passes, *(p for p in instead if p.factor.segment in row_of)])
    elsewhere = {
        k: said for k, said in said_elsewhere(session, drives).items() if drives[k][0].drive_id not in own
    }
    sums = sorted(condensed_over(session, ids, next(iter(own), None)).items())
    said = {k: [p.factor.over(row_of[p.factor.segment]) for p in said] for k, said in enumerate(drives)}
    length = knot_length(around.table.length_m[window.solved])
    for k, (segment, one) in enumerate(sums, len(drives)):
        said[k] = [one.factor(row_of[segment], float(length[row_of[segment]]))]
    result = adjust(
        around.table.subset(window.solved),
        said,
        stored_terrain(session, around.table.subset(window.solved), around.ids[window.solved]),
        control_on(session, around.table).among(window.solved),
        outside=elsewhere,
    )
    return Solution(around, window, drives, result, sums)
