"""Whose fault the death of a worker is."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.jobs.computations import Liveness, charge, forget_gone

REPOSITORY = Path(__file__).resolve().parents[3]
_PROGRAM = """
import sys, time
from app.jobs.computations import Liveness
liveness = Liveness(sys.argv[1])
with liveness.computing(7):
    if sys.argv[2] == "computes":
        print("ready", flush=True)
        time.sleep(600)
print("ready", flush=True)
time.sleep(600)
"""

_CUT = text(
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'versant liveness'"
    " AND datname = current_database()"
)

Dies = Callable[[str], None]


@pytest.fixture
def dies(database_url: str) -> Dies:
    """``dies(while it "computes" or "waits")``: a process that has to do with job 7 is killed."""

    def kill(meanwhile: str) -> None:
        command = [sys.executable, "-c", _PROGRAM, database_url, meanwhile]
        with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            process.kill()

    return kill


def deaths(sessions: Sessions) -> int:
    """How many are counted against job 7 once its worker was found to be silent."""
    await_backends(sessions)
    with sessions.begin() as session:
        return charge(session, 7)


def await_backends(sessions: Sessions) -> None:
    """The server notices within milliseconds that a client is gone; wait for it."""
    query = text(
        "SELECT count(*) FROM pg_stat_activity"
        " WHERE application_name = 'versant liveness' AND datname = current_database()"
    )
    deadline = time.monotonic() + 1.0
    while time.monotonic() < deadline:
        with sessions() as session:
            if session.execute(query).scalar_one() == 0:
                return


def test_a_death_counts_while_the_job_is_computed(sessions: Sessions, dies: Dies) -> None:
    for count in (1, 2):
        dies("computes")
        assert deaths(sessions) == count
        assert deaths(sessions) == 0, "another worker that looks as well counts it again"
    with sessions() as session:
        assert session.execute(text("SELECT deaths FROM computations")).scalar_one() == 2


def test_a_death_does_not_count_while_the_job_waits(sessions: Sessions, dies: Dies) -> None:
    dies("waits")
    assert deaths(sessions) == 0


def test_a_death_does_not_count_when_the_server_was_away(sessions: Sessions, dies: Dies) -> None:
    dies("computes")
    with sessions.begin() as session:
        session.execute(text("UPDATE computations SET since = pg_postmaster_start_time() - interval '1 s'"))
    assert deaths(sessions) == 0


def test_who_is_silent_and_lives_did_not_die(sessions: Sessions, database_url: str) -> None:
    liveness = Liveness(database_url)
    with liveness.computing(7), sessions.begin() as session:
        assert charge(session, 7) == 0
    liveness.close()


def test_a_stopping_process_blames_nobody(sessions: Sessions, database_url: str) -> None:
    liveness = Liveness(database_url)
    with liveness.computing(7):
        liveness.stop()
        with liveness.computing(8):
            liveness.close()
            assert deaths(sessions) == 0
            with sessions() as session:
                assert session.execute(text("SELECT job_id, since FROM computations")).all() == [(7, None)]
    liveness.close()


def test_a_mark_goes_although_its_connection_was_cut(sessions: Sessions, database_url: str) -> None:
    liveness = Liveness(database_url)
    with liveness.computing(7), sessions() as session:
        assert session.execute(_CUT).scalar_one()
    liveness.close()
    assert deaths(sessions) == 0


def test_who_was_cut_off_and_computes_on_did_not_die(sessions: Sessions, database_url: str) -> None:
    liveness = Liveness(database_url)
    with liveness.computing(7):
        with sessions() as session:
            assert session.execute(_CUT).scalar_one()
        liveness.look()
        assert deaths(sessions) == 0
        liveness.look()
        with sessions() as session:
            marked = text("SELECT since FROM computations WHERE since IS NOT NULL")
            assert session.execute(marked).first() is None, "whoever looks after it has taken it"
    liveness.close()


def test_the_end_of_an_old_run_leaves_the_mark_of_a_new_one(sessions: Sessions, database_url: str) -> None:
    old, new = Liveness(database_url), Liveness(database_url)
    with old.computing(7):
        begun = new.computing(7)
        begun.__enter__()
    with sessions() as session:
        assert session.execute(text("SELECT since IS NOT NULL FROM computations")).scalar_one()
    begun.__exit__(None, None, None)
    new.forget(7)
    with sessions() as session:
        assert session.execute(text("SELECT count(*) FROM computations")).scalar_one() == 0
    old.close()
    new.close()


def test_what_is_left_of_jobs_that_are_gone_goes(sessions: Sessions, database_url: str) -> None:
    """A job's end that the database could not be told of."""
    liveness = Liveness(database_url)
    with sessions.begin() as session:
        waits = add_waiting_job(session)
    for job in (7, waits):
        with liveness.computing(job):
            pass
    liveness.close()
    with sessions.begin() as session:
        forget_gone(session)
        assert session.execute(text("SELECT job_id FROM computations")).scalars().all() == [waits]


def add_waiting_job(session: Session) -> int:
    """A job in the queue; its number, which is not 7."""
    add = text("INSERT INTO procrastinate_jobs (id, queue_name, task_name) VALUES (8, 'q', 'x') RETURNING id")
    return int(session.execute(add).scalar_one())
