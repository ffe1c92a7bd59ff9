"""The worker's part in drives that are cut off, and in keeping the blob store clear."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from types import ModuleType

import pytest
from sqlalchemy import text

from app.core.settings import Settings
from app.drives import computing, intake, process, worker
from app.drives.worker import run_worker
from app.jobs import worker as jobs_worker
from app.jobs.context import JobContext
from app.jobs.runs import MAX_DEATHS
from processing_support import Send, drive_now, put_blob

PATIENCE_S = 120.0


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    """Those of a worker beside ``context``."""
    return Settings(database_url=database_url, data_dir=tmp_path)


@pytest.mark.parametrize("deaths", [MAX_DEATHS - 1, MAX_DEATHS])
def test_a_drive_that_its_workers_die_of_is_given_up(
    settings: Settings, context: JobContext, send: Send, deaths: int
) -> None:
    drive = send(0)
    with context.sessions.begin() as session:
        guilty = text("INSERT INTO computations (job_id, deaths) SELECT id, :n FROM procrastinate_jobs")
        session.execute(guilty, {"n": deaths})
    run_worker(settings, wait=False)
    found = drive_now(context, drive.id)
    if deaths < MAX_DEATHS:
        assert found.status == "done"
    else:
        assert found.failure is not None
        assert (found.status, found.failure.kind) == ("failed", "interrupted")
        assert f"died {MAX_DEATHS} times while it processed this drive" in found.failure.reason
        assert "Split the log" in found.failure.reason


def test_a_drive_whose_workers_vanish_while_it_is_not_computed_is_innocent(
    settings: Settings, context: JobContext, send: Send
) -> None:
    drive = send(0)
    for _ in range(MAX_DEATHS + 1):
        with context.sessions.begin() as session:
            session.execute(text("UPDATE procrastinate_jobs SET status = 'doing', worker_id = NULL"))
            session.execute(text("UPDATE drives SET status = 'running'"))
        with pytest.MonkeyPatch.context() as patch:  # look after stalled jobs, take none
            patch.setattr(jobs_worker.Worker, "_serve", _nothing)
            run_worker(settings, wait=False)
    run_worker(settings, wait=False)
    assert drive_now(context, drive.id).status == "done"


def test_one_stalled_job_that_cannot_go_back_keeps_no_other(
    settings: Settings, context: JobContext, send: Send
) -> None:
    """A job of which one is enough, while another one waits."""
    solver = (
        "INSERT INTO procrastinate_jobs (queue_name, task_name, queueing_lock, status)"
        " VALUES ('other', 't', 't', '{}')"
    )
    with context.sessions.begin() as session:
        session.execute(text(solver.format("doing")))
        session.execute(text(solver.format("todo")))
        session.execute(text("UPDATE procrastinate_jobs SET queue_name = 'drives' WHERE status = 'doing'"))
    drive = send(0)
    with context.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET status = 'doing' WHERE task_name <> 't'"))
    run_worker(settings, wait=False)
    assert drive_now(context, drive.id).status == "done"
    with context.sessions() as session:
        query = text("SELECT queue_name, status::text FROM procrastinate_jobs")
        assert session.execute(query).all() == [("other", "todo")]


async def _nothing(*_: object) -> None:
    return


def test_only_the_computation_of_a_drive_is_marked(
    settings: Settings, context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks: dict[str, bool] = {}

    def watched(module: ModuleType, name: str) -> None:
        former = getattr(module, name)

        def look(*arguments: object, **named: object) -> object:
            with context.sessions() as session:
                query = text("SELECT EXISTS (SELECT FROM computations WHERE since IS NOT NULL)")
                marks[name] = bool(session.execute(query).scalar_one())
            return former(*arguments, **named)

        monkeypatch.setattr(module, name, look)

    for module, name in (
        (computing, "read_log"),
        (computing, "run_drive"),
        (process, "fill_heights_along"),
        (process, "append"),
    ):
        watched(module, name)
    drive = send(0, "profile")
    run_worker(settings, wait=False)
    assert drive_now(context, drive.id).status == "done"
    assert marks == {"read_log": True, "run_drive": True, "fill_heights_along": False, "append": False}
    with context.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM computations")).scalar_one() == 0


def test_a_drive_that_takes_too_long_fails_and_the_next_is_processed(
    settings: Settings, context: JobContext, send: Send
) -> None:
    first = send(0)
    run_worker(settings.model_copy(update={"run_limit_s": 1e-6}), wait=False)
    failed = drive_now(context, first.id)
    assert failed.failure is not None
    assert (failed.status, failed.failure.kind) == ("failed", "too-long")
    assert "Split the log" in failed.failure.reason
    second = send(1)
    run_worker(settings, wait=False)
    assert drive_now(context, second.id).status == "done"


def test_a_worker_sweeps_the_blob_store_again_and_again(
    settings: Settings, context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "SWEEP_EVERY_S", 0.02)
    kept = send(0)
    stop = threading.Event()
    thread = threading.Thread(target=run_worker, args=[settings], kwargs={"stop_event": stop})
    thread.start()
    try:
        for _ in range(3):
            orphan = put_blob(context.blobs, [b"nobody's"])
            os.utime(settings.data_dir / "blobs" / orphan.key, (0, 0))
            deadline = time.monotonic() + PATIENCE_S
            while context.blobs.keys() != [kept.blob_key]:
                assert time.monotonic() < deadline
                time.sleep(0.02)
    finally:
        stop.set()
        thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert context.blobs.keys() == [kept.blob_key]


def test_a_sweep_that_fails_stops_no_drive(
    settings: Settings, context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise PermissionError("the bucket says no")

    monkeypatch.setattr(intake, "sweep_blobs", fail)
    drive = send(0)
    run_worker(settings, wait=False)
    assert drive_now(context, drive.id).status == "done"
