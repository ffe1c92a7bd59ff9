"""A database that knows the simulated town, and logs of drives through it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.drives.documents import Drive
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.context import JobContext
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from processing_support import accept_upload

Send = Callable[..., Drive]


@pytest.fixture(scope="session")
def files(town: Town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the town's roads, its elevation and three logs, the first and last along one route."""
    folder = tmp_path_factory.mktemp("town")
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "town.tif")
    for day, (seed, receiver) in enumerate([(0, "m8"), (1, "m8"), (0, "f9p")]):
        begin_s = 1_700_000_000.0 + 86_400 * day
        drive = simulate_drive(town, seed, duration_s=150, receiver=receiver, start_time_s=begin_s)
        write_csv(drive, folder / f"{day}.csv")
    return folder


@pytest.fixture(scope="session")
def town_rasters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the rasters that ``town_database`` names."""
    return tmp_path_factory.mktemp("rasters")


@pytest.fixture(scope="session")
def town_database(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    files: Path,
    town_rasters: Path,
) -> str:
    """Name of a database that knows the town's roads and elevation, and that nobody is connected to."""
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    sessions = session_factory(engine)
    road_imports.import_roads(sessions, files / "town.osm", town_rasters)
    dem_imports.import_dem(sessions, [files / "town.tif"], town_rasters)
    engine.dispose()
    return name


@pytest.fixture
def context(town_database: str, town_rasters: Path, sessions: Sessions, tmp_path: Path) -> JobContext:
    """A job context whose database knows the town."""
    shutil.copytree(town_rasters, tmp_path / "dem")
    return JobContext(Settings(data_dir=tmp_path), sessions)


@pytest.fixture
def send(context: JobContext, files: Path) -> Send:
    """``send(seed or bytes, method, options)``: upload a log; returns the queued drive."""

    def upload(log: int | bytes = 0, method: str = "raw", options: dict[str, Any] | None = None) -> Drive:
        content = log if isinstance(log, bytes) else (files / f"{log}.csv").read_bytes()
        drive, _ = accept_upload(
            context.sessions, context.blobs, [content], filename="log", method=method, options=options
        )
        return drive

    return upload
