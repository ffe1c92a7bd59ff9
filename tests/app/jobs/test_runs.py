"""What becomes of a job: by its task, its errors and its past."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.core.db import Sessions, make_engine
from app.jobs import runs
from app.jobs.computations import Liveness, Signs
from app.jobs.connector import EngineConnector
from app.jobs.runs import LEEWAY_S, LONGEST_PAUSE_S, MAX_DEATHS, Runs, make_queue
from app.jobs.task import Interrupted, Kind, Task, Work, add_job
from fusion.errors import FusionError

ARGUMENTS = {"drive_id": "x", "generation": 3}


class Queue:
    """Tasks that do as they are told, and what was done about them."""

    def __init__(self, url: str, sessions: Sessions, folder: Path) -> None:
        self.url, self.sessions = url, sessions
        self.runs = Runs(Liveness(sessions, Signs(folder)), limit_s=3600.0)
        self.said: list[tuple[Any, ...]] = []
        self.kinds = (Kind("plain"), Kind("urgent", priority=5))

    def task(self, kind: Kind, does: Callable[[Work], None]) -> Task:
        def run(work: Work, **arguments: Any) -> str:
            self.said.append((kind.name, arguments))
            does(work)
            return "done"

        return Task(
            kind,
            run,
            give_up=lambda *why, **arguments: self.said.append(("given up", *why, arguments)),
            put_back=lambda **arguments: self.said.append(("put back", arguments)),
            subject="drive",
            advice="Split it.",
        )

    def add(self, *kinds: Kind, once: bool = False) -> int:
        with self.sessions.begin() as session:
            for kind in kinds:
                add_job(session, kind, lock="x", **ARGUMENTS)
            if once:
                session.execute(text("UPDATE procrastinate_jobs SET queueing_lock = 'solve'"))
            return int(session.execute(text("SELECT max(id) FROM procrastinate_jobs")).scalar_one())

    def work(self, does: Callable[[Work], None] = lambda _: None) -> list[tuple[Any, ...]]:
        """Everything that is to be done now; returns what was said."""
        engine = make_engine(self.url)
        queue = make_queue(EngineConnector(engine), [self.task(kind, does) for kind in self.kinds], self.runs)

        async def once() -> None:
            async with queue.open_async():
                await queue.run_worker_async(
                    wait=False, install_signal_handlers=False, delete_jobs="successful"
                )

        asyncio.run(once())
        engine.dispose()
        said, self.said = self.said, []
        return said

    def jobs(self) -> list[tuple[str, int]]:
        query = """
            SELECT status::text, coalesce(ceil(extract(epoch FROM scheduled_at - now())), 0)::int
            FROM procrastinate_jobs ORDER BY id
        """
        with self.sessions() as session:
            return [tuple(row) for row in session.execute(text(query))]


@pytest.fixture
def queue(database_url: str, sessions: Sessions, tmp_path: Path) -> Queue:
    return Queue(database_url, sessions, tmp_path)


def test_every_task_of_the_list_is_run_the_urgent_first(queue: Queue) -> None:
    queue.add(*queue.kinds)
    assert queue.work() == [("urgent", ARGUMENTS), ("plain", ARGUMENTS)]
    assert queue.jobs() == []


def test_a_job_whose_worker_stops_is_run_again_at_once(queue: Queue) -> None:
    job = queue.add(queue.kinds[0])

    def stop(work: Work) -> None:
        if not queue.runs.stopping.is_set():
            queue.runs.stopping.set()
            assert work.should_stop()
            raise Interrupted

    assert len(queue.work(stop)) == 2
    assert queue.jobs() == []
    assert job not in queue.runs.current


def lose(_: Work) -> None:
    raise OperationalError("x", {}, Exception())


@pytest.mark.parametrize(("attempts", "pause_s"), [(0, 1), (5, 32), (200, LONGEST_PAUSE_S)])
def test_a_job_that_loses_the_database_is_run_later_however_often(
    queue: Queue, attempts: int, pause_s: int
) -> None:
    queue.add(queue.kinds[0])
    with queue.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET attempts = :n"), {"n": attempts})
    assert queue.work(lose) == [("plain", ARGUMENTS)]
    ((status, waits_s),) = queue.jobs()
    assert status == "todo"
    assert 0 <= pause_s - waits_s <= 5


def test_a_statement_that_a_stop_cancelled_puts_the_job_back(queue: Queue) -> None:
    queue.add(queue.kinds[0])

    def cancelled(work: Work) -> None:
        if not queue.runs.stopping.is_set():
            queue.runs.stopping.set()
            lose(work)

    assert [said[0] for said in queue.work(cancelled)] == ["plain", "put back", "plain"]


@pytest.mark.parametrize("how", ["stops", "loses"])
def test_a_job_of_which_one_is_enough_is_asked_for_anew(
    queue: Queue, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another waits by then: going back would break the queue's rule, and the job would be nobody's for ever."""
    monkeypatch.setattr(runs, "ONCE_AGAIN_S", 0.0)
    queue.add(queue.kinds[0], once=True)

    def cut_off(_: Work) -> None:
        if len(queue.said) == 1:
            queue.add(queue.kinds[1], once=True)
            if how == "loses":
                lose(_)
            raise Interrupted

    assert [said[0] for said in queue.work(cut_off)] == ["plain", "put back", "urgent"]
    assert queue.jobs() == []


class OwnError(FusionError):
    """A failure in a task's own words."""

    kind = "own"


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (OwnError("No roads."), "own", "No roads."),
        (MemoryError(), "out-of-memory", "Split it."),
        (ZeroDivisionError(), "internal", "ZeroDivisionError"),
    ],
)
def test_no_task_fails_silently(
    queue: Queue, error: Exception, kind: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    queue.add(queue.kinds[0])

    def fail(_: Work) -> None:
        raise error

    _, (word, found, reason, arguments) = queue.work(fail)
    assert (word, found, arguments) == ("given up", kind, ARGUMENTS)
    assert words in reason
    assert queue.jobs() == [("failed", 0)]
    assert "(plain) failed" in caplog.text


@pytest.mark.parametrize("deaths", [MAX_DEATHS - 1, MAX_DEATHS])
def test_a_job_that_its_workers_die_of_is_given_up(queue: Queue, deaths: int) -> None:
    job = queue.add(queue.kinds[0])
    with queue.sessions.begin() as session:
        session.execute(text("INSERT INTO computations VALUES (:job, :n)"), {"job": job, "n": deaths})
    (said,) = queue.work()
    if deaths < MAX_DEATHS:
        assert said == ("plain", ARGUMENTS)
    else:
        why = (
            f"The worker died {MAX_DEATHS} times while it processed this drive, most likely for lack of memory. "
            "Split it."
        )
        assert said == ("given up", "interrupted", why, ARGUMENTS)
    with queue.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM computations")).scalar_one() == 0
    assert queue.jobs() == []


def test_a_run_beyond_its_limit_is_told_so(queue: Queue) -> None:
    queue.add(queue.kinds[0])
    queue.runs.limit_s = 0.0

    def look(work: Work) -> None:
        work.should_stop()

    _, (word, kind, reason, _) = queue.work(look)
    assert (word, kind) == ("given up", "too-long")
    assert "took longer than" in reason


def test_a_run_just_beyond_a_short_limit_may_still_look(queue: Queue) -> None:
    """Its process, which may hold other work, is given up only when it doesn't look for seconds."""
    queue.add(queue.kinds[0])
    queue.runs.limit_s = 1e-6
    overdue: list[list[int]] = []

    def linger(_: Work) -> None:
        (run,) = queue.runs.current.values()
        overdue.append([late.job for late in queue.runs.overdue()])
        queue.runs.current[run.job] = replace(run, began_s=run.began_s - 2 * LEEWAY_S)
        overdue.append([late.job for late in queue.runs.overdue()])

    queue.work(linger)
    none, late = overdue
    assert none == []
    assert len(late) == 1


class Much:
    """What a run holds, in a cycle, as such are collected late."""

    def __init__(self) -> None:
        self.itself = self


def test_a_run_that_wanted_too_much_memory_holds_none_of_it_when_its_error_has_been_told(
    queue: Queue,
) -> None:
    queue.add(queue.kinds[0])
    held: list[weakref.ref[Much]] = []
    errors: list[MemoryError] = []

    def take(_: Work) -> None:
        much = Much()
        held.append(weakref.ref(much))
        errors.append(MemoryError())
        raise errors[0]

    assert [said[1] for said in queue.work(take) if said[0] == "given up"] == ["out-of-memory"]
    assert held[0]() is None
