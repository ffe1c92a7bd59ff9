"""Batches and removals of an owner's drives: in the request and in the worker that goes on with it."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import pytest
from sqlalchemy import text

from access_support import Holder, Keyed
from app.drives.batches import enqueuing, removing, removing_store
from app.drives.batches import store as bulk
from app.drives.batches.removing import removing_task
from app.jobs.task import Work
from many_drives import execute, make_drives, rows
from problem_support import check

N = 12
"""Drives in all: of A, B and the operator by turns, every fourth failed."""


@pytest.fixture
def owned(keyed: Keyed) -> Keyed:
    make_drives(keyed.web.sessions, N)
    execute(
        keyed.web.sessions,
        "UPDATE drives SET owner_id = (CAST(ARRAY[:a, :b, 1] AS bigint[]))"
        "[CAST(split_part(filename, ' ', 2) AS integer) % 3 + 1]",
        a=keyed.a.id,
        b=keyed.b.id,
    )
    return keyed


def by_owner(keyed: Keyed, status: str) -> dict[int, int]:
    query = "SELECT owner_id, count(*) FROM drives WHERE status = :status GROUP BY 1"
    return {row[0]: row[1] for row in rows(keyed.web.sessions, query, status=status)}


def reprocess(holder: Holder, **query: Any) -> dict[str, Any]:
    answer = holder.post("/v1/drives/reprocess", params={"which": "all", **query})
    assert answer.status_code in {200, 202}, answer.text
    found: dict[str, Any] = answer.json()
    return found


def begin_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let requests do one piece, of one drive, and leave the rest to workers."""
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 1)
    monkeypatch.setattr(enqueuing, "ENQUEUE_FOR_S", 0)
    monkeypatch.setattr(enqueuing.reprocess_all, "__defaults__", (0,))


def test_a_batch_is_of_its_owner_s_drives(owned: Keyed) -> None:
    assert reprocess(owned.a.own, dry_run=True)["queued"] == 4
    assert reprocess(owned.operator, dry_run=True)["queued"] == N
    assert by_owner(owned, "queued") == {}
    assert reprocess(owned.a.own)["queued"] == 4
    assert by_owner(owned, "queued") == {owned.a.id: 4}
    assert reprocess(owned.operator)["queued"] == N - 4
    assert by_owner(owned, "queued") == {1: 4, owned.a.id: 4, owned.b.id: 4}


def test_a_worker_goes_on_with_its_owner_s_drives_alone(
    owned: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin_only(monkeypatch)
    accepted = reprocess(owned.a.own)
    assert (accepted["queued"], accepted["complete"]) == (1, False)
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 100)
    while enqueuing.tend(owned.web.sessions):
        pass
    assert by_owner(owned, "queued") == {owned.a.id: 4}
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 1)
    reprocess(owned.operator)
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 100)
    while enqueuing.tend(owned.web.sessions):
        pass
    assert sum(by_owner(owned, "queued").values()) == N


def test_the_same_of_two_owners_is_two_batches_that_know_nothing_of_each_other(
    owned: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin_only(monkeypatch)
    parties = (owned.a.own, owned.b.own, owned.operator, owned.holder(1, "own"))
    links = [reprocess(holder)["links"][0]["href"] for holder in parties]
    assert len(set(links)) == 4
    assert reprocess(owned.a.own)["links"][0]["href"] == links[0]
    of_a = links[0].removeprefix(owned.web.base)
    assert owned.a.own.get(of_a).json()["drives"] == 2
    for holder in (owned.b.own, parties[3]):
        check(holder.get(of_a), 404)
        check(holder.delete(of_a), 404)
    # One over the drives of all is an operator's, also to other keys of the operator's owner.
    of_all = links[2].removeprefix(owned.web.base)
    for holder in (owned.a.own, parties[3]):
        check(holder.get(of_all), 404)
        check(holder.delete(of_all), 404)
    check(owned.b.upload.get(of_a), 403)
    assert owned.operator.get(of_a).json()["drives"] == 2
    assert owned.a.own.delete(of_a).json()["state"] == "cancelled"
    assert owned.a.id not in by_owner(owned, "queued")


def test_the_note_counts_one_s_own_drives(owned: Keyed) -> None:
    execute(owned.web.sessions, "DELETE FROM drives WHERE owner_id = :a", a=owned.a.id)
    assert reprocess(owned.a.own)["note"] == "Nothing was chosen. No drive is done or failed."
    assert "Of 4 that are done or failed" in str(reprocess(owned.b.own, failure="x")["note"])
    assert "Of 8 that are done or failed" in str(reprocess(owned.operator, failure="x")["note"])


def run_jobs(keyed: Keyed) -> None:
    task = removing_task(keyed.web.sessions)
    query = "SELECT args FROM procrastinate_jobs WHERE task_name = 'remove_drives' ORDER BY id"
    for (arguments,) in rows(keyed.web.sessions, query):
        task.run(Work(bool, nullcontext), **arguments)


def test_removals_are_of_one_s_own_drives_in_request_and_worker(
    owned: Keyed, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = owned.a.own.post("/v1/drives/remove?which=all&dry_run=true").json()
    assert shown["drives"] == 4
    assert owned.operator.post("/v1/drives/remove?which=all&dry_run=true").json()["drives"] == N
    ((theirs,),) = rows(owned.web.sessions, "SELECT id FROM drives WHERE owner_id = :b LIMIT 1", b=owned.b.id)
    assert owned.a.own.post(f"/v1/drives/remove?ids={theirs}").json()["drives"] == 0
    assert by_owner(owned, "cancelled") == {}
    # The request is cut off before it has removed one: a worker does it.
    with monkeypatch.context() as cut:
        cut.setattr(removing, "remove_all", lambda *_: 0)
        removal = owned.a.own.post("/v1/drives/remove?which=all").json()
    assert (removal["drives"], removal["links"]) == (4, [])  # how the queue is, is the operator's to see
    assert by_owner(owned, "cancelled") == {}
    run_jobs(owned)
    assert by_owner(owned, "cancelled") == {owned.a.id: 4}
    assert owned.b.own.post("/v1/drives/remove?which=all").json()["drives"] == 4
    assert by_owner(owned, "cancelled") == {owned.a.id: 4, owned.b.id: 4}
    run_jobs(owned)
    assert sum(by_owner(owned, "cancelled").values()) == 8
    assert owned.operator.post("/v1/drives/remove?which=all").json()["drives"] == 4


def test_a_job_of_before_there_were_owners_is_about_all(owned: Keyed) -> None:
    targets = removing_store.Targets.model_validate(
        {"selection": {"which": "all", "force": True}, "method": None, "ids": None}
    )
    with owned.web.sessions() as session:
        assert removing_store.sums_of(session, targets).drives == N


def test_the_planner_is_told_how_long_the_queue_is(owned: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also by a caller's transaction, whose role owns no table."""
    monkeypatch.setattr(bulk, "PIECE_DRIVES", 4)
    reprocess(owned.a.own)
    query = text("SELECT reltuples FROM pg_class WHERE oid = CAST('procrastinate_jobs' AS regclass)")
    with owned.web.sessions() as session:
        assert session.execute(query).scalar_one() == 4
