"""A worker whose loop hangs begins anew."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import Any

import procrastinate.worker
import pytest

from app.core.db import Sessions, make_engine
from app.core.settings import Settings
from app.jobs import worker as workers
from app.jobs.task import Kind, Task, Work, add_job

KIND = Kind("say")


@pytest.fixture
def said() -> list[int]:
    return []


def work(
    settings: Settings, sessions: Sessions, said: list[int], stop: threading.Event, chores: Any = ()
) -> None:
    """One lane with one task, until ``stop``, which a job of it sets."""

    def run(work: Work) -> str:
        said.append(work.priority)
        stop.set()
        return "said"

    def nothing(*_: object) -> None:
        """It is never asked for."""

    engine = make_engine(str(settings.database_url))
    worker = workers.Worker(
        settings, engine, sessions, [Task(KIND, run, nothing, nothing, subject="job", advice="")]
    )
    late = threading.Timer(60, stop.set)
    late.start()
    worker.run(chores, wait=True, stop_event=stop)
    late.cancel()
    engine.dispose()


def test_a_loop_that_asks_for_nothing_is_replaced(
    settings: Settings,
    sessions: Sessions,
    said: list[int],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    genuine, hung = procrastinate.worker.Worker._shutdown, []

    async def fails_once(self: procrastinate.worker.Worker) -> None:
        if not hung:
            raise procrastinate.exceptions.ConnectorException

        await fetch(self)

    async def misses_its_end(self: procrastinate.worker.Worker, side_tasks: list[asyncio.Task[Any]]) -> None:
        if not hung:
            hung.append(self)
            await asyncio.Event().wait()
        await genuine(self, side_tasks)

    fetch = procrastinate.worker.Worker._fetch_and_process_jobs
    monkeypatch.setattr(procrastinate.worker.Worker, "_fetch_and_process_jobs", fails_once)
    monkeypatch.setattr(procrastinate.worker.Worker, "_shutdown", misses_its_end)
    monkeypatch.setattr(workers, "SILENT_S", 1.0)
    with sessions.begin() as session:
        add_job(session, KIND)
    with caplog.at_level(logging.ERROR, "app.jobs"):
        work(settings, sessions, said, threading.Event())
    assert len(hung) == 1
    assert len(said) == 1
    assert "begins anew" in caplog.text


def test_a_job_that_takes_its_time_is_no_silence(
    settings: Settings, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = workers.make_queue(str(settings.database_url), [], None)  # type: ignore[arg-type]
    current = {1: "runs"}
    monkeypatch.setattr(workers, "SILENT_S", 0.05)

    async def look() -> None:
        waits = asyncio.create_task(workers.Watchdog(app, current).wait())
        await asyncio.sleep(0.3)
        assert not waits.done()
        current.clear()
        await asyncio.wait_for(waits, 5)

    asyncio.run(look())


def test_what_is_done_beside_goes_on_after_an_error(
    settings: Settings, sessions: Sessions, said: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    tried: list[int] = []
    stop = threading.Event()

    async def chore() -> bool:
        tried.append(1)
        if len(tried) == 2:
            raise AssertionError("at once")
        if len(tried) == 4:
            stop.set()
        return False

    work(settings, sessions, said, stop, ((chore, 0.05),))
    assert len(tried) >= 4
    assert "at once" in caplog.text
