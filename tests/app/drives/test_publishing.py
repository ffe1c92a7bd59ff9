"""How long what a drive says may wait to be solved, and how drives come to their end."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Collection

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives import claims, publishing, queue
from app.drives import store as drives
from app.drives.documents import Drive
from app.network import cells, marks, swap
from app.network.swap import solve_marked
from app.ops import metrics, stats
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import append, new_drive, passes_of, rows_of

EVERY_S = 30.0


def patience(sessions: Sessions, *, behind: bool) -> float:
    with sessions() as session:
        return publishing.patience_s(session, EVERY_S, behind=behind)


def wait(sessions: Sessions, priority: int) -> None:
    """A drive waits in the queue."""
    with sessions.begin() as session:
        queue.enqueue(session, uuid.uuid4(), 1)
        session.execute(text("UPDATE procrastinate_jobs SET priority = :p"), {"p": priority})


def test_slopes_wait_only_while_drives_do(sessions: Sessions) -> None:
    assert patience(sessions, behind=False) == patience(sessions, behind=True) == 0.0
    wait(sessions, queue.BEHIND)
    assert patience(sessions, behind=False) == 0.0  # an upload goes before any batch
    assert patience(sessions, behind=True) == EVERY_S


def test_uploads_that_wait_let_the_others_slopes_wait(sessions: Sessions) -> None:
    wait(sessions, 0)
    assert patience(sessions, behind=False) == EVERY_S


def test_many_cells_wait_longer(sessions: Sessions) -> None:
    wait(sessions, 0)
    with sessions.begin() as session:
        session.execute(
            text("INSERT INTO network_marks (cell, touched, combined, due_at) "
                 "SELECT k, '{}', '{}', now() FROM generate_series(1, 200) AS k")
        )  # fmt: skip
    assert patience(sessions, behind=False) == 200 * publishing.SOLVING_S


def test_a_drive_is_done_once_all_its_cells_are_solved(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table, blobs = chain(), BlobStore("memory://blobs")
    drive = new_drive(sessions)
    append(sessions, drive, segment_ids, passes_of(table, dict.fromkeys(range(10), (2.0, 0.5))))
    with sessions.begin() as session:
        claims.mark_publishing(
            session, drive, report={}, bounds=(8, 49, 9, 50), epochs=5, distance_m=None, drive_time=None
        )
        cells = [one.cell for one in marks.waiting_cells(session)]
    assert len(cells) == 2
    assert publishing.finish(sessions, blobs) == 0
    with sessions.begin() as session:  # one of the cells has been solved by somebody else
        session.execute(text("DELETE FROM network_marks WHERE cell = :cell"), {"cell": cells[0]})
    assert publishing.finish(sessions, blobs) == 0
    assert solve_marked(sessions) == 1
    assert publishing.finish(sessions, blobs) == 1
    with sessions() as session:
        done = drives.get_drive(session, drive)
    assert done is not None
    assert (done.status, done.stage, done.progress) == ("done", None, 1.0)


def test_nobody_is_asked_twice_and_somebody_where_nobody_was(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    def solvers() -> int:
        with sessions() as session:
            query = text("SELECT count(*) FROM procrastinate_jobs WHERE task_name = 'solve'")
            return int(session.execute(query).scalar_one())

    publishing.look_after(sessions, BlobStore("memory://blobs"))
    assert solvers() == 0
    append(sessions, new_drive(sessions), segment_ids, passes_of(chain(), {0: (2.0, 0.5)}))
    for _ in range(2):
        publishing.look_after(sessions, BlobStore("memory://blobs"))
        assert solvers() == 1


def test_cells_wait_no_longer_than_drives_do(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    append(sessions, new_drive(sessions), segment_ids, passes_of(chain(), {0: (2.0, 0.5)}))
    later = "UPDATE network_marks SET due_at = now() + interval '1 hour', tries = :tries"
    wait(sessions, queue.BEHIND)
    for tries, due in ((0, True), (marks.PATIENCE, False)):
        with sessions.begin() as session:
            session.execute(text(later), {"tries": tries})
        publishing.look_after(sessions, BlobStore("memory://blobs"))
        with sessions.begin() as session:
            assert not marks.any_due(session)
            session.execute(text("UPDATE procrastinate_jobs SET status = 'succeeded'"))
        publishing.look_after(sessions, BlobStore("memory://blobs"))
        with sessions.begin() as session:
            assert marks.any_due(session) == due
            session.execute(text("DELETE FROM procrastinate_jobs"))
        wait(sessions, queue.BEHIND)


# --- cells that no solver can solve ---------------------------------------------------------------------------

Driven = tuple[RoadTable, Ints]
STORE = "memory://blobs"


class Failing:
    """A solver that cannot bear some segments."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, sessions: Sessions, heavy: Collection[int]) -> None:
        self.sessions, self.heavy = sessions, set(heavy)
        self.genuine = swap.solve_around
        monkeypatch.setattr(swap, "solve_around", self.solve)

    def solve(self, session: Session, touched: Collection[int]) -> object:
        if self.heavy & set(touched):
            raise MemoryError
        return self.genuine(session, touched)

    def times(self, count: int) -> None:
        """So many solvers fail, as if each had waited for as long as it has to; others solve the rest first."""
        while count:
            with self.sessions.begin() as session:
                session.execute(text("UPDATE network_marks SET due_at = now() WHERE tries > 0"))
            try:
                assert solve_marked(self.sessions)
            except MemoryError:
                count -= 1


def publishing_drive(sessions: Sessions, streets: Driven, rows: Collection[int]) -> uuid.UUID:
    table, ids = streets
    drive = new_drive(sessions)
    append(sessions, drive, ids, passes_of(table, dict.fromkeys(rows, (2.0, 0.5))))
    with sessions.begin() as session:
        claims.mark_publishing(
            session,
            drive,
            report={"warnings": ["w"]},
            bounds=(8, 49, 9, 50),
            epochs=5,
            distance_m=None,
            drive_time=None,
        )
    return drive


def shown(sessions: Sessions, drive: uuid.UUID) -> Drive:
    with sessions() as session:
        found = drives.get_drive(session, drive)
    assert found is not None
    return found


def test_a_cell_that_no_solver_can_solve_keeps_no_drive_for_ever(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It did, and nothing but the log told so."""
    ids = streets_apart[1]
    drive = publishing_drive(sessions, streets_apart, range(16))
    with sessions() as session:
        waiting = [one.cell for one in marks.waiting_cells(session)]
    failing = Failing(monkeypatch, sessions, ids[:8].tolist())
    failing.times(marks.PATIENCE)
    publishing.finish(sessions, BlobStore(STORE))
    assert shown(sessions, drive).unsolved == []  # what happens once or twice is nobody's concern
    failing.times(1)
    publishing.finish(sessions, BlobStore(STORE))
    early = shown(sessions, drive)
    assert (early.status, early.stage) == ("running", "publishing")
    (cell,) = early.unsolved
    assert cell in {cells.cell_name(cell) for cell in waiting}
    assert early.report is not None
    assert early.report["warnings"][0] == "w"
    assert cell in early.report["warnings"][1]
    failing.times(marks.GIVEN_UP - marks.PATIENCE - 1)
    assert publishing.finish(sessions, BlobStore(STORE)) == 1
    late = shown(sessions, drive)
    assert (late.status, late.stage, late.progress, late.unsolved) == ("done", None, 1.0, [cell])
    assert late.report is not None
    assert "are not published yet" in late.report["warnings"][-1]
    assert rows_of(sessions).keys() == set(ids[8:].tolist())
    monkeypatch.undo()  # whatever it was is mended
    swap.solve_all_marked(sessions)
    mended = shown(sessions, drive)
    assert (mended.status, mended.unsolved) == ("done", [])
    assert mended.report is not None
    assert mended.report["warnings"] == ["w"]
    assert len(rows_of(sessions)) == 16


def test_operators_are_told_which_cell_it_is_and_who_waits(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    ids = streets_apart[1]
    drive = publishing_drive(sessions, streets_apart, range(16))
    failing = Failing(monkeypatch, sessions, ids[:8].tolist())
    failing.times(marks.PATIENCE + 1)
    with sessions() as session:
        figures, gauges = stats.read_stats(session), metrics.read_gauges(session)
        (x, y) = session.execute(
            text(
                "SELECT ST_X(p), ST_Y(p) FROM (SELECT ST_StartPoint(geom) AS p FROM segments WHERE id = :id) AS s"
            ),
            {"id": int(ids[4])},
        ).one()
    assert (figures.cells_waiting, figures.cells_unsolved) == (1, 1)
    assert (gauges.plain["cells_waiting"], gauges.plain["cells_unsolved"]) == (1, 1)
    (one,) = figures.unsolved
    assert [one.cell] == shown(sessions, drive).unsolved
    assert (one.solvers, one.drives) == (marks.PATIENCE + 1, [drive])
    assert one.since < one.next_at
    west, south, east, north = one.bbox
    assert west < x < east
    assert south < y < north
    assert str(marks.PATIENCE) in one.advice


def test_what_comes_later_waits_as_its_cell_does(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else each new drive would have its own six solvers killed."""
    failing = Failing(monkeypatch, sessions, streets_apart[1][:8].tolist())
    publishing_drive(sessions, streets_apart, range(8))
    failing.times(marks.GIVEN_UP)
    publishing.finish(sessions, BlobStore(STORE))
    later = publishing_drive(sessions, streets_apart, range(8))
    with pytest.raises(MemoryError):  # something new came, which may be what was missing
        solve_marked(sessions)
    assert solve_marked(sessions) == 0
    assert publishing.finish(sessions, BlobStore(STORE)) == 1
    assert shown(sessions, later).status == "done"


def test_a_removed_drive_stays_until_nothing_of_it_is_shown(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = publishing_drive(sessions, streets_apart, range(8))
    solve_marked(sessions)
    publishing.finish(sessions, BlobStore(STORE))
    with sessions.begin() as session:
        generation = drives.request_removal(session, drive)
    assert generation is not None
    failing = Failing(monkeypatch, sessions, streets_apart[1][:8].tolist())
    publishing.remove(sessions, BlobStore(STORE), drive, generation)
    failing.times(marks.GIVEN_UP)
    assert publishing.finish(sessions, BlobStore(STORE)) == 0
    with sessions() as session:
        assert drives.get_drive(session, drive) is None  # to nobody
        kept = session.execute(
            text("SELECT status, stage, filename, report FROM drives WHERE id = :id"), {"id": drive}
        )
        assert kept.one() == ("cancelled", "removing", "", None)
    monkeypatch.undo()
    swap.solve_all_marked(sessions)
    assert publishing.finish(sessions, BlobStore(STORE)) == 1


def test_one_hopeless_cell_keeps_no_other_from_being_settled(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publishing, "SETTLE_AFTER_S", 0.0)
    publishing_drive(sessions, streets_apart, range(16))
    assert not publishing.settle_quietly(sessions)
    Failing(monkeypatch, sessions, streets_apart[1][:8].tolist()).times(marks.PATIENCE + 1)
    assert publishing.settle_quietly(sessions)


def test_however_often_it_was_tried_it_is_tried_again(sessions: Sessions) -> None:
    """Powers of two end at a thousand."""
    with sessions.begin() as session:
        session.execute(
            text(
                "INSERT INTO network_marks (cell, touched, combined, due_at, tries) VALUES (7, '{}', '{}', now(), 2000)"
            )
        )
        marks.note_try(session, [7])
        wait = text("SELECT extract(epoch FROM due_at - now()) FROM network_marks")
        assert float(session.execute(wait).scalar_one()) == pytest.approx(marks.LONGEST_PAUSE_S, abs=5)
