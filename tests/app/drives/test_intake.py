"""Uploads, reruns, removals and imports: what one call does as a whole."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.drives import intake, queue
from app.drives import store as drives
from app.drives.documents import Drive
from app.map import store as slopes
from app.network import extracts as roads
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from app.terrain import store as dem
from fusion.errors import BadOptionsError, RoadsError, TerrainError, UnknownNameError
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from processing_support import accept_upload, carry_out_removals, put_blob

Upload = Callable[..., tuple[Drive, bool]]


@pytest.fixture
def sessions(database_url: str) -> Iterator[Sessions]:
    engine = make_engine(database_url)
    yield session_factory(engine)
    engine.dispose()


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore(str(tmp_path / "blobs"))


@pytest.fixture
def upload(sessions: Sessions, blobs: BlobStore) -> Upload:
    def send(content: bytes = b"a log", **options: Any) -> tuple[Drive, bool]:
        whole = {"filename": "log.csv", "method": "raw"} | options
        return accept_upload(sessions, blobs, [content], **whole)

    return send


def jobs(sessions: Sessions) -> list[tuple[str, int, str]]:
    query = text(
        "SELECT args->>'drive_id', (args->>'generation')::int, status::text FROM procrastinate_jobs ORDER BY id"
    )
    with sessions() as session:
        return [(row[0], row[1], row[2]) for row in session.execute(query)]


def test_an_upload_is_a_row_a_blob_and_a_job(sessions: Sessions, blobs: BlobStore, upload: Upload) -> None:
    drive, created = upload(b"a log", options={"min_epochs": 5})
    assert created
    assert (drive.status, drive.size_bytes, drive.method, drive.options) == (
        "queued",
        5,
        "raw",
        {"min_epochs": 5},
    )
    assert blobs.keys() == [drive.blob_key]
    assert jobs(sessions) == [(str(drive.id), 1, "todo")]


def test_known_bytes_add_nothing(sessions: Sessions, blobs: BlobStore, upload: Upload) -> None:
    first, _ = upload()
    second, created = upload(method="dem")
    assert (second, created) == (first, False)
    assert blobs.keys() == [first.blob_key]
    assert len(jobs(sessions)) == 1


def test_known_bytes_at_the_same_moment_add_nothing(
    sessions: Sessions, blobs: BlobStore, upload: Upload
) -> None:
    start = threading.Barrier(4)

    def send(_: int) -> tuple[Drive, bool]:
        start.wait()
        return upload()

    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(send, range(4)))
    assert sum(created for _, created in results) == 1
    assert len(jobs(sessions)) == 1
    assert blobs.keys() == [results[0][0].blob_key]


@pytest.mark.parametrize("broken", ["enqueue", "create_drive"])
def test_a_transaction_that_fails_leaves_neither_row_nor_job_nor_blob(
    sessions: Sessions, blobs: BlobStore, upload: Upload, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    module = {"enqueue": queue, "create_drive": drives}[broken]
    genuine = getattr(module, broken)

    def fail(*args: Any, **kwargs: Any) -> None:
        genuine(*args, **kwargs)
        raise OSError("the power is gone")

    monkeypatch.setattr(module, broken, fail)
    with pytest.raises(OSError, match="power"):
        upload()
    assert jobs(sessions) == []
    assert blobs.keys() == []
    with sessions() as session:
        assert drives.list_drives(session) == []


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"method": "nonsense"}, UnknownNameError),
        ({"options": {"nonsense": 1}}, BadOptionsError),
    ],
)
def test_a_refused_upload_leaves_nothing(
    sessions: Sessions, blobs: BlobStore, upload: Upload, options: dict[str, Any], error: type[Exception]
) -> None:
    with pytest.raises(error):
        upload(**options)
    assert blobs.keys() == []
    assert jobs(sessions) == []


def test_reprocess_queues_a_new_generation(sessions: Sessions, upload: Upload) -> None:
    drive, _ = upload(options={"min_epochs": 5})
    again = intake.reprocess(sessions, drive.id)
    assert again is not None
    assert (again.generation, again.method, again.options) == (2, "raw", {"min_epochs": 5})
    other = intake.reprocess(sessions, drive.id, "dem")
    assert other is not None
    assert (other.generation, other.method, other.options) == (3, "dem", {})
    assert [generation for _, generation, _ in jobs(sessions)] == [1, 2, 3]
    assert intake.reprocess(sessions, uuid.uuid4()) is None
    with pytest.raises(BadOptionsError):
        intake.reprocess(sessions, drive.id, "dem", {"min_epochs": 5})
    assert len(jobs(sessions)) == 3


def test_a_removed_drive_is_gone_with_its_bytes(sessions: Sessions, blobs: BlobStore, upload: Upload) -> None:
    drive, _ = upload()
    assert intake.remove_drive(sessions, drive.id)
    again, created = upload()  # the same bytes before it is gone
    assert created
    assert again.id != drive.id
    carry_out_removals(sessions, blobs)
    assert not intake.remove_drive(sessions, drive.id)
    assert blobs.keys() == [again.blob_key]


def test_orphans_are_swept_and_nothing_else(sessions: Sessions, blobs: BlobStore, upload: Upload) -> None:
    drive, _ = upload()
    put_blob(blobs, [b"its process died before the row"])
    hour = timedelta(hours=1)
    assert intake.sweep_blobs(sessions, blobs, hour).removed == 0, (
        "it may be an upload that is just being registered"
    )
    assert intake.sweep_blobs(sessions, blobs, timedelta(0)).removed == 1
    assert blobs.keys() == [drive.blob_key]


def test_an_upload_leaves_its_databases_note(blobs: BlobStore, upload: Upload) -> None:
    """Without it, the sweep of another database in the same store would take the upload for an orphan."""
    upload()
    assert len(blobs.databases()) == 1


def test_blobs_of_another_database_are_left_alone(
    sessions: Sessions, blobs: BlobStore, caplog: pytest.LogCaptureFixture
) -> None:
    blobs.register_database("another-1")
    theirs = put_blob(blobs, [b"a drive of the other database"])
    assert intake.sweep_blobs(sessions, blobs, timedelta(0)).removed == 0
    assert blobs.keys() == [theirs.key]
    assert "another-1" in caplog.text


def test_roads_and_elevation_in_either_order(sessions: Sessions, town: Town, tmp_path: Path) -> None:
    write_osm(town, tmp_path / "town.osm")
    write_dem(town, tmp_path / "town.tif")

    def import_roads() -> None:
        road_imports.import_roads(sessions, tmp_path / "town.osm", tmp_path / "dem")

    def import_dem() -> None:
        dem_imports.import_dem(sessions, [tmp_path / "town.tif"], tmp_path / "dem")

    def stored() -> dict[tuple[int, int, int], float | None]:
        with sessions() as session:
            rows = list(slopes.all_segments(session))
        return {(row.osm_way_id, row.from_node, row.to_node): row.dem_slope_percent for row in rows}

    import_roads()
    assert set(stored().values()) == {None}
    import_dem()
    roads_first = stored()
    with sessions.begin() as session:
        session.execute(text("DELETE FROM segments"))
    import_roads()
    assert stored() == roads_first
    assert sum(value is not None for value in roads_first.values()) > len(roads_first) / 2


def test_a_map_without_roads_is_refused(sessions: Sessions, tmp_path: Path, town: Town) -> None:
    write_osm(town, tmp_path / "town.osm")
    road_imports.import_roads(sessions, tmp_path / "town.osm", tmp_path / "dem")
    (tmp_path / "empty.osm").write_text('<osm version="0.6"></osm>')
    with pytest.raises(RoadsError):
        road_imports.import_roads(sessions, tmp_path / "empty.osm", tmp_path / "dem")
    with sessions() as session:
        assert len(roads.all_roads(session)[0]) == len(town.roads)


def test_an_elevation_import_of_nothing_is_refused(sessions: Sessions, tmp_path: Path) -> None:
    with pytest.raises(TerrainError):
        dem_imports.import_dem(sessions, [], tmp_path)
    with sessions() as session:
        assert dem.current_dem(session, tmp_path) is None
