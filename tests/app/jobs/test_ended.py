"""Jobs that ended long ago leave the queue's table, and how many there are matters to nobody."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.claims import Claim
from app.core.db import Sessions
from app.jobs import ended
from app.jobs.ended import EndedJobs
from app.jobs.task import Kind, add_job

KIND = Kind("nothing")
OLD_DAYS, YOUNG_DAYS, KEPT_DAYS = 40, 20, 30.0

MakeJob = Callable[..., int]


def worker_of(session: Session) -> int:
    """A worker that the queue lists."""
    return int(session.execute(text("SELECT worker_id FROM procrastinate_register_worker_v1()")).scalar_one())


@pytest.fixture
def make_job(sessions: Sessions) -> MakeJob:
    """``make_job(end, days, last_days)``: a job made so many days ago that went through the queue's own functions."""

    def make(end: str, days: int, last_days: int | None = None) -> int:
        with sessions.begin() as session:
            add_job(session, KIND)
            number = int(session.execute(text("SELECT max(id) FROM procrastinate_jobs")).scalar_one())
            values = {"id": number, "end": end, "worker": worker_of(session)}
            if end != "todo":
                fetch = "SELECT id FROM procrastinate_fetch_job_v2(ARRAY['drives'], :worker)"
                assert session.execute(text(fetch), values).scalar_one() == number
            if end not in {"todo", "doing"}:
                finish = (
                    "SELECT procrastinate_finish_job_v1(:id, CAST(:end AS procrastinate_job_status), false)"
                )
                session.execute(text(finish), values)
            age = "UPDATE procrastinate_events SET at = at - make_interval(days => :days) WHERE job_id = :id"
            session.execute(text(age), values | {"days": days})
            if last_days is not None:
                last = f"{age} AND id = (SELECT max(id) FROM procrastinate_events WHERE job_id = :id)"
                session.execute(text(last), values | {"days": last_days - days})
        return number

    return make


def jobs(sessions: Sessions) -> list[int]:
    with sessions() as session:
        return list(session.execute(text("SELECT id FROM procrastinate_jobs ORDER BY id")).scalars())


def events(sessions: Sessions) -> int:
    """Of jobs that are gone."""
    orphans = "SELECT count(*) FROM procrastinate_events WHERE job_id <> ALL(ARRAY(SELECT id FROM procrastinate_jobs))"
    with sessions() as session:
        return int(session.execute(text(orphans)).scalar_one())


def test_ended_ones_go_with_their_events_once_they_are_old(sessions: Sessions, make_job: MakeJob) -> None:
    staying = [make_job("doing", OLD_DAYS), make_job("failed", OLD_DAYS, YOUNG_DAYS)]
    for end in ("failed", "succeeded", "aborted"):
        make_job(end, OLD_DAYS)
    staying += [make_job("failed", YOUNG_DAYS), make_job("todo", OLD_DAYS)]

    assert not EndedJobs(sessions, KEPT_DAYS).piece()

    assert jobs(sessions) == staying
    assert events(sessions) == 0


def test_they_go_in_pieces_up_to_the_young_ones(
    sessions: Sessions, make_job: MakeJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ended, "PIECE", 2)
    old = [make_job("failed", OLD_DAYS) for _ in range(4)]
    young = [make_job("failed", YOUNG_DAYS) for _ in range(4)]
    removing = EndedJobs(sessions, KEPT_DAYS)

    assert removing.piece()
    assert jobs(sessions) == old[2:] + young
    assert removing.piece()
    assert jobs(sessions) == young
    assert not removing.piece()  # whatever is beyond is younger

    # The next look begins anew.
    with sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_events SET at = at - interval '20 days'"))
    while removing.piece():
        pass
    assert jobs(sessions) == []


def test_a_job_whose_events_somebody_deleted_is_old(sessions: Sessions, make_job: MakeJob) -> None:
    make_job("failed", YOUNG_DAYS)
    waiting = make_job("todo", YOUNG_DAYS)
    with sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_events"))

    EndedJobs(sessions, KEPT_DAYS).piece()

    assert jobs(sessions) == [waiting]


def test_one_that_is_being_put_back_is_left_and_not_waited_for(sessions: Sessions, make_job: MakeJob) -> None:
    held, other = make_job("failed", OLD_DAYS), make_job("failed", OLD_DAYS)
    with sessions.begin() as session:
        session.execute(text("SELECT procrastinate_retry_job_v2(:id, NULL, NULL, NULL, NULL)"), {"id": held})
        EndedJobs(sessions, KEPT_DAYS).piece()
        assert other not in jobs(sessions)

    EndedJobs(sessions, KEPT_DAYS).piece()
    assert jobs(sessions) == [held]


def test_one_process_at_a_time_removes_them(sessions: Sessions, make_job: MakeJob) -> None:
    job = make_job("failed", OLD_DAYS)
    with Claim(sessions, "ended jobs") as claim:
        assert claim.take()
        assert not EndedJobs(sessions, KEPT_DAYS).piece()
        assert jobs(sessions) == [job]
    EndedJobs(sessions, KEPT_DAYS).piece()
    assert jobs(sessions) == []


def test_only_running_jobs_name_their_worker(sessions: Sessions, make_job: MakeJob) -> None:
    ended_job, running, back = make_job("failed", 0), make_job("doing", 0), make_job("doing", 0)
    with sessions.begin() as session:
        session.execute(text("SELECT procrastinate_retry_job_v2(:id, NULL, NULL, NULL, NULL)"), {"id": back})
        named = "SELECT id FROM procrastinate_jobs WHERE worker_id IS NOT NULL"
        assert list(session.execute(text(named)).scalars()) == [running]
        # The queue's way: a worker that goes leaves its running job to be found, and ended ones alone.
        session.execute(text("SELECT procrastinate_prune_stalled_workers_v1(0)"))
        session.execute(text("DELETE FROM procrastinate_workers"))
        assert list(session.execute(text(named)).scalars()) == []
    assert jobs(sessions) == [ended_job, running, back]


def test_a_worker_that_goes_is_found_by_an_index(sessions: Sessions) -> None:
    with sessions.begin() as session:
        session.execute(text("SET LOCAL enable_seqscan = off"))
        # As the foreign key asks.
        plan = "EXPLAIN UPDATE ONLY procrastinate_jobs SET worker_id = NULL WHERE 7 OPERATOR(pg_catalog.=) worker_id"
        lines = session.execute(text(plan)).scalars().all()
    assert any("ix_procrastinate_jobs_worker_id" in line for line in lines), lines
