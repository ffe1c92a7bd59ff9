"""What is marked, solved and put in the place of what stood there: on a snapshot, outside of any lock.

A solver takes cells for itself, reads in one snapshot, solves, and writes in one short transaction, if no other has
written in those cells since; else it does all again with what came. It may die at any moment: the marks stay.
"""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.telemetry.logs import tell
from app.core.telemetry.measures import CELLS_SOLVED, SOLVE_S, SQUARES_SOLVED, SWAP_CONFLICTS
from app.network.cells import beside, cells_over, lock_cells, raise_versions, unsettle, versions_of
from app.network.condensed import AT_ONCE, condense, condensed_by_drive, portions
from app.network.locks import CellClaims, cell_claims, try_share_network
from app.network.marks import Marked, Waiting, count_cells, marked_in, note_try, take_away, waiting_cells
from app.network.passes import partitions_of, set_accepted
from app.network.publish import refresh_aggregates
from app.network.slopes import clear_slopes, write_slopes
from app.network.solve import Solution, solve_around
from fusion.types import Bools, Progress, no_progress

logger = logging.getLogger(__name__)

TOLERANCE_SIGMAS = 1e-3
"""Smaller changes are not written: what is stored stays within it of what was found, however often."""

MOST_CELLS = 16
"""Cells solved together: those of a drive of ten kilometres."""
MOST_TOUCHED = 4000
"""Touched segments, each as often as it was marked, after which no further cell is taken."""

_TRIES = 20
_PAUSE_S = 0.02
"""Before another try, a few times as long each: swaps take some tens of milliseconds."""
_IMPORT_PAUSE_S = 0.2
"""Imports own the network again and again, for a tenth of a second."""
_LOCK_WAIT = text("SET LOCAL lock_timeout = '50ms'")
"""Cells are had at once or not at all; rows of their segments are theirs. What is left is whoever writes beside the
service, and two that make the row of the same cell."""
_OTHERS_WRITE = frozenset({"55P03", "40P01"})
"""PostgreSQL's codes for a lock that was not had in time, and for two that waited for each other."""


def _nobody() -> None:
    """Tells nobody."""


class BusyError(Exception):
    """Others were quicker again and again; what was to be written is still marked."""


@dataclass(frozen=True)
class Found:
    """What one snapshot yielded, and what has to stand as it did there when it is written."""

    marks: list[int]
    combined: set[int]
    solution: Solution | None
    shown: Bools
    versions: dict[int, int] = field(default_factory=dict)
    """Of all cells in which anything of it is shown; imports raise those in which they change a road, too."""


def solve_marked(
    sessions: Sessions,
    *,
    only_due: bool = True,
    more: Callable[[], None] = _nobody,
    published: Callable[[], object] = _nobody,
) -> int:
    """Take marked cells that no other solver has, solve and publish them; of how many.

    ``only_due``: nothing is begun where no mark is due; then all that is marked near by is taken along. ``more`` is
    called before anything is solved if there is work for another solver, ``published`` when the map is up to date and
    only old passes are left to be summed.
    """
    with cell_claims(sessions) as claims:
        with sessions() as session:
            waiting = waiting_cells(session)
        cells = _take(claims, waiting, only_due)
        if cells:
            if any((w.due or not only_due) and w.cell not in cells for w in waiting):
                more()
            with sessions.begin() as session:
                note_try(session, cells)
            publish_cells(sessions, cells, published)
    return len(cells)


def publish_cells(
    sessions: Sessions, cells: Collection[int], published: Callable[[], object] = _nobody
) -> None:
    """Solve all that is marked in these cells, which the caller has taken, and swap it in."""
    for attempt in range(_TRIES):
        started_s = time.monotonic()
        with snapshot(sessions) as session:
            found = _find(session, marked_in(session, cells))
        if swap(sessions, found):
            log_solution("marked", found, len(cells), time.monotonic() - started_s, attempt + 1)
            published()
            condense_old_passes(sessions, found)
            return
        SWAP_CONFLICTS.count("marked")
        logger.debug("%d cells changed while they were solved; again", len(cells))
        time.sleep(_PAUSE_S * random.uniform(0.5, 1.5) * min(attempt + 1, 5))  # noqa: S311 - no secret
        _await_network(sessions)
    raise BusyError(f"{_TRIES} times others wrote in the same cells first")


def log_solution(kind: str, found: Found, cells: int, took_s: float, tries: int) -> None:
    """Count and log what was solved and written; which cells it was is nobody's business: somebody drove there."""
    SOLVE_S.observe(took_s, kind)
    CELLS_SOLVED.count(kind, by=cells)
    SQUARES_SOLVED.count(kind, by=cells)
    segments = 0 if found.solution is None else int(found.shown.sum())
    marks = len(found.marks) or None
    tell(
        logger,
        "cells solved",
        kind=kind,
        cells=cells,
        segments=segments,
        marks=marks,
        tries=tries,
        seconds=took_s,
    )


def _await_network(sessions: Sessions) -> None:
    """Until no import owns the network: what is solved meanwhile is out of date when it ends."""
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
    """Solve until nothing is marked any more, beside other solvers; what they have taken is waited for."""
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
            logger.info("cells that others write in are tried again", exc_info=True)
            continue
        if not solved:
            time.sleep(_PAUSE_S)


def shown_cells(
    session: Session, solution: Solution, shown: Bools, combined: Collection[int]
) -> dict[int, int]:
    """The cells in which rows that are ``shown`` and combined segments lie, and their versions."""
    return versions_of(session, cells_over(session, {*solution.around.ids[shown].tolist(), *combined}))


def swap(
    sessions: Sessions, found: Found, tolerance_sigmas: float = TOLERANCE_SIGMAS, *, settled: bool = False
) -> bool:
    """Write what was found, in one short transaction; False: it is out of date, or others are writing there just now.

    Cells of which anything shown changed get a new version, and are noted as not ``settled``, with those around.
    """
    try:
        with sessions.begin() as session:
            session.execute(_LOCK_WAIT)
            if not try_share_network(session):
                return False
            if lock_cells(session, found.versions) != found.versions:
                return False
            solved = (
                ()
                if found.solution is None
                else _write(session, found.solution, found.shown, tolerance_sigmas)
            )
            changed = refresh_aggregates(session, [*solved, *found.combined])
            cells = cells_over(session, changed) if changed else []
            raise_versions(session, cells)
            if not settled:
                unsettle(session, cells)
            take_away(session, found.marks)
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) in _OTHERS_WRITE:
            return False
        raise
    return True


def condense_old_passes(sessions: Sessions, found: Found) -> None:
    """After a swap: what the solution had beyond the juries of its segments goes into their sums, as it counted there.

    Where others are in the way it is left to the next solution, which reads that much more.
    """
    old = [] if found.solution is None else found.solution.old_passes(found.shown)
    if not old:
        return
    try:
        with sessions() as session:
            made = condensed_by_drive(session, old)
            partitions = partitions_of(session, {p.factor.segment for p in old})
        for portion in portions(old, AT_ONCE):
            with sessions.begin() as session:
                session.execute(_LOCK_WAIT)
                if try_share_network(session):
                    condense(session, portion, made, partitions)
    except OperationalError as error:
        if getattr(error.orig, "sqlstate", None) not in _OTHERS_WRITE:
            raise
        logger.debug("others were in the way of sums over %d passes", len(old))


def _take(claims: CellClaims, waiting: list[Waiting], only_due: bool) -> set[int]:
    """The first cell that can be had, and marked ones about it as long as they are few."""
    marked = {w.cell: w for w in waiting}
    for first in waiting:
        if (first.due or not only_due) and claims.take(first.cell):
            break
    else:
        return set()
    edge, touched = [] if first.suspect else [first.cell], first.touched
    while edge and len(claims.cells) < MOST_CELLS:
        for cell in beside(edge.pop(0)):
            near = marked.get(cell)
            if near is None or near.suspect or cell in claims.cells or touched + near.touched > MOST_TOUCHED:
                continue
            if len(claims.cells) < MOST_CELLS and claims.take(cell):
                touched += near.touched
                edge.append(cell)
    return claims.cells


def _find(session: Session, marked: Marked) -> Found:
    if not marked.touched:
        versions = versions_of(session, cells_over(session, marked.combined))
        return Found(marked.marks, marked.combined, None, np.zeros(0, bool), versions)
    solution, shown = solve_around(session, marked.touched)
    versions = shown_cells(session, solution, shown, marked.combined)
    return Found(marked.marks, marked.combined, solution, shown, versions)


def _write(session: Session, solution: Solution, shown: Bools, tolerance_sigmas: float) -> list[int]:
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
    turned = [(p, good) for p, good in heard if p.accepted != good]
    set_accepted(session, [p for p, good in turned if good], [p for p, good in turned if not good])
    drives = solution.accepted_drives()
    ids = around.ids[rows].tolist()
    counts = [drives[segment] for segment in ids]
    changed = write_slopes(session, ids, counts, result, usable, tolerance_sigmas)
    return [*clear_slopes(session, around.ids[gone].tolist()), *changed]
