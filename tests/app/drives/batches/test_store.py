"""Drives by the thousand through the queue: piece by piece, nothing twice, nothing in the client's memory."""

from __future__ import annotations

import re
import threading
import tracemalloc
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from sqlalchemy import Engine, event, text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.errors import BadRequestError
from app.drives import intake
from app.drives.batches import enqueuing
from app.drives.batches import store as bulk
from app.drives.batches.documents import Batch, Selection, Which
from app.drives.queue import BEHIND, enqueue
from many_drives import execute, make_drives, rows, waiting

ALL = Selection(which=Which.ALL)


@pytest.fixture
def pieces_of_three(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 3)


def progress(sessions: Sessions, batch: int | None = None) -> Batch:
    with sessions() as session:
        found = bulk.batch_progress(session, batch)
    assert found is not None
    return found


def begin(sessions: Sessions, selection: Selection = ALL, method: str | None = None) -> int:
    """A batch of which one piece is enqueued."""
    batch, _ = enqueuing.reprocess_all(sessions, selection, method, for_s=0)
    return batch


@contextmanager
def statements(sessions: Sessions) -> Iterator[list[str]]:
    """What is sent to the database meanwhile."""
    seen: list[str] = []
    with sessions() as session:
        engine = session.get_bind()
    assert isinstance(engine, Engine)

    def note(connection: object, cursor: object, statement: str, *_: object) -> None:
        seen.append(statement)

    event.listen(engine, "before_cursor_execute", note)
    yield seen
    event.remove(engine, "before_cursor_execute", note)


def test_jobs_stand_in_the_order_of_uploads_behind_them_and_without_a_lock(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    _, count = enqueuing.reprocess_all(sessions, ALL, "dem")
    assert count == 8
    assert waiting(sessions) == list(range(8))
    assert rows(sessions, "SELECT DISTINCT lock, priority FROM procrastinate_jobs") == [(None, BEHIND)]
    assert rows(sessions, "SELECT DISTINCT method, options, generation FROM drives") == [("dem", {}, 2)]


def test_without_a_method_each_drive_keeps_its_own(sessions: Sessions) -> None:
    make_drives(sessions, 2)
    enqueuing.reprocess_all(sessions, ALL, None)
    assert rows(sessions, "SELECT DISTINCT method, options FROM drives") == [("raw", {"min_epochs": 4})]


@pytest.mark.usefixtures("pieces_of_three")
def test_a_batch_that_is_cut_off_is_gone_on_with_by_a_worker(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    batch = begin(sessions)
    assert waiting(sessions) == [0, 1, 2]
    assert (progress(sessions, batch).state, progress(sessions, batch).drives) == ("enqueuing", 3)
    while enqueuing.tend(sessions):
        pass
    assert waiting(sessions) == list(range(8))
    assert (progress(sessions, batch).state, progress(sessions, batch).queued) == ("running", 8)
    assert not enqueuing.tend(sessions)


@pytest.mark.usefixtures("pieces_of_three")
def test_asking_again_goes_on_with_the_same_batch(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    batch = begin(sessions)
    other = begin(sessions, ALL, "dem")  # of another method: a batch of its own, over what does not wait yet
    assert other != batch
    assert enqueuing.reprocess_all(sessions, ALL, None) == (batch, 5)
    assert enqueuing.reprocess_all(sessions, ALL, "dem") == (other, 3)
    assert sorted(waiting(sessions)) == list(range(8))
    assert enqueuing.reprocess_all(sessions, ALL, None)[1] == 0


@pytest.mark.usefixtures("pieces_of_three")
def test_many_who_enqueue_the_same_at_once_enqueue_nothing_twice(sessions: Sessions) -> None:
    make_drives(sessions, 40)
    start = threading.Barrier(4)

    def ask(_: int) -> int:
        start.wait()
        return enqueuing.reprocess_all(sessions, ALL, None)[0]

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(ask, range(4)))
    assert sorted(waiting(sessions)) == list(range(40))
    assert rows(sessions, "SELECT count(*) FROM procrastinate_jobs") == [(40,)]
    assert rows(sessions, "SELECT sum(drives) FROM batches") == [(40,)]


def test_a_drive_that_was_asked_for_since_is_of_no_concern(sessions: Sessions, pieces_of_three: None) -> None:
    make_drives(sessions, 5)
    batch = begin(sessions)
    execute(sessions, "UPDATE drives SET generation = 7, queued_at = now() WHERE filename = 'log 3'")
    assert enqueuing.reprocess_all(sessions, ALL, None) == (batch, 4)
    assert waiting(sessions) == [0, 1, 2, 4]


def test_memory_and_statements_do_not_grow_with_the_drives(sessions: Sessions) -> None:
    make_drives(sessions, 50, days=0.001)
    enqueuing.reprocess_all(sessions, ALL, "dem")  # whatever is loaded or kept once
    make_drives(sessions, 6000, days=0.001)
    tracemalloc.start()
    with statements(sessions) as sent:
        _, count = enqueuing.reprocess_all(sessions, Selection(which=Which.ALL, from_method="raw"), "dem")
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert count == 6000
    assert peak_bytes < 2**20
    assert len(sent) < 6 + 3 * 7


def fetched_pages(sessions: Sessions) -> int:
    """How many pages fetching one job touches."""
    with sessions.begin() as session:
        worker = session.execute(
            text("SELECT worker_id FROM procrastinate_register_worker_v1()")
        ).scalar_one()
        plan = session.execute(
            text(
                "EXPLAIN (ANALYZE, BUFFERS, FORMAT TEXT) SELECT id FROM procrastinate_fetch_job_v2(NULL, :worker)"
            ),
            {"worker": worker},
        ).scalars()
        found = [int(pages) for line in plan for pages in re.findall(r"(?:hit|read)=(\d+)", line)]
    return found[0]


def test_fetching_a_job_of_a_batch_does_not_read_the_queue(sessions: Sessions) -> None:
    execute(sessions, "ANALYZE procrastinate_jobs")  # as it was while it was empty
    make_drives(sessions, 3000, days=0.001)
    enqueuing.reprocess_all(sessions, ALL, None)
    assert max(fetched_pages(sessions) for _ in range(3)) < 300


def test_a_queue_of_uploads_is_read_once_at_most_however_old_its_statistics(sessions: Sessions) -> None:
    """Each of them has a lock: without its index each would be looked for among all others."""
    execute(sessions, "ANALYZE procrastinate_jobs")
    make_drives(sessions, 2000, days=0.001)
    execute(sessions, "UPDATE drives SET status = 'queued'")
    with sessions.begin() as session:
        for drive in session.execute(text("SELECT id FROM drives")).scalars().all():
            enqueue(session, drive, 1)
    assert max(fetched_pages(sessions) for _ in range(3)) < 5 * 2000


def test_the_statistics_of_a_queue_that_grew_are_renewed(sessions: Sessions) -> None:
    make_drives(sessions, 2500, days=0.001)
    enqueuing.reprocess_all(sessions, ALL, None)
    assert rows(sessions, "SELECT reltuples >= 1000 FROM pg_class WHERE relname = 'procrastinate_jobs'") == [
        (True,)
    ]


_LOOKS = "status, stage, progress, failure_kind, failure_reason, method, options, queued_at, started_at, finished_at"


@pytest.mark.usefixtures("pieces_of_three")
def test_a_cancelled_batch_leaves_drives_as_they_were(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    query = f"SELECT filename, {_LOOKS}, batch_id, before_batch FROM drives ORDER BY filename"
    before = rows(sessions, query)
    batch, _ = enqueuing.reprocess_all(sessions, ALL, "dem")
    assert rows(sessions, query) != before
    execute(sessions, "UPDATE drives SET status = 'running', progress = 0.5 WHERE filename = 'log 0'")
    execute(
        sessions,
        "UPDATE procrastinate_jobs SET status = 'doing' WHERE id = (SELECT min(id) FROM procrastinate_jobs)",
    )
    enqueuing.cancel(sessions, batch, for_s=0)  # a request that is cut off: a worker takes out the rest
    assert len(waiting(sessions)) == 4
    while enqueuing.tend(sessions):
        pass
    assert rows(sessions, query)[1:] == before[1:]
    assert rows(sessions, "SELECT status FROM procrastinate_jobs") == [("doing",)]
    seen = progress(sessions, batch)
    assert (seen.state, seen.drives, seen.running, seen.progress) == ("cancelled", 1, 1, 0.5)
    assert rows(sessions, "SELECT status FROM drives WHERE filename = 'log 0'") == [("running",)]


@pytest.mark.usefixtures("pieces_of_three")
def test_a_batch_that_is_cancelled_while_it_is_enqueued_enqueues_no_more(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    batch = begin(sessions)
    enqueuing.cancel(sessions, batch)
    assert not enqueuing.tend(sessions)
    assert waiting(sessions) == []
    assert enqueuing.reprocess_all(sessions, ALL, None)[0] != batch
    assert len(waiting(sessions)) == 8


@pytest.mark.usefixtures("pieces_of_three")
def test_drives_without_a_job_become_a_batch_that_cannot_be_cancelled(sessions: Sessions) -> None:
    make_drives(sessions, 8)
    execute(sessions, "UPDATE drives SET status = 'queued' WHERE filename <> 'log 5'")
    assert enqueuing.give_jobs(sessions) == 7
    assert enqueuing.give_jobs(sessions) == 0
    assert waiting(sessions) == [0, 1, 2, 3, 4, 6, 7]
    (batch,) = {row[0] for row in rows(sessions, "SELECT batch_id FROM drives WHERE filename <> 'log 5'")}
    assert progress(sessions, batch).queued == progress(sessions).queued == 7
    with pytest.raises(BadRequestError, match="update of the service"):
        enqueuing.cancel(sessions, batch)


def test_a_drive_asked_for_by_itself_leaves_its_batch(sessions: Sessions) -> None:
    make_drives(sessions, 2)
    batch, _ = enqueuing.reprocess_all(sessions, ALL, None)
    ((drive,),) = rows(sessions, "SELECT id FROM drives WHERE filename = 'log 1'")
    intake.reprocess(sessions, uuid.UUID(str(drive)))
    assert progress(sessions, batch).drives == 1
    assert rows(sessions, "SELECT batch_id, before_batch FROM drives WHERE filename = 'log 1'") == [
        (None, None)
    ]


def counted(sessions: Sessions, table: str) -> list[tuple[object, ...]]:
    keys = "CAST(created_at AT TIME ZONE 'UTC' AS date), status, failure_kind, batch_id"
    sums = "count(*), sum(coalesce(distance_m, 0)), sum(size_bytes)"
    if table == "drive_counts":
        keys, sums = "day, status, failure_kind, batch_id", "sum(drives), sum(distance_m), sum(size_bytes)"
    query = f"SELECT {keys}, {sums} FROM {table} GROUP BY 1, 2, 3, 4 HAVING {sums.split(', ', maxsplit=1)[0]} <> 0"
    return sorted(rows(sessions, query), key=str)


def test_counts_are_those_of_the_drives_whatever_happens_to_them(sessions: Sessions) -> None:
    changes = (
        "UPDATE drives SET status = 'running' WHERE filename < 'log 3'",
        "UPDATE drives SET progress = 0.5, stage = 'roads' WHERE status = 'running'",
        "UPDATE drives SET distance_m = 12.5, status = 'done' WHERE filename = 'log 1'",
        "UPDATE drives SET created_at = created_at + interval '3 days', failure_kind = 'x' WHERE filename > 'log 6'",
        "DELETE FROM drives WHERE filename IN ('log 1', 'log 7')",
    )
    make_drives(sessions, 9)
    assert counted(sessions, "drive_counts") == counted(sessions, "drives") != []
    for number, change in enumerate(changes):
        ((before,),) = rows(sessions, "SELECT count(*) FROM drive_counts")
        execute(sessions, change)
        assert counted(sessions, "drive_counts") == counted(sessions, "drives")
        if number == 1:  # mere progress is not counted
            assert rows(sessions, "SELECT count(*) FROM drive_counts") == [(before,)]
    many = rows(sessions, "SELECT count(*) FROM drive_counts")
    with sessions.begin() as session:
        bulk.fold_counts(session, 1000)
    assert rows(sessions, "SELECT count(*) FROM drive_counts") == many
    with sessions.begin() as session:
        bulk.fold_counts(session, 1)
    assert counted(sessions, "drive_counts") == counted(sessions, "drives")
    assert rows(sessions, "SELECT count(*) FROM drive_counts") == [(len(counted(sessions, "drives")),)]
    execute(sessions, "DELETE FROM drives")
    with sessions.begin() as session:
        bulk.fold_counts(session, 0)
    assert rows(sessions, "SELECT count(*) FROM drive_counts") == [(0,)]


def test_two_who_add_counts_up_at_once_lose_nothing(sessions: Sessions) -> None:
    make_drives(sessions, 9)
    execute(sessions, "UPDATE drives SET status = 'done'")
    first = sessions()
    first.begin()
    bulk.fold_counts(first, 0)
    with ThreadPoolExecutor(1) as pool:

        def second() -> None:
            with sessions.begin() as session:
                bulk.fold_counts(session, 0)

        waits = pool.submit(second)
        execute(sessions, "UPDATE drives SET status = 'queued' WHERE filename < 'log 4'")
        first.commit()
        first.close()
        waits.result(timeout=30)
    assert counted(sessions, "drive_counts") == counted(sessions, "drives")


def read_of(sessions: Sessions, table: str, work: Callable[[Session], object]) -> int:
    """How many rows of the table were read by scanning it."""
    query = text("""
        SELECT seq_tup_read FROM pg_stat_xact_user_tables WHERE relname = :table AND schemaname = 'public'
    """)
    with sessions() as session:
        session.execute(text("SET enable_seqscan = off"))  # a small table is scanned because it is small
        before = session.execute(query, {"table": table}).scalar_one()
        work(session)
        return int(session.execute(query, {"table": table}).scalar_one()) - int(before)


def test_progress_reads_no_drive_but_those_that_run(sessions: Sessions) -> None:
    make_drives(sessions, 500, days=0.001)
    batch, _ = enqueuing.reprocess_all(sessions, ALL, None)
    execute(sessions, "UPDATE drives SET status = 'running', progress = 0.5 WHERE filename = 'log 7'")
    assert progress(sessions, batch).progress == pytest.approx(0.5 / 500)
    assert read_of(sessions, "drives", lambda session: bulk.batch_progress(session, batch)) == 0
    assert read_of(sessions, "drives", bulk.batch_progress) == 0
