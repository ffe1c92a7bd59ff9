"""Whose fault the death of a worker is."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.settings.places import libpq_url
from app.jobs.computations import Liveness, Signs, charge_dead, forget_gone

REPOSITORY = Path(__file__).resolve().parents[3]
_PROGRAM = """
import sys, time
from pathlib import Path
from app.core.db import make_engine, session_factory
from app.jobs.computations import Signs
from app.jobs.computations import Liveness
signs = Signs(Path(sys.argv[3]))
signs.begin()
liveness = Liveness(session_factory(make_engine(sys.argv[1])), signs)
with liveness.computing(7):
    if sys.argv[2] == "computes":
        print("ready", flush=True)
        time.sleep(600)
print("ready", flush=True)
time.sleep(600)
"""

_CUT = (
    "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity"
    " WHERE datname = current_database() AND pid <> pg_backend_pid()"
)

Dies = Callable[[str], None]


@pytest.fixture
def signs(tmp_path: Path) -> Signs:
    return Signs(tmp_path)


@pytest.fixture
def liveness(sessions: Sessions, signs: Signs) -> Iterator[Liveness]:
    """That of this process."""
    signs.begin()
    yield Liveness(sessions, signs)
    signs.end()


@pytest.fixture
def dies(database_url: str, tmp_path: Path) -> Dies:
    """``dies(while it "computes" or "waits")``: a process that has to do with job 7 is killed."""

    def kill(meanwhile: str) -> None:
        command = [sys.executable, "-c", _PROGRAM, database_url, meanwhile, str(tmp_path)]
        with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            process.kill()

    return kill


def cut_off(url: str) -> None:
    """End all connections to the database."""
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        assert connection.execute(_CUT).fetchone() != (0,)


def deaths(sessions: Sessions, signs: Signs) -> int:
    """How many are counted against job 7 once a worker of the machine has looked."""
    charge_dead(sessions, signs)
    with sessions() as session:
        return session.execute(text("SELECT deaths FROM computations WHERE job_id = 7")).scalar() or 0


def test_a_death_counts_while_the_job_is_computed(sessions: Sessions, signs: Signs, dies: Dies) -> None:
    for count in (1, 2):
        dies("computes")
        assert deaths(sessions, signs) == count
        assert deaths(sessions, signs) == count, "another worker that looks as well counts it again"


def test_a_death_does_not_count_while_the_job_waits(sessions: Sessions, signs: Signs, dies: Dies) -> None:
    dies("waits")
    assert deaths(sessions, signs) == 0


def test_a_death_does_not_count_when_the_server_was_away(
    sessions: Sessions, signs: Signs, dies: Dies
) -> None:
    dies("computes")
    with sessions.begin() as session:
        session.execute(text("UPDATE computations SET since = pg_postmaster_start_time() - interval '1 s'"))
    assert deaths(sessions, signs) == 0


def test_a_death_is_not_the_fault_of_what_another_machine_computes(
    sessions: Sessions, signs: Signs, dies: Dies, tmp_path: Path
) -> None:
    dies("computes")
    assert deaths(sessions, Signs(tmp_path / "another machine")) == 0
    with sessions.begin() as session:  # the job has another run by now
        session.execute(text("UPDATE computations SET process = 'elsewhere'"))
    assert deaths(sessions, signs) == 0
    with sessions() as session:
        assert session.execute(text("SELECT since IS NOT NULL FROM computations")).scalar_one()


def test_what_the_dead_had_claimed_is_free(sessions: Sessions, signs: Signs, dies: Dies) -> None:
    dies("computes")
    with sessions.begin() as session:
        process = session.execute(text("SELECT process FROM computations")).scalar_one()
        claimed = "INSERT INTO claims VALUES ('cells', 1, gen_random_uuid(), :p, now() + interval '1 h')"
        for name in (process, "elsewhere"):
            session.execute(text(claimed.replace("1,", "2," if name == process else "1,")), {"p": name})
    assert charge_dead(sessions, signs) == [process]
    with sessions() as session:
        assert session.execute(text("SELECT process FROM claims")).scalars().all() == ["elsewhere"]


def test_who_lives_did_not_die(sessions: Sessions, signs: Signs, liveness: Liveness, tmp_path: Path) -> None:
    with liveness.computing(7):
        assert deaths(sessions, Signs(tmp_path)) == 0


def test_a_stopping_process_blames_nobody(sessions: Sessions, liveness: Liveness, tmp_path: Path) -> None:
    with liveness.computing(7):
        liveness.stop()
        with liveness.computing(8):
            assert deaths(sessions, Signs(tmp_path)) == 0
            with sessions() as session:
                assert session.execute(text("SELECT job_id, since FROM computations")).all() == [(7, None)]


def test_a_stopping_process_blames_nobody_though_the_database_is_away(
    sessions: Sessions, liveness: Liveness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with liveness.computing(7):
        with monkeypatch.context() as patch:
            patch.setattr(Liveness, "_clear", lambda *_: None)
            liveness.stop()
        assert deaths(sessions, Signs(tmp_path)) == 0


def test_a_mark_goes_although_its_connection_was_cut(
    sessions: Sessions, liveness: Liveness, database_url: str
) -> None:
    with liveness.computing(7):
        cut_off(database_url)
    with sessions() as session:
        assert session.execute(text("SELECT since FROM computations")).scalars().all() == [None]


def test_who_was_cut_off_and_computes_on_did_not_die(
    sessions: Sessions, liveness: Liveness, database_url: str, tmp_path: Path
) -> None:
    with liveness.computing(7):
        cut_off(database_url)
        assert deaths(sessions, Signs(tmp_path)) == 0


def test_the_end_of_an_old_run_leaves_the_mark_of_a_new_one(sessions: Sessions, liveness: Liveness) -> None:
    with liveness.computing(7), sessions.begin() as session:
        session.execute(text("UPDATE computations SET process = 'elsewhere'"))
    with sessions() as session:
        assert session.execute(text("SELECT since IS NOT NULL FROM computations")).scalar_one()
    liveness.forget(7)
    with sessions() as session:
        assert session.execute(text("SELECT count(*) FROM computations")).scalar_one() == 0


def test_what_is_left_of_jobs_that_are_gone_goes(sessions: Sessions, liveness: Liveness) -> None:
    """A job's end that the database could not be told of."""
    with sessions.begin() as session:
        waits = add_waiting_job(session)
    for job in (7, waits):
        with liveness.computing(job):
            pass
    with sessions.begin() as session:
        forget_gone(session)
        assert session.execute(text("SELECT job_id FROM computations")).scalars().all() == [waits]


def add_waiting_job(session: Session) -> int:
    """A job in the queue; its number, which is not 7."""
    add = text("INSERT INTO procrastinate_jobs (id, queue_name, task_name) VALUES (8, 'q', 'x') RETURNING id")
    return int(session.execute(add).scalar_one())
