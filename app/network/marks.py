"""What waits to be solved: marks, made by whoever changes what the map rests on, taken away by whoever has solved it.

A mark names segments of one cell. A drive is published once no mark of it is left, but for cells that are given up:
those keep their marks, and are tried ever more rarely.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

# A segment that is gone needs no mark: the roads around it have theirs.
_APPEND = text(
    """
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
    """
)
_WAITING = text(
    """
    SELECT cell, min(due_at) <= clock_timestamp() AS due, sum(cardinality(touched)) AS touched,
           max(tries) >= :patience AS suspect
    FROM network_marks GROUP BY cell ORDER BY min(due_at), cell
    """
)
# A solver that dies leaves what it began with. What kills one after the other is left alone longer and longer: the
# whole cell, whenever its marks came. (Beyond 2 ^ 20 the pause has long been the longest.)
_TRY = text(
    """
    UPDATE network_marks AS m
    SET tries = known.tries + 1, due_at = CASE WHEN known.tries >= :patience
        THEN clock_timestamp()
            + make_interval(secs => least(:longest_s, :pause_s * 2 ^ least(known.tries - :patience, 20)))
        ELSE m.due_at END
    FROM (SELECT cell, max(tries) AS tries FROM network_marks WHERE cell = ANY(CAST(:cells AS integer[]))
          GROUP BY cell) AS known
    WHERE m.cell = known.cell
    """
)
_ANY_DUE = text("SELECT EXISTS (SELECT FROM network_marks WHERE due_at <= clock_timestamp())")
_COUNT_CELLS = text("SELECT count(DISTINCT cell) FROM network_marks")
_ANY_HOPE = text("SELECT EXISTS (SELECT FROM network_marks WHERE tries <= :patience)")
_IN_CELLS = text(
    "SELECT id, touched, combined FROM network_marks WHERE cell = ANY(CAST(:cells AS integer[])) ORDER BY id"
)
_STILL_THERE = text("SELECT id FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))")
_TAKE_AWAY = text("DELETE FROM network_marks WHERE id = ANY(CAST(:ids AS bigint[]))")
_MAKE_DUE = text(
    "UPDATE network_marks SET due_at = clock_timestamp() WHERE due_at > clock_timestamp() AND tries < :patience"
)


PATIENCE = 2
"""Marks that so many solvers have begun with and none has ended are solved by themselves, and ever more rarely."""
PAUSE_S, LONGEST_PAUSE_S = 30.0, 3600.0
GIVEN_UP = 7
"""A drive waits no longer for a cell with which so many solvers have begun: six have done so in vain, in seven and a
half minutes. Workers and databases that are started again are back by then, and who waits for a drive still does."""


class MarkedBy(NamedTuple):
    """A drive, and the run of it that made marks."""

    drive_id: uuid.UUID
    generation: int


class Waiting(NamedTuple):
    """A cell with marks: whether any is due, how many segments are touched, each as often as it was, and whether
    solvers have begun with it in vain."""

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
    """Let the network be solved around ``touched`` segments, and what is published of the ``combined`` be renewed.

    It may wait for ``delay_s``. Returns the cells; none where no such segment is there.
    """
    values = {
        "drive_id": None if by is None else by.drive_id,
        "generation": None if by is None else by.generation,
        "touched": sorted(touched),
        "combined": sorted(set(combined) - set(touched)),
        "delay_s": delay_s,
    }
    return list(session.execute(_APPEND, values).scalars())


def waiting_cells(session: Session) -> list[Waiting]:
    """All cells with marks, those that are due the longest first."""
    return [Waiting(*row) for row in session.execute(_WAITING, {"patience": PATIENCE})]


def note_try(session: Session, cells: Collection[int]) -> None:
    """A solver begins with these cells; if it does not come to an end, another will, later and later."""
    pause = {"patience": PATIENCE, "pause_s": PAUSE_S, "longest_s": LONGEST_PAUSE_S}
    session.execute(_TRY, {"cells": sorted(cells), **pause})


def any_due(session: Session) -> bool:
    """Whether there is anything to be solved by now."""
    return bool(session.execute(_ANY_DUE).scalar_one())


def count_cells(session: Session) -> int:
    """How many cells have marks."""
    return int(session.execute(_COUNT_CELLS).scalar_one())


def any_hope(session: Session) -> bool:
    """Whether anything is marked but cells with which solvers have begun in vain again and again."""
    return bool(session.execute(_ANY_HOPE, {"patience": PATIENCE}).scalar_one())


def make_due(session: Session) -> None:
    """Let nothing wait any longer but what solvers have begun with in vain."""
    session.execute(_MAKE_DUE, {"patience": PATIENCE})


def marked_in(session: Session, cells: Collection[int]) -> Marked:
    """What waits in these cells, but for segments that an import has taken away since."""
    rows = session.execute(_IN_CELLS, {"cells": sorted(cells)}).all()
    touched = {segment for row in rows for segment in row.touched}
    combined = {segment for row in rows for segment in row.combined}
    there = set(session.execute(_STILL_THERE, {"ids": [*touched, *combined]}).scalars())
    return Marked([row.id for row in rows], touched & there, combined & there)


def take_away(session: Session, marks: Sequence[int]) -> None:
    """What these marks stand for is done."""
    if marks:
        session.execute(_TAKE_AWAY, {"ids": list(marks)})
