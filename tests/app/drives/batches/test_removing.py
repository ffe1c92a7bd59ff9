"""Many drives removed at once: what would go is what goes, once, whoever dies meanwhile."""

from __future__ import annotations

import uuid
from contextlib import nullcontext
from typing import Any
from unittest.mock import Mock

import pytest
from sqlalchemy import text

from app.drives import worker
from app.drives.batches import removing_store
from app.drives.batches.removing import removing_task
from app.jobs.task import Interrupted, Work
from problem_support import check
from web_fixtures import Web, add_drive


def statuses(web: Web) -> dict[str, int]:
    with web.sessions() as session:
        return {
            row[0]: row[1] for row in session.execute(text("SELECT status, count(*) FROM drives GROUP BY 1"))
        }


def remove(web: Web, status: int = 202, **query: Any) -> dict[str, Any]:
    answer = web.client.post("/v1/drives/remove", params=query)
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    return found


def run(web: Web, pieces: int = 1000) -> None:
    """The jobs that wait, by a worker that is killed after so many pieces."""
    looks = iter(range(pieces))
    task = removing_task(web.sessions)
    work = Work(lambda: next(looks, None) is None, nullcontext)
    with web.sessions() as session:
        query = "SELECT args FROM procrastinate_jobs WHERE task_name = 'remove_drives' ORDER BY id"
        jobs = list(session.execute(text(query)).scalars())
    for arguments in jobs:
        task.run(work, **arguments)


def test_what_a_dry_run_shows_goes_and_nothing_else(filled: Web) -> None:
    ids = [add_drive(filled.sessions, [k]) for k in range(4)]
    with filled.sessions.begin() as session:
        failed = "UPDATE drives SET status = 'failed', failure_kind = 'bad-log', failure_version = 'x' WHERE id = :id"
        session.execute(text(failed), {"id": ids[0]})
        session.execute(text("UPDATE drives SET status = 'queued' WHERE id = :id"), {"id": ids[1]})
    shown = remove(filled, 200, failure="bad-log", dry_run=True)
    assert (shown["drives"], shown["km"], shown["uploaded_bytes"]) == (1, pytest.approx(0.1), 1)
    assert shown["sentence"] == "1 drive of 0.1 km, and its log of 0.0 MB, would be removed for good."
    assert statuses(filled) == {"failed": 1, "queued": 1, "done": 2}
    assert remove(filled, failure="bad-log")["sentence"].endswith("is removed for good.")
    assert statuses(filled) == {"cancelled": 1, "queued": 1, "done": 2}  # with the answer
    late = add_drive(filled.sessions, [7])
    with filled.sessions.begin() as session:  # it fails so after the request
        session.execute(text(failed), {"id": late})
    for _ in range(2):
        run(filled)
    assert statuses(filled) == {"cancelled": 1, "queued": 1, "done": 2, "failed": 1}
    assert remove(filled, 200, which="all", dry_run=True)["drives"] == 3
    (row,) = filled.client.get("/v1/admin/audit").json()["rows"]
    assert (row["action"], row["subject"]) == ("drives removed", "1 drive")
    assert row["detail"]["failure"] == "bad-log"


def test_drives_that_are_named_go_whatever_they_do(filled: Web) -> None:
    ids = [add_drive(filled.sessions, [k]) for k in range(3)]
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE drives SET status = 'running' WHERE id = :id"), {"id": ids[1]})
    named = f"{ids[0]},{ids[1]},{uuid.uuid4()}"
    assert remove(filled, ids=named)["drives"] == 2
    run(filled)
    assert statuses(filled) == {"cancelled": 2, "done": 1}
    assert remove(filled, ids=named)["sentence"] == "No drive is meant: nothing is removed."
    assert len(filled.client.get("/v1/admin/audit").json()["rows"]) == 1


def test_a_worker_that_is_killed_leaves_the_rest_to_the_next(
    filled: Web, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k in range(5):
        add_drive(filled.sessions, [k])
    monkeypatch.setattr(removing_store, "PIECE_DRIVES", 2)
    with monkeypatch.context() as cut_off:  # the request dies, its job is there
        cut_off.setattr(removing_store, "remove_piece", Mock(side_effect=RuntimeError))
        assert filled.client.post("/v1/drives/remove?which=all").status_code == 500
    with pytest.raises(Interrupted):
        run(filled, 1)
    assert statuses(filled) == {"cancelled": 2, "done": 3}
    run(filled)
    assert statuses(filled) == {"cancelled": 5}
    with filled.sessions() as session:
        query = "SELECT count(*), max(priority) FROM procrastinate_jobs WHERE task_name = 'remove_drive'"
        assert session.execute(text(query)).one() == (5, -100)


def test_a_real_worker_leaves_no_trace_of_them(filled: Web) -> None:
    for k in range(3):
        add_drive(filled.sessions, [k, k + 1])
    remove(filled, which="all")
    worker.run_worker(filled.settings, wait=False)
    with filled.sessions() as session:
        for table in ("drives", "drive_segments", "segment_slopes"):
            assert session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one() == 0


def test_what_cannot_be_meant_is_said(filled: Web) -> None:
    add_drive(filled.sessions, [0])
    for query in (
        {},
        {"dry_run": "true"},
        {"which": "nonsense"},
        {"ids": "x"},
        {"ids": ""},
        {"ids": ",".join(str(uuid.uuid4()) for _ in range(501))},
        {"bbox": "1,2"},
        {"region": "nowhere"},
        {"nonsense": "1"},
        {"which": "other", "method": "nonsense"},
    ):
        check(filled.client.post("/v1/drives/remove", params=query), 422)
    assert statuses(filled) == {"done": 1}
