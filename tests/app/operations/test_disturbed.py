"""Operations whose worker stops, dies, or lets others go first; whose file is lost; that wait too long for a person."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from app.core.blobs import IMPORTS, BlobStore
from app.drives.worker import run_worker
from app.jobs.requests import run as machine
from app.jobs.requests import upkeep
from app.jobs.requests.run import RequestRun, perform
from app.jobs.requests.store import Failure
from app.jobs.task import Interrupted
from app.jobs.task import Work as Given
from app.network.locks import import_claim
from app.operations.run import OPERATION
from app.operations.store import operations
from fusion.simulate.scene.town import Town
from fusion.simulate.write.osm_file import write_osm
from web_fixtures import Web, add_drive

Work = Callable[..., list[str]]


@pytest.fixture(scope="module")
def roads(town: Town, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A town's roads, as a file."""
    path = tmp_path_factory.mktemp("ground") / "town.osm"
    write_osm(town, path)
    return path.read_bytes()


def ask(web: Web, content: bytes = b"", **query: str) -> uuid.UUID:
    answer = web.client.post("/v1/operations", params=query, content=content)
    assert answer.status_code == 202, answer.text
    return uuid.UUID(answer.json()["id"])


def seen(web: Web, number: uuid.UUID) -> dict[str, Any]:
    found: dict[str, Any] = web.client.get(f"/v1/operations/{number}").json()
    return found


def planned(web: Web, roads: bytes, work: Work) -> uuid.UUID:
    """An import that is approved."""
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    assert work(web) == ["planned"]
    web.client.post(f"/v1/operations/{number}/approve")
    return number


def files(web: Web) -> list[str]:
    return BlobStore(web.settings.blob_store_url, IMPORTS).keys()


class Stops:
    """Whether a run is to stop: after so many looks."""

    def __init__(self, after: int) -> None:
        self.left = after

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


@pytest.mark.parametrize("after", [0, 1, 3, 5, 8])
def test_a_run_that_is_cut_off_anywhere_goes_on_and_ends_right(
    web: Web, roads: bytes, work: Work, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    number = planned(web, roads, work)
    added = seen(web, number)["plan"]["added"]
    context = web.context
    with pytest.raises(Interrupted):
        perform(OPERATION, context, number, Given(Stops(after), nullcontext))
    assert seen(web, number)["status"] == "queued"
    assert work(web) == ["done"]
    (region,) = web.client.get("/v1/regions").json()["regions"]
    assert region["segments"] == added
    assert files(web) == []
    assert not list(context.scratch("operations").iterdir())


def test_a_worker_that_vanished_is_followed_by_another_one(web: Web, roads: bytes, work: Work) -> None:
    """Its row says that it runs; what it would still write is ignored."""
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    with web.sessions.begin() as session:
        lost = operations.claim(session, number)
    assert lost is not None
    assert work(web) == ["planned"]
    with web.sessions.begin() as session:
        assert not operations.update(session, lost, stage="late", progress=0.5)
        assert not operations.finish(session, lost, result={"sentence": "late"})
        assert operations.fail(session, number, Failure("late", "late"), lost.run) is None
    assert seen(web, number)["status"] == "planned"


def test_a_removal_whose_end_was_not_told_is_done(filled: Web, work: Work) -> None:
    number = ask(filled, kind="remove-region", name="roads")
    work(filled)
    filled.client.post(f"/v1/operations/{number}/approve")
    finish = operations.finish
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(operations, "finish", lambda *_, **__: False)
        assert work(filled) == ["unwanted"]
    assert operations.finish == finish
    assert filled.client.get("/v1/regions").json()["regions"] == []
    assert work(filled) == ["done"]
    assert seen(filled, number)["result"]["sentence"] == "Region roads is gone."


def test_settling_goes_on_where_it_was_cut_off(
    filled: Web, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    add_drive(filled.sessions, list(range(8)))
    number = ask(filled, kind="settle")
    with pytest.raises(Interrupted):
        perform(OPERATION, filled.context, number, Given(Stops(2), nullcontext))
    with filled.sessions() as session:
        cell = session.execute(text("SELECT state -> 'cell' FROM operations")).scalar_one()
    assert cell is not None
    assert work(filled) == ["done"]


def test_what_is_carried_out_is_nobody_s_to_cancel_and_what_is_planned_is(
    web: Web, roads: bytes, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    answers: list[int] = []
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    progress = RequestRun.show

    def cancelled(self: Any, stage: str, share: float) -> None:
        if stage == wanted:
            answers.append(web.client.delete(f"/v1/operations/{number}").status_code)
        progress(self, stage, share)

    monkeypatch.setattr(RequestRun, "show", cancelled)
    wanted = "comparing"
    assert work(web) == ["unwanted"]
    assert seen(web, number)["status"] == "cancelled"
    assert files(web) == []
    wanted = "none"
    number = planned(web, roads, work)
    wanted, answers = "adding", []
    assert work(web) == ["done"]
    assert set(answers) == {409}


def test_operations_let_uploads_go_first_but_come_to_their_end(
    web: Web, roads: bytes, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    monkeypatch.setattr(machine, "OTHERS_WAIT_S", 0.0)
    number = planned(web, roads, work)
    job = "INSERT INTO procrastinate_jobs (queue_name, task_name, priority) VALUES ('drives', 'process_drive', 0)"
    with web.sessions.begin() as session:
        session.execute(text(job))
    context = web.context
    with pytest.raises(Interrupted):
        perform(OPERATION, context, number, Given(bool, nullcontext))
    with web.sessions() as session:
        assert session.execute(text("SELECT yields FROM operations")).scalar_one() == 1
    assert work(web) == ["done"], "the next time it may go on for a while"


def test_an_import_at_the_command_line_is_waited_for_without_a_lane(
    web: Web, roads: bytes, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.operations.run.WAIT_S", 0.05)
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    stages: list[str] = []
    with ExitStack() as other:
        other.enter_context(import_claim(web.sessions)).wait()
        progress = RequestRun.show

        def told(self: Any, stage: str, share: float) -> None:
            stages.append(stage)
            if stages.count("waiting for another import") == 3:
                other.close()
            progress(self, stage, share)

        monkeypatch.setattr(RequestRun, "show", told)
        assert work(web) == ["planned"]
    assert "waiting for another import" in stages
    assert seen(web, number)["status"] == "planned"


def test_a_file_that_is_lost_is_said(web: Web, roads: bytes, work: Work) -> None:
    number = planned(web, roads, work)
    for key in files(web):
        BlobStore(web.settings.blob_store_url, IMPORTS).delete(key)
    assert work(web) == ["failed"]
    assert seen(web, number)["failure"]["kind"] == "file-lost"


def test_plans_are_forgotten_and_files_of_nobody_go(
    web: Web, roads: bytes, work: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    work(web)
    upkeep.look_after(OPERATION, web.context)
    assert seen(web, number)["status"] == "planned"
    assert len(files(web)) == 1
    with web.sessions.begin() as session:
        session.execute(text("UPDATE operations SET planned_at = now() - interval '8 days'"))
        session.execute(text("DELETE FROM procrastinate_jobs"))
    with BlobStore(web.settings.blob_store_url, IMPORTS).writer() as writer:
        writer.write(b"x")
        writer.finish()
    monkeypatch.setattr(upkeep, "ORPHAN_AGE", timedelta(0))
    upkeep.look_after(OPERATION, web.context)
    assert len(upkeep.sweep_files(OPERATION, web.context)) == 1
    assert seen(web, number)["status"] == "cancelled"
    assert files(web) == []


def test_a_real_worker_does_what_waits_one_at_a_time_and_gives_lost_jobs_back(
    web: Web, roads: bytes, tmp_path: Path
) -> None:
    number = ask(web, roads, kind="import-roads", filename="town.osm")
    settle = ask(web, kind="settle")
    with web.sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_jobs"))
    upkeep.look_after(OPERATION, web.context)
    run_worker(web.settings, wait=False)
    assert (seen(web, number)["status"], seen(web, settle)["status"]) == ("planned", "done")
    for _ in range(2):
        web.client.post(f"/v1/operations/{number}/approve")
    workers = [
        threading.Thread(target=run_worker, args=(web.settings,), kwargs={"wait": False}) for _ in range(2)
    ]
    for one in workers:
        one.start()
    for one in workers:
        one.join()
    done = seen(web, number)
    assert done["status"] == "done", done
    assert done["result"]["added"] == done["plan"]["added"]
