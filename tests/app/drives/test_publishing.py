"""How long what a drive says may wait to be solved, and how drives come to their end."""

from __future__ import annotations

import uuid
from collections.abc import Callable

from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives import publishing, queue
from app.drives import store as drives
from app.network import marks
from app.network.swap import solve_marked
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import append, new_drive, passes_of

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


def test_many_squares_wait_longer(sessions: Sessions) -> None:
    wait(sessions, 0)
    with sessions.begin() as session:
        session.execute(
            text("INSERT INTO network_marks (cell, touched, combined, due_at) "
                 "SELECT k, '{}', '{}', now() FROM generate_series(1, 200) AS k")
        )  # fmt: skip
    assert patience(sessions, behind=False) == 200 * publishing.SOLVING_S


def test_a_drive_is_done_once_all_its_squares_are_solved(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table, blobs = chain(), BlobStore("memory://blobs")
    drive = new_drive(sessions)
    append(sessions, drive, segment_ids, passes_of(table, dict.fromkeys(range(10), (2.0, 0.5))))
    with sessions.begin() as session:
        drives.mark_publishing(
            session, drive, report={}, bounds=(8, 49, 9, 50), epochs=5, distance_m=None, drive_time=None
        )
        cells = [one.cell for one in marks.waiting_cells(session)]
    assert len(cells) == 2
    assert publishing.finish(sessions, blobs) == 0
    with sessions.begin() as session:  # one of the squares has been solved by somebody else
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


def test_squares_wait_no_longer_than_drives_do(
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
