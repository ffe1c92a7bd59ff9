"""A drive whose log and whose elevation model are in a bucket."""

from __future__ import annotations

from pathlib import Path

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.drives.process import Outcome, process_drive
from app.jobs.context import JobContext
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from processing_support import accept_upload, drive_now


def test_a_worker_that_shares_nothing_but_the_bucket_computes_the_drive(
    sessions: Sessions, files: Path, bucket: str, tmp_path: Path
) -> None:
    urls = {"blob_url": f"{bucket}/logs", "dem_url": f"{bucket}/dem"}
    here = Settings(data_dir=tmp_path / "here", **urls)
    road_imports.import_roads(sessions, files / "town.osm", here.dem_dir)
    dem_imports.import_dem(sessions, [files / "town.tif"], here.dem_dir)
    log = (files / "1.csv").read_bytes()
    drive, _ = accept_upload(sessions, BlobStore(here.blob_store_url), [log], filename="log", method="dem")

    there = JobContext(Settings(data_dir=tmp_path / "there", **urls), sessions)
    assert process_drive(there, drive.id, 1) is Outcome.DONE
    report = drive_now(there, drive.id).report
    assert report is not None
    assert report["segments_estimated"] > 5
    assert [path.name for path in (tmp_path / "there").rglob("*.tif")] == ["town.tif"]
