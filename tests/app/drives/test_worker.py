"""The worker: as a thread, and as a process that is stopped and killed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from app.cli.children import child_environment
from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.drives import intake
from app.drives import store as drives
from app.drives.documents import Drive
from app.drives.worker import run_worker
from app.roads import imports as road_imports
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.osm_file import write_osm
from processing_support import accept_upload

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 120.0
# Enough particles that nobody waits for the end by accident, few enough that the test ends.
SLOW = {"particles": 200_000}
ENDLESS = {"particles": 2_000_000}
SET_OPTIONS = text("UPDATE drives SET options = CAST(:options AS jsonb) WHERE id = :id")
"""It does not end within the share of the grace for which a stopped worker's runs go on."""

Send = Callable[..., Drive]
Workers = Callable[[], AbstractContextManager["subprocess.Popen[bytes]"]]


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(
        database_url=database_url,
        data_dir=tmp_path,
        heartbeat_interval_s=0.5,
        stalled_after_s=2.0,
        grace_s=10.0,
    )


@pytest.fixture
def sessions(database_url: str) -> Iterator[Sessions]:
    engine = make_engine(database_url)
    yield session_factory(engine)
    engine.dispose()


@pytest.fixture(scope="module")
def files(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("town")
    write_osm(town, folder / "town.osm")
    for seed, duration_s in enumerate((120, 120, 400)):
        write_csv(simulate_drive(town, seed, duration_s=duration_s), folder / f"{seed}.csv")
    return folder


@pytest.fixture
def send(settings: Settings, sessions: Sessions, files: Path) -> Send:
    """``send(seed or bytes, method, options)``: upload a log to a service that knows the town's roads."""
    road_imports.import_roads(sessions, files / "town.osm", settings.dem_dir)
    blobs = BlobStore(settings.blob_store_url)

    def upload(log: int | bytes = 0, method: str = "raw", options: dict[str, Any] | None = None) -> Drive:
        content = log if isinstance(log, bytes) else (files / f"{log}.csv").read_bytes()
        drive = accept_upload(sessions, blobs, [content], filename="log", method=method)[0]
        with sessions.begin() as session:  # more than a request may ask for, as an older version let it
            session.execute(SET_OPTIONS, {"id": drive.id, "options": json.dumps(options or {})})
        return drive

    return upload


@pytest.fixture
def worker_process(settings: Settings) -> Workers:
    """A worker as a program of its own; killed at the end of the ``with`` block at the latest."""

    @contextlib.contextmanager
    def start() -> Iterator[subprocess.Popen[bytes]]:
        environment = os.environ | child_environment(settings)
        program = (
            "from app.core.settings import Settings; from app.drives.worker import run_worker; "
            "run_worker(Settings())"
        )
        with subprocess.Popen([sys.executable, "-c", program], cwd=REPOSITORY, env=environment) as process:
            try:
                yield process
            finally:
                process.kill()

    return start


@contextlib.contextmanager
def worker_thread(settings: Settings, **options: Any) -> Iterator[threading.Thread]:
    stop = threading.Event()
    thread = threading.Thread(target=run_worker, args=[settings], kwargs={"stop_event": stop, **options})
    thread.start()
    try:
        yield thread
    finally:
        stop.set()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def now(sessions: Sessions, drive_id: uuid.UUID) -> Drive:
    with sessions() as session:
        found = drives.get_drive(session, drive_id)
    assert found is not None
    return found


def wait_for(sessions: Sessions, drive: Drive, holds: Callable[[Drive], bool]) -> Drive:
    deadline = time.monotonic() + PATIENCE_S
    while not holds(found := now(sessions, drive.id)):
        assert time.monotonic() < deadline, f"still {found.status}, stage {found.stage}, {found.progress:.0%}"
        time.sleep(0.05)
    return found


def ended(drive: Drive) -> bool:
    return drive.status in ("done", "failed")


def half_way(drive: Drive) -> bool:
    assert not ended(drive), "the drive ended before it could be disturbed"
    return drive.status == "running" and drive.progress > 0.2


def begun(drive: Drive) -> bool:
    return drive.status == "running" and drive.stage == "filter"


def counts(sessions: Sessions) -> tuple[int, ...]:
    query = text(
        """
        SELECT (SELECT count(*) FROM drive_segments), (SELECT count(*) FROM segment_slopes),
               (SELECT count(*) FROM drive_tracks), (SELECT count(*) FROM provenances),
               (SELECT coalesce(max(drives), 0) FROM segment_slopes)
        """
    )
    with sessions() as session:
        return tuple(session.execute(query).one())


def test_the_queue_is_worked_off_past_a_bad_drive(settings: Settings, sessions: Sessions, send: Send) -> None:
    made = [send(0), send(b"\x89PNG"), send(1)]
    run_worker(settings, wait=False)
    assert [now(sessions, drive.id).status for drive in made] == ["done", "failed", "done"]
    with sessions() as session:
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 0
        assert session.execute(text("SELECT count(*) FROM procrastinate_workers")).scalar_one() == 0


def test_a_waiting_worker_takes_new_drives_until_it_is_stopped(
    settings: Settings, sessions: Sessions, send: Send
) -> None:
    with worker_thread(settings):
        first = send(0)
        assert wait_for(sessions, first, ended).status == "done"
        again = intake.reprocess(sessions, first.id)
        assert again is not None
        assert wait_for(sessions, again, ended).generation == 2


def test_a_worker_survives_the_loss_of_its_connections(
    settings: Settings, sessions: Sessions, send: Send
) -> None:
    cut = text(
        """
        SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity
        WHERE pid <> pg_backend_pid() AND datname = current_database()
        """
    )
    with worker_thread(settings):
        assert wait_for(sessions, send(0), ended).status == "done"
        with sessions() as session:
            assert session.execute(cut).scalar_one() > 0
        assert wait_for(sessions, send(1), ended).status == "done"


def test_a_drive_that_is_cut_off_again_and_again_is_innocent(
    settings: Settings, sessions: Sessions, send: Send
) -> None:
    drive = send(0)
    with sessions.begin() as session:
        session.execute(text("UPDATE procrastinate_jobs SET attempts = 100"))
    run_worker(settings, wait=False)
    assert now(sessions, drive.id).status == "done"


def test_the_job_of_a_removed_drive_ends_quietly(settings: Settings, sessions: Sessions, send: Send) -> None:
    gone, stays = send(0), send(1)
    assert intake.remove_drive(sessions, gone.id)
    run_worker(settings, wait=False)
    assert now(sessions, stays.id).status == "done"
    with sessions() as session:
        assert drives.get_drive(session, gone.id) is None
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 0


@pytest.mark.slow
def test_a_killed_workers_drive_is_taken_up_again(
    settings: Settings, sessions: Sessions, send: Send, worker_process: Workers
) -> None:
    drive = send(2, "particle", SLOW)
    with worker_process() as worker:
        wait_for(sessions, drive, half_way)
        worker.send_signal(signal.SIGKILL)
        worker.wait(PATIENCE_S)
    assert now(sessions, drive.id).status == "running"
    assert counts(sessions) == (0, 0, 0, 0, 0)
    with worker_thread(settings):
        assert wait_for(sessions, drive, ended).status == "done"
    estimates, aggregates, kept_tracks, provenances, most_drives = counts(sessions)
    assert estimates == aggregates > 5
    assert (kept_tracks, provenances, most_drives) == (1, 1, 1)


@pytest.mark.slow
def test_a_stopped_worker_puts_a_long_drive_back(
    sessions: Sessions, send: Send, worker_process: Workers, settings: Settings
) -> None:
    drive = send(2, "particle", ENDLESS)
    with worker_process() as worker:
        wait_for(sessions, drive, begun)
        worker.terminate()  # Ctrl-C: tests/end_to_end
        assert worker.wait(PATIENCE_S) == 0
    assert now(sessions, drive.id).status == "queued"
    assert counts(sessions) == (0, 0, 0, 0, 0)
    with sessions() as session:
        assert session.execute(text("SELECT status::text FROM procrastinate_jobs")).scalars().all() == [
            "todo"
        ]
    intake.reprocess(sessions, drive.id, "raw")
    run_worker(settings, wait=False)
    assert now(sessions, drive.id).status == "done"


def test_a_worker_needs_a_database(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="database_url"):
        run_worker(Settings(database_url=None, data_dir=tmp_path), wait=False)


def test_a_run_of_whose_end_the_queue_was_not_told_is_repeated(
    settings: Settings, send: Send, sessions: Sessions
) -> None:
    """The database went in the moment in which the run had ended, and the worker lives on."""
    drive = send(0)
    with worker_thread(settings):
        assert wait_for(sessions, drive, ended).status == "done"
        with sessions.begin() as session:
            session.execute(
                text(
                    "UPDATE drives SET status = 'queued', stage = NULL, generation = generation + 1 WHERE id = :id"
                ),
                {"id": drive.id},
            )
            session.execute(
                text(
                    """
                    INSERT INTO procrastinate_jobs (queue_name, task_name, priority, lock, args, status, worker_id)
                    SELECT 'drives', 'process_drive', 0, CAST(:id AS text),
                           jsonb_build_object('drive_id', CAST(:id AS text), 'generation', 2), 'doing', w.id
                    FROM procrastinate_workers AS w
                    """
                ),
                {"id": drive.id},
            )
        assert wait_for(sessions, drive, ended).status == "done"


def lane(settings: Settings, *, new_above_bytes: int) -> subprocess.Popen[bytes]:
    """A lane as a program of its own, which ends with status 75 when it has grown beyond so much."""
    program = (
        "import sys; from app.jobs import memory; from app.core.settings import Settings; "
        f"memory.NEW_ABOVE_BYTES = {new_above_bytes}; from app.drives.worker import run_worker; "
        "sys.exit(75 if run_worker(Settings(), renewed=True) else 0)"
    )
    environment = os.environ | child_environment(settings)
    return subprocess.Popen([sys.executable, "-c", program], cwd=REPOSITORY, env=environment)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="bounded on Linux")
def test_a_drive_that_wants_too_much_memory_fails_with_a_sentence_and_the_lane_goes_on(
    settings: Settings, sessions: Sessions, send: Send
) -> None:
    made = send(0, "particle", {"particles": 10_000_000}), send(1)
    small = settings.model_copy(update={"lane_memory_bytes": 768 * 2**20})
    with lane(small, new_above_bytes=2**40) as process:
        try:
            hog, other = (wait_for(sessions, drive, ended) for drive in made)
            assert process.poll() is None
        finally:
            process.kill()
    assert (hog.status, other.status) == ("failed", "done")
    assert hog.failure is not None
    assert hog.failure.kind == "out-of-memory"
    assert "VERSANT_LANE_MEMORY_BYTES" in hog.failure.reason
    assert hog.failure.reason.endswith("Split the log into shorter drives.")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="told on Linux")
def test_a_lane_that_has_grown_ends_between_two_drives(
    settings: Settings, sessions: Sessions, send: Send
) -> None:
    first, second = send(0), send(1)
    with lane(settings, new_above_bytes=1) as process:
        try:
            assert process.wait(PATIENCE_S) == 75
        finally:
            process.kill()
    assert now(sessions, first.id).stage == "publishing"  # another job
    assert now(sessions, second.id).status == "queued"
