"""Solves marked cells on a snapshot, outside of any lock, and swaps the new slopes in.

A solver claims cells, reads in one snapshot, solves, and writes in one short transaction if nobody has written in those
cells since; otherwise it starts again with what is new. It may die at any moment: the marks stay.
"""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core.claims import Claim
from app.core.db import Sessions
from app.core.messages import say
from app.core.telemetry.logs import tell
from app.core.telemetry.measures import CELLS_SOLVED, SOLVE_S, SQUARES_SOLVED, SWAP_CONFLICTS
from app.network.cells import beside, cells_over, lock_cells, raise_versions, unsettle, versions_of
from app.network.condensed import AT_ONCE, condense, condensed_by_drive, portions
from app.network.locks import cell_claim, cells_taken, try_share_network
from app.network.marks import Marked, Waiting, count_cells, delete_marks, marked_in, note_try, waiting_cells
from app.network.passes import partitions_of, set_accepted
from app.network.publish import clear_slopes, refresh_aggregates, write_slopes
from app.network.solve import Solution, solve_around
from fusion.types import Bools, Progress, no_progress

logger = logging.getLogger(__name__)

TOLERANCE_SIGMAS = 1e-3
"""Smaller changes are not written: a stored slope stays within it of the last solution, however many there are."""

MOST_CELLS = 16
"""Cells solved together: those of a drive of ten kilometres."""
MOST_TOUCHED = 4000
"""No further cell is claimed beyond so many touched segments, each counted as often as it is marked."""

_TRIES = 20
_PAUSE_S = 0.02
"""The pause before another try, which grows: swaps take some tens of milliseconds."""
_IMPORT_PAUSE_S = 0.2
"""Imports own the network repeatedly, for a tenth of a second."""
_LOCK_WAIT = text("SET LOCAL lock_timeout = '50ms'")
"""Cells are locked at once or not at all, and rows of their segments with them. Waits remain for writers beside the
service, and for two that insert the row of the same cell."""
_OTHERS_WRITE = frozenset({"55P03", "40P01"})
"""PostgreSQL's codes of a lock timeout and of a deadlock."""


def _ignore() -> None:
    """The callback of whoever wants none."""


class BusyError(Exception):
    """Others wrote first, again and again; the cells are still marked."""


@dataclass(frozen=True)
class Proposal:
    """What one snapshot yields, to be written if its cells still have these versions."""

    marks: list[int]
    combined: set[int]
    solution: Solution | None
    shown: Bools
    versions: dict[int, int]
    """Of all cells in which anything of it is shown. Imports raise those in which they change a road, too."""

    @classmethod
    def of(
        cls,
        session: Session,
        marks: list[int],
        combined: set[int],
        solved: tuple[Solution, Bools] | None = None,
    ) -> Proposal:
        """``solved``: a solution and which of its rows are shown. Looks up the cells of these and of ``combined``."""
        solution, shown = solved or (None, np.zeros(0, bool))
        ids = solution.around.ids[shown].tolist() if solution else []
        versions = versions_of(session, cells_over(session, {*ids, *combined}))
        return cls(marks, combined, solution, shown, versions)


def solve_marked(
    sessions: Sessions,
    *,
    only_due: bool = True,
    more: Callable[[], None] = _ignore,
    published: Callable[[], object] = _ignore,
) -> int:
    """Claim marked cells that no other solver has, solve and publish them; returns how many.

    With ``only_due`` a solver begins where a mark is due, and takes what is marked near by along. ``more`` is called
    before it solves if there is work for another solver, ``published`` when the map is up to date and only old passes
    are left to be condensed.
    """
    with cell_claim(sessions) as claim:
        with sessions.begin() as session:
            waiting = waiting_cells(session)
            cells = _claim(claim, session, waiting, only_due)
            if cells:
                note_try(session, cells)
        if cells:
            if any((w.due or not only_due) and w.cell not in cells for w in waiting):
                more()
            publish_cells(sessions, cells, published)
    return len(cells)


def publish_cells(
    sessions: Sessions, cells: Collection[int], published: Callable[[], object] = _ignore
) -> None:
    """Solve all that is marked in these cells, which the caller has claimed, and swap it in."""
    for attempt in range(_TRIES):
        started_s = time.monotonic()
        with snapshot(sessions) as session:
            proposal = _propose(session, marked_in(session, cells))
        if swap(sessions, proposal):
            log_solution("marked", proposal, len(cells), time.monotonic() - started_s, attempt + 1)
            published()
            condense_old_passes(sessions, proposal)
            return
        SWAP_CONFLICTS.count("marked")
        logger.debug("%d cells changed while they were solved; solving them again", len(cells))
        time.sleep(_PAUSE_S * random.uniform(0.5, 1.5) * min(attempt + 1, 5))  # noqa: S311 - no secret
        _await_network(sessions)
    raise BusyError(say("cells.others_first", n=_TRIES))


def log_solution(kind: str, proposal: Proposal, cells: int, took_s: float, tries: int) -> None:
    """Count and log a solution, without the names of its cells: they would tell where somebody drove."""
    SOLVE_S.observe(took_s, kind)
    CELLS_SOLVED.count(kind, by=cells)
    SQUARES_SOLVED.count(kind, by=cells)
    counts = {"cells": cells, "segments": int(proposal.shown.sum())}
    marks = len(proposal.marks) or None
    tell(logger, "cells solved", kind=kind, **counts, marks=marks, tries=tries, seconds=took_s)


def _await_network(sessions: Sessions) -> None:
    """Wait until no import owns the network: a solution of that time is out of date at its end."""
    while True:
        with sessions.begin() as session:
            if try_share_network(session):
                return
        time.sleep(_IMPORT_PAUSE_S)


@contextmanager
def snapshot(sessions: Sessions) -> Iterator[Session]:
    """A session that sees the database as it is at its first statement, and writes nothing."""
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        yield session


def solve_all_marked(sessions: Sessions, progress: Progress = no_progress) -> None:
    """Solve until nothing is marked any more, beside other solvers, and wait for the cells that they have claimed."""
    most = 1
    while True:
        with sessions() as session:
            waiting = count_cells(session)
        most = max(most, waiting)
        progress("slopes", 1 - waiting / most)
        if not waiting:
            return
        try:
            solved = solve_marked(sessions, only_due=False)
        except BusyError:
            logger.info("retrying cells in which others write", exc_info=True)
            continue
        if not solved:
            time.sleep(_PAUSE_S)


def swap(sessions: Sessions, proposal: Proposal, *, settled: bool = False) -> bool:
    """Write a proposal in one short transaction; False: it is out of date, or others write there just now.

    Cells in which anything shown changes get a new version and, unless this is ``settled``, wait to be settled, with
    those around them. What is settled is written to the last digit.
    """
    try:
        with sessions.begin() as session:
            session.execute(_LOCK_WAIT)
            if not try_share_network(session):
                return False
            if lock_cells(session, proposal.versions) != proposal.versions:
                return False
            solved = _write(session, proposal, 0.0 if settled else TOLERANCE_SIGMAS)
            changed = refresh_aggregates(session, [*solved, *proposal.combined])
            cells = cells_over(session, changed) if changed else []
            raise_versions(session, cells)
            if not settled:
                unsettle(session, cells)
            delete_marks(session, proposal.marks)
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) in _OTHERS_WRITE:
            return False
        raise
    return True


def condense_old_passes(sessions: Sessions, proposal: Proposal) -> None:
    """After a swap: condense the passes of the solution that are no longer recent, with their weights in it.

    Where others hold a lock the passes are left to the next solution, which reads that much more.
    """
    old = [] if proposal.solution is None else proposal.solution.old_passes(proposal.shown)
    if not old:
        return
    try:
        with sessions() as session:
            contributions = condensed_by_drive(session, old)
            partitions = partitions_of(session, {p.factor.segment for p in old})
        for portion in portions(old, AT_ONCE):
            with sessions.begin() as session:
                session.execute(_LOCK_WAIT)
                if try_share_network(session):
                    condense(session, portion, contributions, partitions)
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) not in _OTHERS_WRITE:
            raise
        logger.debug("%d old passes are not condensed yet: others hold a lock", len(old))


def _claim(claim: Claim, session: Session, waiting: list[Waiting], only_due: bool) -> set[int]:
    """Claim the first cell that is free, and marked ones around it as long as they are few; as many as are got."""
    taken = cells_taken(session)
    free = {w.cell: w for w in waiting if w.cell not in taken}
    for first in free.values():
        if (first.due or not only_due) and (cells := claim.take(_around(first, free), session)):
            return cells
    return set()


def _around(first: Waiting, free: Mapping[int, Waiting]) -> set[int]:
    """A cell and those of the others around it that are solved with it."""
    cells, touched = {first.cell}, first.touched
    edge = [] if first.suspect else [first.cell]
    while edge and len(cells) < MOST_CELLS:
        for cell in beside(edge.pop(0)):
            near = free.get(cell)
            if near is None or near.suspect or cell in cells or touched + near.touched > MOST_TOUCHED:
                continue
            if len(cells) < MOST_CELLS:
                cells.add(cell)
                touched += near.touched
                edge.append(cell)
    return cells


def _propose(session: Session, marked: Marked) -> Proposal:
    solved = solve_around(session, marked.touched) if marked.touched else None
    return Proposal.of(session, marked.marks, marked.combined, solved)


def _write(session: Session, proposal: Proposal, tolerance_sigmas: float) -> list[int]:
    """Write the slopes of the rows that are shown, and which of their passes are accepted; ids whose slope changed."""
    solution, shown = proposal.solution, proposal.shown
    if solution is None:
        return []
    around, result = solution.around, solution.result
    gone = shown & (around.drives >= 0)
    if result is None:
        return clear_slopes(session, around.ids[gone].tolist())
    solved = np.flatnonzero(solution.subnetwork.solved)
    usable = np.isfinite(result.slope_percent) & np.isfinite(result.slope_sigma_percent) & shown[solved]
    rows = solved[usable]
    gone[rows] = False
    mine = set(around.ids[shown].tolist())
    turned = [(p, good) for p, good in solution.accepted() if p.factor.segment in mine and p.accepted != good]
    set_accepted(session, [p for p, good in turned if good], [p for p, good in turned if not good])
    drives = solution.accepted_drives()
    ids = around.ids[rows].tolist()
    counts = [drives[segment] for segment in ids]
    changed = write_slopes(session, ids, counts, result, usable, tolerance_sigmas)
    return [*clear_slopes(session, around.ids[gone].tolist()), *changed]
