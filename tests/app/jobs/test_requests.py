"""What every kind of request keeps to: one row, one run at a time, put back, failed, given a job again."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.core.errors import BusyError
from app.core.settings import Settings
from app.drives.worker import REQUESTS
from app.jobs.context import JobContext
from app.jobs.requests import run, upkeep
from app.jobs.requests.run import Discarded, RequestKind, RequestRun, fail, perform
from app.jobs.requests.store import Failure
from app.jobs.task import Interrupted, Work
from network_support import new_drive

COLUMNS: dict[str, Callable[[Sessions], dict[str, Any]]] = {
    "export": lambda _: {"request": {}, "request_sha256": "ab", "file_name": "a.csv", "media_type": "text/csv"},
    "operation": lambda _: {"kind": "settle", "subject": "the network", "request": {}},
    "trial": lambda sessions: {
        "drive_id": new_drive(sessions), "method": "raw", "options": {}, "asked_sha256": "ab"
    },
}  # fmt: skip
"""What a row of each kind needs beside the columns that all have."""

Kind = RequestKind[Any]
WORK = Work(should_stop=lambda: False, computing=nullcontext)


@pytest.fixture
def context(tmp_path: Path, database_url: str, sessions: Sessions) -> JobContext:
    return JobContext(Settings(data_dir=tmp_path, database_url=database_url), sessions)


@pytest.fixture(params=REQUESTS, ids=lambda kind: kind.store.name)
def kind(request: pytest.FixtureRequest) -> Kind:
    chosen: Kind = request.param
    return chosen


@pytest.fixture
def number(kind: Kind, sessions: Sessions) -> uuid.UUID:
    """Of one that was just asked for."""
    columns = COLUMNS[kind.store.name](sessions)
    with sessions.begin() as session:
        number: uuid.UUID = kind.store.add(session, **columns).id
        return number


def row_of(kind: Kind, sessions: Sessions, number: uuid.UUID) -> Any:
    with sessions() as session:
        return kind.store.get(session, number)


def jobs(sessions: Sessions) -> int:
    with sessions() as session:
        return int(
            session.execute(
                text("SELECT count(*) FROM procrastinate_jobs WHERE status = 'todo'")
            ).scalar_one()
        )


def test_every_kind_is_tried_here() -> None:
    assert {kind.store.name for kind in REQUESTS} == set(COLUMNS)


def test_a_row_and_its_job_come_together(kind: Kind, sessions: Sessions, number: uuid.UUID) -> None:
    assert row_of(kind, sessions, number).status == "queued" and jobs(sessions) == 1
    columns = COLUMNS[kind.store.name](sessions)
    with pytest.raises(RuntimeError), sessions.begin() as session:
        kind.store.add(session, **columns)
        raise RuntimeError
    assert jobs(sessions) == 1


def test_so_many_wait_and_no_more(kind: Kind, sessions: Sessions, number: uuid.UUID) -> None:
    with sessions() as session:
        kind.store.require_place(session, 2)
        with pytest.raises(BusyError, match=f"1 {kind.store.plural} wait already"):
            kind.store.require_place(session, 1)


def test_a_second_run_takes_it_from_the_first(kind: Kind, sessions: Sessions, number: uuid.UUID) -> None:
    with sessions.begin() as session:
        first, second = kind.store.claim(session, number), kind.store.claim(session, number)
        assert first is not None and second is not None and second.run == first.run + 1
        assert not kind.store.update(session, first, progress=0.5)
        assert kind.store.update(session, second, progress=0.5)
        assert not kind.store.finish(session, first)
        assert kind.store.finish(session, second)
        assert kind.store.claim(session, number) is None
    assert row_of(kind, sessions, number).status == "done"


def test_work_that_is_interrupted_waits_again(kind: Kind, context: JobContext, number: uuid.UUID) -> None:
    def cut_off(run: RequestRun[Any]) -> str:
        run.folder.mkdir(parents=True)
        raise Interrupted

    with pytest.raises(Interrupted):
        perform(replace(kind, work=cut_off), context, number, WORK)
    assert row_of(kind, context.sessions, number).status == "queued"
    assert list(context.scratch(kind.folder).iterdir()) == []


def test_a_result_that_nobody_wants_is_dropped(kind: Kind, context: JobContext, number: uuid.UUID) -> None:
    def too_late(run: RequestRun[Any]) -> str:
        with context.sessions.begin() as session:
            kind.store.claim(session, number)
        with pytest.raises(Discarded):
            run.show("reading", 0.5)
        raise Discarded

    assert perform(replace(kind, work=too_late), context, number, WORK) == "unwanted"
    assert row_of(kind, context.sessions, number).status == "running"  # the other run's


def test_a_failure_is_said_once(kind: Kind, context: JobContext, number: uuid.UUID) -> None:
    def wrong(run: RequestRun[Any]) -> str:
        raise ZeroDivisionError

    expected = replace(
        kind, work=wrong, failure=lambda *_: Failure("impossible", "There is nothing to divide.")
    )
    assert perform(expected, context, number, WORK) == "failed"
    failed = row_of(kind, context.sessions, number)
    assert (failed.status, failed.failure.reason) == ("failed", "There is nothing to divide.")
    fail(kind, context, number, Failure("later", "Too late."))
    assert row_of(kind, context.sessions, number).failure.reason == "There is nothing to divide."
    with pytest.raises(ZeroDivisionError):  # what nobody expects goes to the log, by the worker
        again = replace(kind, work=wrong, failure=lambda *_: None)
        with context.sessions.begin() as session:
            kind.store.write(session, number, status="queued")
        perform(again, context, number, WORK)


def test_one_that_lost_its_job_gets_another(kind: Kind, context: JobContext, number: uuid.UUID) -> None:
    with context.sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_jobs"))
    upkeep.look_after(kind, context)
    assert jobs(context.sessions) == 1
    upkeep.look_after(kind, context)
    assert jobs(context.sessions) == 1


def test_short_stages_are_not_shown_but_the_last_is(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s, shown = [100.0], list[tuple[str | None, float]]()
    monkeypatch.setattr(run.time, "monotonic", lambda: now_s[0])

    def write(_session: Any, stage: str | None, share: float) -> bool:
        shown.append((stage, share))
        return True

    progress = run.Progress(sessions, lambda: False, write)
    for after_s, stage, share in [
        (0.0, "reading", 0.0),
        (0.1, "roads", 0.1),  # short: not shown
        (0.15, "match", 0.2),
        (0.25, "match", 0.3),
        (0.4, "match", 0.4),  # the same stage again, too early
        (0.8, "match", 0.5),
    ]:
        now_s[0] = 100.0 + after_s
        progress.show(stage, share)
        assert progress.stage == stage
    assert shown == [("reading", 0.0), ("match", 0.3), ("match", 0.5)]
