"""Marks of what waits to be solved: made by whoever changes evidence or roads, deleted by whoever has solved them.

A mark names segments of one cell. A drive is published once none of its marks is left, except in cells that are given
up: those keep their marks and are retried ever more rarely.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import bigints

# A segment that was deleted needs no mark: the roads around it have theirs.
_APPEND = text("""
    INSERT INTO network_marks (cell, drive_id, generation, touched, combined, due_at)
    SELECT s.cell, CAST(:drive_id AS uuid), CAST(:generation AS integer),
           coalesce(array_agg(DISTINCT s.id) FILTER (WHERE m.network), '{}'),
           coalesce(array_agg(DISTINCT s.id) FILTER (WHERE NOT m.network), '{}'),
           clock_timestamp() + make_interval(secs => :delay_s)
    FROM (SELECT unnest(CAST(:touched AS bigint[])) AS id, true AS network
          UNION ALL SELECT unnest(CAST(:combined AS bigint[])), false) AS m
    JOIN segments AS s ON s.id = m.id
    GROUP BY s.cell ORDER BY s.cell
    RETURNING cell
""")
_WAITING = text("""
    SELECT cell, min(due_at) <= clock_timestamp() AS due, sum(cardinality(touched)) AS touched,
           max(tries) >= :patience AS suspect
    FROM network_marks GROUP BY cell ORDER BY min(due_at), cell
""")
# A solver that dies leaves the marks that it began. A cell that kills one solver after the other is retried with longer
# and longer pauses, whenever its marks were made. (Beyond 2 ^ 20 the pause has long been the longest.)
_TRY = text("""
    UPDATE network_marks AS m
    SET tries = worst.tries + 1, due_at = CASE WHEN worst.tries >= :patience
        THEN clock_timestamp()
            + make_interval(secs => least(:longest_s, :pause_s * 2 ^ least(worst.tries - :patience, 20)))
        ELSE m.due_at END
    FROM (SELECT cell, max(tries) AS tries FROM network_marks WHERE cell = ANY(CAST(:cells AS integer[]))
          GROUP BY cell) AS worst
    WHERE m.cell = worst.cell
""")
_ANY_DUE = text("SELECT EXISTS (SELECT FROM network_marks WHERE due_at <= clock_timestamp())")
_COUNT_CELLS = text("SELECT count(DISTINCT cell) FROM network_marks")
_ANY_SOLVABLE = text("SELECT EXISTS (SELECT FROM network_marks WHERE tries <= :patience)")
_IN_CELLS = text(
    "SELECT id, touched, combined FROM network_marks WHERE cell = ANY(CAST(:cells AS integer[])) ORDER BY id"
)
_STILL_THERE = text("SELECT id FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))")
_DELETE = text("DELETE FROM network_marks WHERE id = ANY(CAST(:ids AS bigint[]))")
_MAKE_DUE = text(
    "UPDATE network_marks SET due_at = clock_timestamp() WHERE due_at > clock_timestamp() AND tries < :patience"
)


PATIENCE = 2
"""Cells that so many solvers have begun and none has finished are solved alone, and retried ever more rarely."""
PAUSE_S, LONGEST_PAUSE_S = 30.0, 3600.0
GIVEN_UP = 7
"""A drive stops waiting for a cell that so many solvers have begun: six of them failed, in seven and a half minutes.
Restarted workers and databases are back by then, and whoever waits for the drive still does."""


class MarkedBy(NamedTuple):
    """A drive, and the generation of it that made marks."""

    drive_id: uuid.UUID
    generation: int


class Waiting(NamedTuple):
    """A cell with marks: whether any is due, how many segments are touched, each counted as often as it is marked, and
    whether solvers have failed to solve it."""

    cell: int
    due: bool
    touched: int
    suspect: bool


@dataclass(frozen=True)
class Marked:
    """What waits in some cells."""

    marks: list[int]
    touched: set[int]
    combined: set[int]


def append_marks(
    session: Session,
    touched: Collection[int],
    combined: Collection[int] = (),
    by: MarkedBy | None = None,
    delay_s: float = 0.0,
) -> list[int]:
    """Mark ``touched`` segments to be solved again, and ``combined`` ones to be published again, within ``delay_s``.

    Returns the cells that are marked; none where no such segment exists.
    """
    values = {
        "drive_id": None if by is None else by.drive_id,
        "generation": None if by is None else by.generation,
        "touched": bigints(sorted(touched)),
        "combined": bigints(sorted(set(combined) - set(touched))),
        "delay_s": delay_s,
    }
    return list(session.execute(_APPEND, values).scalars())


def waiting_cells(session: Session) -> list[Waiting]:
    """All cells with marks, those that have been due longest first."""
    return [Waiting(*row) for row in session.execute(_WAITING, {"patience": PATIENCE})]


def note_try(session: Session, cells: Collection[int]) -> None:
    """Note that a solver begins these cells; if it does not finish, another retries, later and later."""
    pause = {"patience": PATIENCE, "pause_s": PAUSE_S, "longest_s": LONGEST_PAUSE_S}
    session.execute(_TRY, {"cells": sorted(cells), **pause})


def any_due(session: Session) -> bool:
    """Whether any mark is due."""
    return bool(session.execute(_ANY_DUE).scalar_one())


def count_cells(session: Session) -> int:
    """How many cells have marks."""
    return int(session.execute(_COUNT_CELLS).scalar_one())


def any_solvable(session: Session) -> bool:
    """Whether any cell is marked that solvers have not repeatedly failed to solve."""
    return bool(session.execute(_ANY_SOLVABLE, {"patience": PATIENCE}).scalar_one())


def make_due(session: Session) -> None:
    """Make all marks due, except in cells that solvers have failed to solve."""
    session.execute(_MAKE_DUE, {"patience": PATIENCE})


def marked_in(session: Session, cells: Collection[int]) -> Marked:
    """What waits in these cells, without segments that an import has deleted since."""
    rows = session.execute(_IN_CELLS, {"cells": sorted(cells)}).all()
    touched = {segment for row in rows for segment in row.touched}
    combined = {segment for row in rows for segment in row.combined}
    there = set(session.execute(_STILL_THERE, {"ids": bigints(touched | combined)}).scalars().all())
    return Marked([row.id for row in rows], touched & there, combined & there)


def delete_marks(session: Session, marks: Sequence[int]) -> None:
    """Delete marks whose segments are solved and published."""
    if marks:
        session.execute(_DELETE, {"ids": list(marks)})
