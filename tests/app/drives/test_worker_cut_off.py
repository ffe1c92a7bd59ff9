"""The worker's part in drives that are cut off, and in keeping the blob store clear."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from pathlib import Path

import pytest
from procrastinate.jobs import Job
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.core.settings import Settings
from app.drives import intake, worker
from app.drives.process import Workbench
from app.drives.queue import BEHIND
from app.drives.worker import MAX_ATTEMPTS, MAX_DEATHS, make_queue, run_worker
from processing_support import Send, drive_now, put_blob

PATIENCE_S = 120.0


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    """Those of a worker beside ``bench``."""
    return Settings(database_url=database_url, data_dir=tmp_path)


def lost_sight_of(settings: Settings, bench: Workbench, begun: set[int]) -> None:
    """The one job is taken by a worker that then gives no sign of life; another one looks after it."""
    with bench.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET status = 'doing', worker_id = NULL"))

    async def look_after() -> None:
        queue = make_queue(str(settings.database_url), bench, begun)
        async with queue.open_async():
            await worker._retry_stalled(queue, settings.stalled_after_s, begun)

    asyncio.run(look_after())


def job_number(bench: Workbench) -> int:
    with bench.sessions() as session:
        return int(session.execute(text("SELECT id FROM procrastinate_jobs")).scalar_one())


@pytest.mark.parametrize("deaths", [MAX_DEATHS - 1, MAX_DEATHS])
def test_a_drive_that_its_workers_die_of_is_given_up_sooner(
    settings: Settings, bench: Workbench, send: Send, deaths: int
) -> None:
    assert MAX_DEATHS < MAX_ATTEMPTS
    drive = send(0)
    for _ in range(deaths):
        lost_sight_of(settings, bench, begun=set())
    run_worker(settings, wait=False)
    found = drive_now(bench, drive.id)
    if deaths < MAX_DEATHS:
        assert found.status == "done"
    else:
        assert found.failure is not None
        assert (found.status, found.failure.kind) == ("failed", "interrupted")
        assert f"died {MAX_DEATHS} times" in found.failure.reason


@pytest.mark.parametrize("priority", [0, BEHIND])
@pytest.mark.parametrize("deaths", range(MAX_DEATHS + 1))
def test_deaths_are_counted_behind_uploads_as_well(priority: int, deaths: int) -> None:
    job = Job(queue="q", lock=None, queueing_lock=None, task_name="t", priority=priority - deaths)
    assert worker._deaths(job) == deaths


def test_a_worker_cut_off_from_the_database_did_not_die(
    settings: Settings, bench: Workbench, send: Send
) -> None:
    drive = send(0)
    for _ in range(MAX_DEATHS):
        lost_sight_of(settings, bench, begun={job_number(bench)})
    run_worker(settings, wait=False)
    assert drive_now(bench, drive.id).status == "done"


def test_a_worker_remembers_the_jobs_that_it_did_not_bring_to_an_end(
    settings: Settings, bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    begun: set[int] = set()
    queue = make_queue(str(settings.database_url), bench, begun)

    async def run() -> None:
        async with queue.open_async():
            await queue.run_worker_async(wait=False, install_signal_handlers=False)

    def lose_connection(*_: object, **__: object) -> None:
        raise OperationalError("x", {}, Exception())

    with monkeypatch.context() as patch:
        patch.setattr(worker, "process_drive", lose_connection)
        asyncio.run(run())
    assert begun == {job_number(bench)}
    with bench.sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET scheduled_at = NULL"))
    asyncio.run(run())
    assert begun == set()
    assert drive_now(bench, drive.id).status == "done"


def test_a_worker_sweeps_the_blob_store_again_and_again(
    settings: Settings, bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "SWEEP_EVERY_S", 0.02)
    kept = send(0)
    stop = threading.Event()
    thread = threading.Thread(target=run_worker, args=[settings], kwargs={"stop_event": stop})
    thread.start()
    try:
        for _ in range(3):
            orphan = put_blob(bench.blobs, [b"nobody's"])
            os.utime(settings.data_dir / "blobs" / orphan.key, (0, 0))
            deadline = time.monotonic() + PATIENCE_S
            while bench.blobs.keys() != [kept.blob_key]:
                assert time.monotonic() < deadline
                time.sleep(0.02)
    finally:
        stop.set()
        thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert bench.blobs.keys() == [kept.blob_key]


def test_a_sweep_that_fails_stops_no_drive(
    settings: Settings, bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise PermissionError("the bucket says no")

    monkeypatch.setattr(intake, "sweep_blobs", fail)
    drive = send(0)
    run_worker(settings, wait=False)
    assert drive_now(bench, drive.id).status == "done"
