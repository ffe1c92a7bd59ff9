"""Lanes as processes: what they share, and what becomes of them when one of them or their parents end."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from app.cli import children
from app.cli.lanes import Forked
from app.core.db import Sessions
from app.core.settings import Settings
from app.jobs.task import Kind, add_job

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 120.0
AT_REST_MB = 150
"""Of a lane (PSS): it has some 85; each for itself had 211."""
OF_ITS_OWN_MB = 60
"""Of a lane (not shared with any other process): some 7."""

pytestmark = pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="Linux tells")


class Worker:
    """A running ``versant worker`` with two lanes."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def nursery(self) -> int | None:
        """The process that the lanes are forked from."""
        return next(iter(children_of(self.process.pid)), None)

    def lanes(self) -> set[int]:
        nursery = self.nursery()
        return set() if nursery is None else {pid for pid in children_of(nursery) if has_begun(pid)}

    def await_lanes(self, but: Callable[[set[int]], bool] = lambda lanes: False) -> set[int]:
        """Two that have begun to work, and are not those."""
        deadline = time.monotonic() + PATIENCE_S
        while len(found := self.lanes()) != 2 or but(found):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        return found


def children_of(pid: int) -> set[int]:
    with contextlib.suppress(OSError):
        return set(map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))
    return set()


def has_begun(pid: int) -> bool:
    """Whether it has a session of its own and threads beside its first: the queue's."""
    with contextlib.suppress(OSError):
        return os.getsid(pid) == pid and len(list(Path(f"/proc/{pid}/task").iterdir())) > 1
    return False


def megabytes(pid: int, *names: str) -> int:
    told = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(re.findall(rf"^{name}:\s+(\d+) kB", told, re.MULTILINE)[0]) for name in names) // 1024


def await_gone(pids: set[int]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.1)


@pytest.fixture
def worker(database_url: str, tmp_path: Path) -> Iterator[Worker]:
    settings = Settings(database_url=database_url, data_dir=tmp_path, worker_concurrency=2, grace_s=2.0)
    with subprocess.Popen(
        [sys.executable, "-m", "app.cli", "worker"],
        cwd=REPOSITORY,
        env=children.child_environment(settings),
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield Worker(process)
        finally:
            process.kill()


@pytest.mark.slow
def test_lanes_share_what_they_have_loaded_and_one_that_ends_is_started_again(worker: Worker) -> None:
    first = worker.await_lanes()
    time.sleep(1.0)  # the chores have been done once
    for pid in first:
        assert 0 < megabytes(pid, "Pss") < AT_REST_MB
        assert megabytes(pid, "Private_Clean", "Private_Dirty") < OF_ITS_OWN_MB

    os.kill(max(first), signal.SIGKILL)
    second = worker.await_lanes(but=lambda lanes: lanes == first)
    assert len(second & first) == 1
    nursery = worker.nursery()
    assert nursery is not None
    worker.process.terminate()
    _, log = worker.process.communicate(timeout=PATIENCE_S)
    assert worker.process.returncode == 0
    assert re.search(r"the worker [12] ended with status -9", log)
    assert not [pid for pid in {nursery, *second} if Path(f"/proc/{pid}").exists()]


@pytest.mark.slow
def test_lanes_come_again_after_the_process_they_were_forked_from_and_end_with_a_killed_worker(
    worker: Worker,
) -> None:
    first, nursery = worker.await_lanes(), worker.nursery()
    assert nursery is not None
    os.kill(nursery, signal.SIGKILL)
    await_gone(first)
    lanes, nursery = worker.await_lanes(), worker.nursery()
    assert lanes.isdisjoint(first)
    assert nursery is not None
    worker.process.kill()
    await_gone({nursery, *lanes})


def waited_s(sessions: Sessions, jobs: int) -> list[float]:
    """How long so many jobs waited that came one by one to lanes without work."""
    began = text("""
        SELECT extract(epoch FROM s.at - d.at)::float8 FROM procrastinate_events AS d
        JOIN procrastinate_events AS s ON s.job_id = d.job_id AND s.type = 'started'
        WHERE d.type = 'deferred' ORDER BY d.at
    """)
    for number in range(1, jobs + 1):
        time.sleep(0.3 + 0.07 * number)
        with sessions.begin() as session:
            add_job(session, Kind("nobody knows it"))  # so it fails, and what happened to it is kept
        deadline, waited = time.monotonic() + 10.0, list[float]()
        while len(waited) < number:
            assert time.monotonic() < deadline
            time.sleep(0.05)
            with sessions() as session:
                waited = list(session.execute(began).scalars())
    return waited


def connections(sessions: Sessions, seconds: float) -> Counter[str]:
    """The most that there were at once beside one's own, by the name that they give."""
    query = text("""
        SELECT application_name, count(*) AS connections FROM pg_stat_activity
        WHERE datname = current_database() AND pid <> pg_backend_pid() GROUP BY 1
    """)
    most: Counter[str] = Counter()
    until_s = time.monotonic() + seconds
    with sessions() as session:
        while time.monotonic() < until_s:
            most |= Counter({row.application_name: row.connections for row in session.execute(query)})
            session.rollback()
            time.sleep(0.02)
    return most


@pytest.mark.long("two lanes are loaded, and watched while they rest")
def test_a_job_begins_at_once_and_idle_lanes_have_one_connection_each(
    worker: Worker, sessions: Sessions
) -> None:
    worker.await_lanes()
    time.sleep(3.0)  # the chores have been done once
    assert statistics.median(waited_s(sessions, 7)) < 0.1
    listener = connections(sessions, 0.1)["versant listener"]
    assert listener == 1
    # The chores of the first lane look for work, and may do so at the same time.
    samples = [connections(sessions, 0.1)["versant"] for _ in range(40)]
    assert statistics.median(samples) <= 2


@pytest.mark.long("two lanes are loaded, and wait for their listener")
def test_lanes_hear_again_when_the_listeners_connection_was_cut(worker: Worker, sessions: Sessions) -> None:
    worker.await_lanes()
    cut = text("SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE application_name = :name")
    with sessions() as session:
        deadline = time.monotonic() + PATIENCE_S
        while not session.execute(cut, {"name": "versant listener"}).scalar_one():
            assert time.monotonic() < deadline
            time.sleep(0.1)
    deadline = time.monotonic() + PATIENCE_S
    while not connections(sessions, 0.1)["versant listener"]:
        assert time.monotonic() < deadline
    assert statistics.median(waited_s(sessions, 5)) < 0.1


@pytest.mark.slow
def test_nothing_is_begun_before_the_fork_that_it_would_cut_in_two() -> None:
    """No thread of Python's or Arrow's, no OpenMP; and what is loaded comes from the cache."""
    program = """
import os, threading
from app.cli import compiling, lanes
before = len(os.listdir("/proc/self/task"))
compiling.compile_ahead(first=True)
done = compiling.is_compiled(first=True)
""" + (
        "pid = os.fork()\n"  # what compiles is another process
        "if pid == 0:\n"
        "    compiling.load()\n"
        "    from numba.np.ufunc import parallel\n"
        "    from fusion.roads.grid import project_point\n"
        "    threads = len(os.listdir('/proc/self/task'))\n"
        "    print(done, threading.active_count(), threads <= before, parallel._is_initialized, flush=True)\n"
        "    os._exit(0)\n"
        "os.waitpid(pid, 0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "1", "True", "False"]


def test_what_is_forked_ends_as_a_process_does(capfd: pytest.CaptureFixture[str]) -> None:
    def fails() -> int:
        raise ValueError("no such lane")

    def sleeps() -> int:
        time.sleep(PATIENCE_S)
        return 0

    assert Forked(lambda: 7).wait(PATIENCE_S) == 7
    assert Forked(fails).wait(PATIENCE_S) == 1
    assert "no such lane" in capfd.readouterr().err
    sleeping = Forked(sleeps)
    assert sleeping.poll() is None
    with pytest.raises(subprocess.TimeoutExpired):
        sleeping.wait(0.1)
    sleeping.terminate()
    assert sleeping.wait(PATIENCE_S) == -signal.SIGTERM
    sleeping.kill()  # is gone: nobody else is meant
