"""A backup of a service whose logs and rasters are in a bucket, brought back into another one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fsspec
import numpy as np
import rasterio
from affine import Affine

from app.core import databases
from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.terrain.imports import import_dem
from app.terrain.store import current_dem
from app.upkeep.backup import back_up
from app.upkeep.doctor import Patient, examine
from app.upkeep.restore import checked, restore
from processing_support import accept_upload


def raster(path: Path) -> Path:
    with rasterio.open(
        path, "w", driver="GTiff", width=8, height=8, count=1, dtype="float32", crs="EPSG:4326",
        transform=Affine(0.01, 0, 8, 0, -0.01, 49),
    ) as dataset:  # fmt: skip
        dataset.write(np.full((8, 8), 100, np.float32), 1)
    return path


def test_from_one_bucket_into_another(
    sessions: Sessions, database_url: str, bucket: str, tmp_path: Path, cluster: EmbeddedPostgres,
    new_database: Callable[[str], str],
) -> None:  # fmt: skip
    def settings(url: str, name: str) -> Settings:
        urls = {"blob_url": f"{bucket}/{name}/logs", "dem_url": f"{bucket}/{name}/dem"}
        return Settings(database_url=url, data_dir=tmp_path / name, **urls)

    here = settings(database_url, "here")
    drive, _ = accept_upload(sessions, BlobStore(here.blob_store_url), [b"log"], filename="log", method="raw")
    import_dem(sessions, [raster(tmp_path / "a.tif")], here.dem_dir)
    manifest = back_up(here, sessions, tmp_path / "copy")
    assert len(manifest.files) == 2

    name = new_database("template0")
    there = settings(cluster.url_of(name), "there")
    engine = make_engine(str(there.database_url))
    again = session_factory(engine)
    restore(there, again, tmp_path / "copy", checked(tmp_path / "copy"))
    with BlobStore(there.blob_store_url).open(drive.blob_key) as file:
        assert file.read() == b"log"
    with again() as session:
        active = current_dem(session, there.dem_dir)
    assert active is not None
    assert fsspec.filesystem("s3").exists(f"{bucket}/there/dem/{active.sources[0].uri}")
    found = {one.subject: one.state for one in examine(Patient(there, again))}
    assert (found["logs"], found["elevation"], found["room of logs"]) == ("ok", "ok", "ok")
    engine.dispose()
    databases.drop_database(cluster.url, name)
