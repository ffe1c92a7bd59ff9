"""Trials that are cut off: removed while they are computed, tried again, given up, forgotten."""

from __future__ import annotations

import uuid
from contextlib import nullcontext
from typing import Any

import pytest
from sqlalchemy import text

from app.drives import computing
from app.drives.trials.run import TRIAL
from app.drives.worker import run_worker
from app.jobs.requests.run import perform
from app.jobs.requests.upkeep import look_after
from app.jobs.runs import MAX_DEATHS
from app.jobs.task import Interrupted, Work
from app.upkeep.dumps import LEFT_OUT
from problem_support import check
from web_fixtures import Web


def asked(web: Web, drive: str, query: str = "") -> str:
    answer = web.client.post(f"{drive}/trials{query}")
    assert answer.status_code == 202, answer.text
    return f"{drive}/trials/{answer.json()['id']}"


def number(address: str) -> uuid.UUID:
    return uuid.UUID(address.rsplit("/", 1)[-1])


def tried(web: Web, address: str, *, stop: bool = False) -> str:
    return perform(TRIAL, web.context, number(address), Work(lambda: stop, nullcontext))


def test_one_that_is_removed_while_it_runs_is_discarded(
    filled: Web, uploaded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, genuine = asked(filled, uploaded), computing.run_drive

    def remove(*arguments: Any, **options: Any) -> Any:
        assert filled.client.get(here).json()["status"] == "running"
        assert filled.client.delete(here).status_code == 204
        return genuine(*arguments, **options)

    monkeypatch.setattr(computing, "run_drive", remove)
    assert tried(filled, here) == "unwanted"
    check(filled.client.get(here), 404)


def test_two_runs_at_once_leave_one_result(
    filled: Web, uploaded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The former worker was only cut off: its job came back and was run by another."""
    here, genuine = asked(filled, uploaded), computing.run_drive

    def another(*arguments: Any, **options: Any) -> Any:
        monkeypatch.setattr(computing, "run_drive", genuine)
        assert tried(filled, here) == "done"
        return genuine(*arguments, **options)

    monkeypatch.setattr(computing, "run_drive", another)
    assert tried(filled, here) == "unwanted"
    assert filled.client.get(here).json()["status"] == "done"


def test_one_whose_worker_stops_waits_again(filled: Web, uploaded: str) -> None:
    here = asked(filled, uploaded)
    with pytest.raises(Interrupted):
        tried(filled, here, stop=True)
    found = filled.client.get(here).json()
    assert (found["status"], found["stage"], found["progress"]) == ("queued", None, 0)
    assert tried(filled, here) == "done"


def test_one_whose_worker_was_killed_is_tried_again(filled: Web, uploaded: str) -> None:
    here = asked(filled, uploaded)
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET status = 'doing', worker_id = NULL"))
        session.execute(text("UPDATE drive_trials SET status = 'running', run = 1, stage = 'roads'"))
    run_worker(filled.settings, wait=False, with_chores=False)
    assert filled.client.get(here).json()["status"] == "done"


def test_one_that_its_workers_die_of_is_given_up(filled: Web, uploaded: str) -> None:
    here = asked(filled, uploaded)
    with filled.sessions.begin() as session:
        guilty = text("INSERT INTO computations (job_id, deaths) SELECT id, :n FROM procrastinate_jobs")
        session.execute(guilty, {"n": MAX_DEATHS})
    run_worker(filled.settings, wait=False, with_chores=False)
    found = filled.client.get(here).json()
    assert (found["status"], found["failure"]["kind"]) == ("failed", "interrupted")
    assert "while it processed this trial" in found["failure"]["reason"]
    assert "Choose a method or options that take less" in found["failure"]["reason"]


def test_a_fault_of_the_service_is_said_to_be_one(
    filled: Web, uploaded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> Any:
        raise ZeroDivisionError

    here = asked(filled, uploaded)
    monkeypatch.setattr(computing, "run_drive", fail)
    assert tried(filled, here) == "failed"
    failure = filled.client.get(here).json()["failure"]
    assert (failure["kind"], failure["stage"]) == ("internal", "estimating")
    assert "under the trial's id" in failure["reason"]


def test_uploads_go_first_and_one_lane_is_enough(filled: Web, uploaded: str) -> None:
    asked(filled, uploaded)
    asked(filled, uploaded, "?method=dem")
    filled.client.post("/v1/drives", content=b"time_s,lat_deg,lon_deg\n1,49,8\n")
    query = "SELECT task_name, lock FROM procrastinate_jobs ORDER BY priority DESC, id"
    with filled.sessions() as session:
        jobs = [tuple(row) for row in session.execute(text(query))]
    assert [name for name, _ in jobs] == ["process_drive", "try_drive", "try_drive"]
    assert {lock for name, lock in jobs if name == "try_drive"} == {TRIAL.store.plural}


def test_one_whose_job_is_lost_gets_another(filled: Web, uploaded: str) -> None:
    here = asked(filled, uploaded)
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET status = 'failed'"))
    for _ in range(2):
        look_after(TRIAL, filled.context)
    with filled.sessions() as session:
        query = "SELECT args ->> 'trial_id' FROM procrastinate_jobs WHERE status = 'todo'"
        assert list(session.execute(text(query)).scalars()) == [str(number(here))]


def test_they_are_forgotten_a_week_after_their_end(filled: Web, uploaded: str) -> None:
    ended = {days: asked(filled, uploaded, f"?option=min_epochs:{k}") for k, days in enumerate((6.9, 7.1), 5)}
    waits = asked(filled, uploaded, "?method=dem")
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE drive_trials SET created_at = now() - make_interval(days => 30)"))
        end = text(
            "UPDATE drive_trials SET status = 'failed', failure_kind = 'x', failure_reason = 'x',"
            " finished_at = now() - make_interval(secs => :s) WHERE id = :id"
        )
        for days, here in ended.items():
            session.execute(end, {"s": days * 86_400, "id": number(here)})
    look_after(TRIAL, filled.context)
    assert [filled.client.get(here).status_code for here in ended.values()] == [200, 404]
    assert filled.client.get(waits).status_code == 200, "what waits is not forgotten"


def test_backups_leave_trials_out() -> None:
    """Whoever asks again gets the same."""
    assert "drive_trials" in LEFT_OUT
