"""A worker that is asked to stop ends, whatever its job does; and no job is blamed for it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.core.settings import Settings
from app.jobs.computations import Signs, charge_dead
from app.jobs.task import Kind, add_job
from app.jobs.worker import SIGNS
from job_worker import LOCK

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 60.0

Process = subprocess.Popen[bytes]
StartWorker = Callable[..., AbstractContextManager[Process]]


@pytest.fixture
def start_worker(database_url: str, tmp_path: Path, sessions: Sessions) -> StartWorker:
    """``start_worker(**settings)``: a worker with tasks that misbehave, killed at the end of the block."""
    with sessions.begin() as session:
        session.execute(text("CREATE TABLE happened (what text)"))

    @contextmanager
    def start(data_dir: str = "none", **changes: float) -> Iterator[Process]:
        settings = Settings(
            database_url=database_url, data_dir=tmp_path / data_dir, **({"grace_s": 2.0} | changes)
        )
        program = [sys.executable, "tests/support/job_worker.py", settings.model_dump_json()]
        with subprocess.Popen(program, cwd=REPOSITORY, env={"PYTHONPATH": str(REPOSITORY)}) as process:
            try:
                yield process
            finally:
                process.kill()

    return start


@pytest.fixture
def locked(sessions: Sessions) -> Iterator[None]:
    """Somebody holds the lock that others wait for."""
    with sessions.begin() as session:
        session.execute(text(f"SELECT pg_advisory_xact_lock({LOCK})"))
        yield


def happened(sessions: Sessions) -> list[str]:
    with sessions() as session:
        return list(session.execute(text("SELECT what FROM happened")).scalars())


def await_it(sessions: Sessions, what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while what not in happened(sessions):
        assert time.monotonic() < deadline, happened(sessions)
        time.sleep(0.02)


def queue(sessions: Sessions, name: str) -> int:
    with sessions.begin() as session:
        add_job(session, Kind(name))
        return int(session.execute(text("SELECT max(id) FROM procrastinate_jobs")).scalar_one())


def deaths(sessions: Sessions, folder: Path) -> int:
    """How many are counted once another worker has looked."""
    charge_dead(sessions, Signs(folder / "none" / SIGNS))
    with sessions() as session:
        return int(session.execute(text("SELECT coalesce(sum(deaths), 0) FROM computations")).scalar_one())


def job_states(sessions: Sessions) -> list[tuple[str, str]]:
    query = "SELECT task_name, status::text FROM procrastinate_jobs ORDER BY id"
    with sessions() as session:
        return [tuple(row) for row in session.execute(text(query))]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("name", ["loop", "deaf", "lock"])
def test_a_worker_ends_when_it_is_asked_to(
    sessions: Sessions,
    start_worker: StartWorker,
    locked: None,
    tmp_path: Path,
    name: str,
    number: signal.Signals,
) -> None:
    queue(sessions, name)
    with start_worker() as process:
        await_it(sessions, f"{name} runs")
        process.send_signal(number)
        assert process.wait(PATIENCE_S) == 0
    assert job_states(sessions) == [(name, "todo")]
    assert happened(sessions)[1:] == ([] if name == "loop" else [f"{name} put back"])
    assert deaths(sessions, tmp_path) == 0
    with sessions.begin() as session:
        waits = text("SELECT scheduled_at IS NULL OR scheduled_at <= now() FROM procrastinate_jobs")
        assert session.execute(waits).scalar_one()


def test_a_chore_that_waits_keeps_no_worker(
    sessions: Sessions, start_worker: StartWorker, locked: None
) -> None:
    with start_worker("chore") as process:
        await_it(sessions, "chore runs")
        process.terminate()
        assert process.wait(PATIENCE_S) == 0


def test_a_job_is_innocent_when_its_worker_is_killed_after_it_was_asked_to_stop(
    sessions: Sessions, start_worker: StartWorker, tmp_path: Path
) -> None:
    queue(sessions, "deaf")
    with start_worker(grace_s=600.0) as process:
        await_it(sessions, "deaf runs")
        marked = text("SELECT since IS NOT NULL FROM computations")
        with sessions() as session:
            assert session.execute(marked).scalar_one()
        process.terminate()
        deadline = time.monotonic() + PATIENCE_S
        while True:
            with sessions() as session:
                if not session.execute(marked).scalar_one():
                    break
            assert time.monotonic() < deadline
        process.kill()
        process.wait(PATIENCE_S)
    assert job_states(sessions) == [("deaf", "doing")]
    assert deaths(sessions, tmp_path) == 0


def test_nobody_takes_a_job_from_a_worker_that_is_still_at_it_though_asked_to_stop(
    sessions: Sessions, start_worker: StartWorker
) -> None:
    queue(sessions, "long")
    signs = {"heartbeat_interval_s": 0.25, "stalled_after_s": 2.0}
    with start_worker(grace_s=60.0, **signs) as process:
        await_it(sessions, "long runs")
        with start_worker(**signs) as other:
            process.terminate()
            assert process.wait(PATIENCE_S) == 0
            other.terminate()
            assert other.wait(PATIENCE_S) == 0
    assert happened(sessions) == ["long runs"]
    assert job_states(sessions) == []


def test_a_job_that_takes_too_long_is_given_up_and_its_process_with_it(
    sessions: Sessions, start_worker: StartWorker
) -> None:
    queue(sessions, "deaf")
    with start_worker(run_limit_s=1.0) as process:
        assert process.wait(PATIENCE_S) == 1
    assert job_states(sessions) == [("deaf", "failed")]
    (_, given_up) = happened(sessions)
    assert given_up.startswith("deaf given up, too-long: ")
    assert "took longer than the 1 s" in given_up
    assert "VERSANT_RUN_LIMIT_S" in given_up


def test_a_worker_goes_on_after_a_job_that_looks_and_takes_too_long(
    sessions: Sessions, start_worker: StartWorker
) -> None:
    for name in ("loop", "quick"):
        queue(sessions, name)
    with start_worker(run_limit_s=1.0) as process:
        await_it(sessions, "quick runs")
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
    assert job_states(sessions) == [("loop", "failed")]
    assert happened(sessions)[1].startswith("loop given up, too-long: ")
