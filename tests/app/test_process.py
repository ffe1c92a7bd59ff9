"""One drive through the library and into the database, undisturbed and disturbed."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app import ingest, process, reporting
from app.db import Sessions, make_engine, session_factory
from app.process import Outcome, Workbench, process_drive
from app.reporting import Interrupted
from app.store import drives, slopes, tracks
from app.store.blobs import BlobStore
from app.store.rows import DriveRow
from fusion.combine import combine
from fusion.formats import read_log
from fusion.methods import METHODS
from fusion.pipeline import run_drive
from fusion.roads import read_roads
from fusion.simulate import Town
from fusion.terrain import Dem
from fusion.types import Progress, Track

Send = Callable[..., DriveRow]


@pytest.fixture
def sessions(database_url: str) -> Iterator[Sessions]:
    engine = make_engine(database_url)
    yield session_factory(engine)
    engine.dispose()


@pytest.fixture(scope="module")
def files(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the town's roads, its elevation and three logs, the first and last along one route."""
    folder = tmp_path_factory.mktemp("town")
    town.write_osm(folder / "town.osm")
    town.write_dem(folder / "town.tif")
    for number, (seed, receiver) in enumerate([(0, "m8"), (1, "m8"), (0, "f9p")]):
        town.drive(seed, duration_s=150, receiver=receiver).write_csv(folder / f"{number}.csv")
    return folder


@pytest.fixture
def bench(sessions: Sessions, files: Path, tmp_path: Path) -> Workbench:
    """A workbench whose database knows the town."""
    ingest.import_roads(sessions, files / "town.osm", tmp_path / "dem")
    ingest.import_dem(sessions, [files / "town.tif"], tmp_path / "dem")
    return Workbench(sessions, BlobStore(str(tmp_path / "blobs")), tmp_path / "dem")


@pytest.fixture
def send(bench: Workbench, files: Path) -> Send:
    """``send(seed or bytes, method, options)``: upload a log; returns the queued drive."""

    def upload(log: int | bytes = 0, method: str = "raw", options: dict[str, Any] | None = None) -> DriveRow:
        content = log if isinstance(log, bytes) else (files / f"{log}.csv").read_bytes()
        drive, _ = ingest.accept_upload(
            bench.sessions, bench.blobs, [content], filename="log", method=method, options=options
        )
        return drive

    return upload


def drive_now(bench: Workbench, drive_id: uuid.UUID) -> DriveRow:
    with bench.sessions() as session:
        found = drives.get_drive(session, drive_id)
    assert found is not None
    return found


def state(bench: Workbench) -> list[tuple[Any, ...]]:
    """Everything published that does not depend on when it was made."""
    with bench.sessions() as session:
        estimates = session.execute(
            text(
                """
                SELECT d.sha256, s.osm_way_id, s.from_node, s.to_node, e.slope_percent, e.slope_sigma_percent,
                       e.observations, e.passes, a.slope_percent, a.drives, a.observations
                FROM drive_segments e JOIN drives d ON d.id = e.drive_id JOIN segments s ON s.id = e.segment_id
                JOIN segment_slopes a ON a.segment_id = s.id ORDER BY 1, 2, 3, 4
                """
            )
        ).all()
        orphans = session.execute(
            text(
                "SELECT count(*) FROM segment_slopes WHERE segment_id NOT IN (SELECT segment_id FROM drive_segments)"
            )
        ).scalar_one()
    assert orphans == 0
    return [tuple(row) for row in estimates]


@pytest.mark.parametrize(("method", "options"), [("raw", {}), ("dem", {}), ("particle", {"particles": 300})])
def test_the_service_stores_the_numbers_of_the_library(
    bench: Workbench, send: Send, files: Path, method: str, options: dict[str, Any]
) -> None:
    drive = send(1, method, options)
    assert process_drive(bench, drive.id, 1) is Outcome.DONE

    log = read_log(files / "1.csv")
    with Dem.open([files / "town.tif"]) as dem:
        network, result = run_drive(log, read_roads(files / "town.osm"), dem, method=method, options=options)
    with bench.sessions() as session:
        stored = {
            (row.segment.osm_way_id, row.segment.from_node, row.segment.to_node): row
            for row in drives.drive_slopes(session, drive.id)
        }
        track = tracks.read_track(session, drive.id)
        segment_of = {row.id: row for row in slopes.segment_items(session, limit=10_000)}
    table = network.table
    assert len(stored) == len(result.slopes) > 5
    for estimate in result.slopes:
        k = estimate.segment
        row = stored[(int(table.osm_way_id[k]), int(table.from_node[k]), int(table.to_node[k]))]
        assert (row.slope_percent, row.slope_sigma_percent, row.observations, row.passes) == (
            estimate.slope_percent, estimate.slope_sigma_percent, estimate.observations, estimate.passes
        )  # fmt: skip
        assert row.first_at.timestamp() == pytest.approx(estimate.first_time_s, abs=1e-5)
    assert track is not None
    for spec in fields(Track):
        if spec.name != "segment":
            assert np.array_equal(
                getattr(track.track, spec.name), getattr(result.track, spec.name), equal_nan=True
            )
    for index, segment_id in zip(result.track.segment.tolist(), track.segment_id.tolist(), strict=True):
        assert (segment_id == -1) == (index == -1)
        if index >= 0:
            assert segment_of[segment_id].from_node == table.from_node[index]


def test_a_done_drive_says_what_was_done(bench: Workbench, send: Send, files: Path) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    done = drive_now(bench, drive.id)
    log = read_log(files / "0.csv")
    assert (done.status, done.progress, done.stage, done.failure_reason) == ("done", 1.0, None, None)
    assert done.bounds == pytest.approx(log.bounds_deg())
    assert done.epochs == 150
    assert done.distance_m is not None
    assert 300 < done.distance_m < 5000
    assert done.drive_time is not None
    assert done.drive_time.timestamp() == pytest.approx(log.fix.time_s[0], abs=1e-5)
    assert done.report is not None
    assert done.report["method"] == "raw"
    assert {"code_version", "road_version", "dem_version", "matched_share", "warnings"} <= set(done.report)
    with bench.sessions() as session:
        (first, *_) = slopes.segment_items(session, driven=True)
        (behind,) = slopes.segment_observations(session, first.id)
    assert behind.method == "raw"
    assert set(behind.options) == set(METHODS["raw"].options_model.model_fields)
    assert behind.dem_version_id is not None


def test_without_elevation_a_drive_is_done_all_the_same(
    sessions: Sessions, files: Path, tmp_path: Path
) -> None:
    ingest.import_roads(sessions, files / "town.osm", tmp_path / "dem")
    bench = Workbench(sessions, BlobStore(str(tmp_path / "blobs")), tmp_path / "dem")
    drive, _ = ingest.accept_upload(
        sessions, bench.blobs, [(files / "0.csv").read_bytes()], filename="x", method="particle",
        options={"particles": 300},
    )  # fmt: skip
    assert process_drive(bench, drive.id, 1) is Outcome.DONE
    assert len(state(bench)) > 5


def test_drives_combine(bench: Workbench, send: Send) -> None:
    for seed, method in ((0, "raw"), (1, "dem"), (2, "raw")):
        assert process_drive(bench, send(seed, method).id, 1) is Outcome.DONE
    with bench.sessions() as session:
        shared = 0
        for row in slopes.segment_items(session, driven=True, limit=10_000):
            behind = slopes.segment_observations(session, row.id)
            whole = combine(
                np.array([b.slope_percent for b in behind]),
                np.array([b.slope_sigma_percent for b in behind]),
                np.array([b.observations for b in behind]),
            )
            assert (row.slope_percent, row.slope_sigma_percent) == (
                whole.slope_percent, whole.slope_sigma_percent
            )  # fmt: skip
            assert (row.drives, row.observations) == (len(behind), sum(b.observations for b in behind))
            shared += len(behind) > 1
    assert shared > 0


def test_a_drive_may_run_again(bench: Workbench, send: Send) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    before = state(bench)
    assert (
        process_drive(bench, drive.id, 1) is Outcome.DISCARDED
    )  # the job of a finished drive, taken up again
    ingest.reprocess(bench.sessions, drive.id)
    assert process_drive(bench, drive.id, 1) is Outcome.DISCARDED
    assert process_drive(bench, drive.id, 2) is Outcome.DONE
    assert state(bench) == before


def test_the_same_drive_twice_at_once_is_stored_once(bench: Workbench, send: Send) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    alone = state(bench)
    ingest.reprocess(bench.sessions, drive.id)
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(lambda _: process_drive(bench, drive.id, 2), range(2)))
    assert Outcome.DONE in outcomes
    assert drive_now(bench, drive.id).status == "done"
    assert state(bench) == alone


def test_another_method_replaces_the_estimates(bench: Workbench, send: Send) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    raw = state(bench)
    ingest.reprocess(bench.sessions, drive.id, "dem")
    process_drive(bench, drive.id, 2)
    dem = state(bench)
    assert dem != raw
    ingest.reprocess(bench.sessions, drive.id, "raw")
    process_drive(bench, drive.id, 3)
    assert state(bench) == raw


BAD = {
    "empty": b"",
    "png": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "csv without columns": b"time_s,speed_mps\n1,2\n",
    "latitude 91": b"time_s,lat_deg,lon_deg\n1317376800,91,8\n1317376801,91,8\n",
    "impossible time": b"time_s,lat_deg,lon_deg\n1e300,49,8\nnan,49,8\n",
    "three epochs": b"time_s,lat_deg,lon_deg\n" + b"".join(b"13173768%02d,49,8\n" % k for k in range(3)),
    "far away": b"time_s,lat_deg,lon_deg\n" + b"".join(b"13173768%02d,-10,-20\n" % k for k in range(9)),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_fails_with_a_sentence(bench: Workbench, send: Send, name: str) -> None:
    drive = send(BAD[name])
    assert process_drive(bench, drive.id, 1) is Outcome.FAILED
    failed = drive_now(bench, drive.id)
    assert failed.status == "failed"
    assert failed.failure_kind not in (None, "internal")
    assert failed.failure_reason is not None
    assert failed.failure_reason.endswith((".", ")", "?"))
    assert " " in failed.failure_reason
    assert failed.stage
    assert failed.finished_at is not None
    assert state(bench) == []


def test_without_roads_a_drive_fails_and_says_so(sessions: Sessions, files: Path, tmp_path: Path) -> None:
    bench = Workbench(sessions, BlobStore(str(tmp_path)), tmp_path / "dem")
    content = (files / "0.csv").read_bytes()
    drive, _ = ingest.accept_upload(sessions, bench.blobs, [content], filename="x", method="raw")
    assert process_drive(bench, drive.id, 1) is Outcome.FAILED
    assert "import-roads" in str(drive_now(bench, drive.id).failure_reason)


def test_a_lost_blob_fails_and_says_so(bench: Workbench, send: Send) -> None:
    drive = send(0)
    bench.blobs.delete(drive.blob_key)
    assert process_drive(bench, drive.id, 1) is Outcome.FAILED
    assert "upload it again" in str(drive_now(bench, drive.id).failure_reason)


def test_a_failed_rerun_leaves_what_was_published(bench: Workbench, send: Send) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    before = state(bench)
    ingest.reprocess(bench.sessions, drive.id)
    bench.blobs.delete(drive.blob_key)
    assert process_drive(bench, drive.id, 2) is Outcome.FAILED
    assert state(bench) == before


@pytest.mark.parametrize(
    ("error", "kind"), [(ZeroDivisionError("secret detail"), "internal"), (MemoryError(), "out-of-memory")]
)
def test_a_fault_of_ours_is_logged_and_told_plainly(
    bench: Workbench,
    send: Send,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    error: Exception,
    kind: str,
) -> None:
    def fail(*args: Any, **kwargs: Any) -> None:
        raise error

    monkeypatch.setattr(process, "run_drive", fail)
    drive = send(0)
    assert process_drive(bench, drive.id, 1) is Outcome.FAILED
    failed = drive_now(bench, drive.id)
    assert failed.failure_kind == kind
    assert failed.failure_reason is not None
    assert "secret" not in failed.failure_reason
    assert str(drive.id) in caplog.text


class Disturbed:
    """``run_drive`` with something happening in the middle, the first time only."""

    def __init__(self, disturb: Callable[[], object]) -> None:
        self.disturb = disturb
        self.runs = 0

    def __call__(self, *args: Any, progress: Progress, **kwargs: Any) -> Any:
        self.runs += 1
        if self.runs == 1:
            progress("filter", 0.4)
            self.disturb()
        return run_drive(*args, progress=progress, **kwargs)


def test_a_drive_deleted_while_it_runs_is_discarded(
    bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    remove = Disturbed(lambda: ingest.remove_drive(bench.sessions, bench.blobs, drive.id))
    monkeypatch.setattr(process, "run_drive", remove)
    assert process_drive(bench, drive.id, 1) is Outcome.DISCARDED
    assert remove.runs == 1
    assert state(bench) == []
    with bench.sessions() as session:
        for table in ("drives", "drive_tracks", "provenances", "segment_slopes"):
            assert session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one() == 0


def test_a_drive_asked_for_anew_while_it_runs_is_discarded(
    bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    again = Disturbed(lambda: ingest.reprocess(bench.sessions, drive.id, "dem"))
    monkeypatch.setattr(process, "run_drive", again)
    assert process_drive(bench, drive.id, 1) is Outcome.DISCARDED
    assert drive_now(bench, drive.id).status == "queued"
    assert process_drive(bench, drive.id, 2) is Outcome.DONE
    assert drive_now(bench, drive.id).method == "dem"


def test_roads_imported_while_a_drive_runs_are_the_ones_it_ends_with(
    bench: Workbench, send: Send, files: Path, town: Town, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    process_drive(bench, drive.id, 1)
    (driven,) = {row[1] for row in state(bench)[:1]}
    # The same map with one driven way taken out: its segments' ids are gone when the result is written.
    whole = (files / "town.osm").read_text()
    begin = whole.index(f'<way id="{driven}"')
    end = whole.index("</way>", begin) + len("</way>")
    (tmp_path / "less.osm").write_text(whole[:begin] + whole[end:])
    ingest.reprocess(bench.sessions, drive.id)
    reimport = Disturbed(lambda: ingest.import_roads(bench.sessions, tmp_path / "less.osm", bench.dem_dir))
    monkeypatch.setattr(process, "run_drive", reimport)
    assert process_drive(bench, drive.id, 2) is Outcome.DONE
    assert reimport.runs == 2
    disturbed = state(bench)
    assert driven not in {row[1] for row in disturbed}
    ingest.reprocess(bench.sessions, drive.id)
    process_drive(bench, drive.id, 3)
    assert state(bench) == disturbed


def test_a_worker_that_stops_puts_its_drive_back(bench: Workbench, send: Send) -> None:
    drive = send(0)
    with pytest.raises(Interrupted):
        process_drive(bench, drive.id, 1, should_stop=lambda: True)
    assert drive_now(bench, drive.id).status == "queued"
    assert process_drive(bench, drive.id, 1) is Outcome.DONE


def test_a_lost_connection_is_no_failure_of_the_drive(
    bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch, database_url: str
) -> None:
    def cut() -> None:
        with bench.sessions() as session:
            session.execute(
                text("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() "
                     "AND datname = current_database()")
            )  # fmt: skip

    drive = send(0)
    genuine = slopes.save_result

    def save(session: Any, *args: Any) -> int:
        cut()
        return genuine(session, *args)

    with monkeypatch.context() as patch:
        patch.setattr(slopes, "save_result", save)
        with pytest.raises(OperationalError) as caught:
            process_drive(bench, drive.id, 1)
    assert process.is_connection_loss(caught.value)
    assert drive_now(bench, drive.id).status == "running"
    assert state(bench) == []
    assert process_drive(bench, drive.id, 1) is Outcome.DONE


def test_a_mistake_in_sql_is_no_connection_loss(sessions: Sessions) -> None:
    with pytest.raises(Exception, match="nonsense") as caught, sessions() as session:
        session.execute(text("SELECT nonsense"))
    assert not process.is_connection_loss(caught.value)
    assert not process.is_connection_loss(psycopg.DataError())


def test_progress_grows_and_is_written_at_intervals(
    bench: Workbench, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[str, float]] = []
    genuine = drives.set_progress

    def note(session: Any, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
        seen.append((stage, progress))
        return genuine(session, drive_id, generation, stage, progress)

    monkeypatch.setattr(drives, "set_progress", note)
    process_drive(bench, send(0, "particle", {"particles": 300}).id, 1)
    throttled = list(seen)
    seen.clear()
    monkeypatch.setattr(reporting, "PROGRESS_EVERY_S", 0.0)
    process_drive(bench, send(1, "particle", {"particles": 300}).id, 1)
    assert len(seen) > 20
    assert len(throttled) < len(seen)
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1
    assert len({stage for stage, _ in seen}) >= 3


def test_two_drives_of_the_same_roads_at_once(bench: Workbench, send: Send, files: Path) -> None:
    made = [send(seed, "raw") for seed in range(3)]
    start = threading.Barrier(3)

    def run(drive: DriveRow) -> Outcome:
        start.wait()
        return process_drive(bench, drive.id, 1)

    with ThreadPoolExecutor(3) as pool:
        assert set(pool.map(run, made)) == {Outcome.DONE}
    at_once = state(bench)
    for drive in made:
        ingest.remove_drive(bench.sessions, bench.blobs, drive.id)
    assert state(bench) == []
    for seed in (2, 0, 1):
        process_drive(bench, send(seed, "raw").id, 1)
    assert state(bench) == at_once
