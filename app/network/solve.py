"""The slopes of the network: solved again around the segments whose passes changed, and nowhere else.

``drive_passes`` -> ``network_slopes`` (here) -> ``segment_slopes`` (``publish.py``). Callers own the
network (``app.network.versions``), so that what is read here stays as it is until the result is written.
"""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from app.network.control import control_on
from app.network.passes import StoredPass, by_drive, passes_over, said_elsewhere, set_verdicts
from app.network.publish import refresh_aggregates
from app.network.regions import Cell, Region, cells_of, regions
from app.network.slopes import clear_slopes, write_slopes
from app.network.surroundings import Surroundings, stored_terrain, surroundings
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.published import Adjustment
from fusion.network.window import Window, window_around
from fusion.types import Bools, Progress, no_progress

TOLERANCE_SIGMAS = 1e-3
"""Smaller changes are not written: what is stored stays within it of what was found, however often."""

SETTLED_SIGMAS = 0.05
"""Slopes just outside of what is published may move by so much; if they move farther, the window was too small. What
settling the whole changes is to stay below 0.1 sigma."""

SCALES = (1.0, 2.0, 4.0, 8.0)
"""The library's radii are multiplied by these in turn until the slopes are settled."""

LARGEST_GROWING = 10_000
"""Windows of more segments do not grow: what they leave is the next settling's. Changes reach far where little is
known, and there drives are few."""

REGION_SCALE = 2.0
"""Of the one window in which a region is solved."""


@dataclass(frozen=True, eq=False)
class _Solution:
    """The slopes of a window of the surroundings, of the passes that are over it, drive by drive."""

    around: Surroundings
    window: Window
    drives: list[list[StoredPass]]
    result: Adjustment | None
    """None where nothing was to be solved"""

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
        verdicts = self.result.heard
        return [(p, verdicts[k, p.factor.sequence]) for k, said in enumerate(self.drives) for p in said]


Published = Callable[[Surroundings], Bools]
"""Rows that may be published at all"""


def refresh_network(session: Session, touched: Collection[int]) -> None:
    """Solve the network again around ``touched`` segments and renew what is published there."""
    if touched:
        refresh_aggregates(session, adjust_around(session, touched))


def refresh_in_regions(session: Session, touched: Collection[int], progress: Progress = no_progress) -> None:
    """``refresh_network`` for any number of segments, region by region, each in one wide window."""
    parts = regions(session, touched)
    for done, part in enumerate(parts):
        progress("slopes", done / len(parts))
        refresh_aggregates(session, adjust_around(session, part.ids, (REGION_SCALE,)))


def settle_region(session: Session, region: Region, all_cells: Collection[Cell]) -> None:
    """Solve a region of a network that is solved whole, of which ``all_cells`` are the others.

    What lies in another region is left to it, so that slopes do not depend on which region came first, and what was
    stored before has no part in them.
    """

    def own(around: Surroundings) -> Bools:
        cells = cells_of(around.table)
        return np.array([cell == region.cell or cell not in all_cells for cell in cells], bool)

    refresh_aggregates(session, adjust_around(session, region.ids, (REGION_SCALE,), own, 0.0))


def adjust_around(
    session: Session,
    touched: Collection[int],
    scales: Sequence[float] = SCALES,
    may_publish: Published | None = None,
    tolerance_sigmas: float = TOLERANCE_SIGMAS,
) -> list[int]:
    """Solve again around ``touched`` segments; ids of those whose slope changed, came or went.

    The window grows by ``scales`` until the change has died away at its edge: where little was measured, it
    reaches farther. ``may_publish`` says that the whole is being settled; gaps that hang on what lies outside of the
    window wait for that.
    """
    for scale in scales:
        solution = _solve(session, touched, scale)
        if solution.settled() or np.count_nonzero(solution.window.solved) > LARGEST_GROWING:
            break
    window = solution.window
    if may_publish is None:
        shown = window.published & ~window.outward
    else:
        shown = window.published & may_publish(solution.around)
    return _store(session, solution, shown, tolerance_sigmas)


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
) -> _Solution:
    """``instead``: what one drive says in place of what is stored of it."""
    around = surroundings(session, touched, scale)
    again = np.isin(around.ids, list(touched))
    driven = around.driven | np.isin(around.ids, [p.factor.segment for p in instead])
    window = window_around(around.table, driven, again, around.drives >= 0, scale)
    ids = around.ids[window.solved].tolist()
    if not ids:
        return _Solution(around, window, [], None)
    row_of = {segment: row for row, segment in enumerate(ids)}
    own = {p.drive_id for p in instead}
    passes = [p for p in passes_over(session, ids) if p.drive_id not in own]
    drives = by_drive([*passes, *(p for p in instead if p.factor.segment in row_of)])
    elsewhere = {
        k: said for k, said in said_elsewhere(session, drives).items() if drives[k][0].drive_id not in own
    }
    result = adjust(
        around.table.subset(window.solved),
        {k: [p.factor.over(row_of[p.factor.segment]) for p in said] for k, said in enumerate(drives)},
        stored_terrain(session, around.table.subset(window.solved), around.ids[window.solved]),
        control_on(session, around.table).among(window.solved),
        elsewhere=elsewhere,
    )
    return _Solution(around, window, drives, result)


def _store(session: Session, solution: _Solution, shown: Bools, tolerance_sigmas: float) -> list[int]:
    """Write the slopes of the rows that are ``shown`` and the verdicts over their passes; ids whose slope changed."""
    around, result = solution.around, solution.result
    gone = shown & (around.drives >= 0)
    if result is None:
        return clear_slopes(session, around.ids[gone].tolist())
    solved = np.flatnonzero(solution.window.solved)
    usable = np.isfinite(result.slope_percent) & np.isfinite(result.slope_sigma_percent) & shown[solved]
    rows = solved[usable]
    gone[rows] = False
    mine = set(around.ids[shown].tolist())
    heard = [(p, good) for p, good in solution.heard() if p.factor.segment in mine]
    set_verdicts(session, {p.id: good for p, good in heard if p.id is not None and p.accepted != good})
    drives = Counter(segment for segment, _ in {(p.factor.segment, p.drive_id) for p, good in heard if good})
    ids = around.ids[rows].tolist()
    counts = [drives[segment] for segment in ids]
    changed = write_slopes(session, ids, counts, result, usable, tolerance_sigmas)
    return [*clear_slopes(session, around.ids[gone].tolist()), *changed]
