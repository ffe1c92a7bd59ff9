"""Elevation rasters that are kept in a bucket and read through copies on each machine."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
import rasterio
from affine import Affine

from app.core import mirror
from app.core.db import Sessions
from app.core.settings import Settings
from app.core.settings.places import RemoteFolder
from app.terrain import heights
from app.terrain import imports as dem
from app.terrain.store import DemSet, current_dem
from fusion.errors import TerrainError
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from road_support import replace_roads

STEP_DEG = 1 / 1200


def write_raster(path: Path, values: np.ndarray) -> Path:
    with rasterio.open(
        path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, dtype=values.dtype,
        crs="EPSG:4326", transform=Affine(STEP_DEG, 0, 8.4995, 0, -STEP_DEG, 49.01),
    ) as raster:  # fmt: skip
        raster.write(values, 1)
    return path


@pytest.fixture
def raster(tmp_path: Path) -> Path:
    """A plane that rises towards the east, and its quality layer beside it."""
    write_raster(tmp_path / "N49_num.tif", np.full((24, 24), 7, np.int16))
    heights = np.tile(100 + np.arange(24, dtype=np.int16), (24, 1))
    return write_raster(tmp_path / "N49_dem.tif", heights)


@pytest.fixture
def machine(bucket: str, tmp_path: Path) -> Callable[[str], RemoteFolder]:
    """``machine(name)``: the bucket as that machine sees it, by the settings."""

    def make(name: str) -> RemoteFolder:
        place = Settings(data_dir=tmp_path / name, dem_url=f"{bucket}/dem").dem_dir
        assert isinstance(place, RemoteFolder)
        return place

    return make


def fetching(patch: pytest.MonkeyPatch, fetch: Callable[[Any, str, str], object]) -> None:
    """Let files come from the bucket by ``fetch(fs, path, target)``."""
    genuine = mirror.file_system

    class Watched:
        def __init__(self, fs: Any) -> None:
            self.fs = fs

        def __getattr__(self, name: str) -> Any:
            return getattr(self.fs, name)

        def get_file(self, path: str, target: str) -> None:
            fetch(self.fs, path, target)

    def watched(url: str) -> tuple[Any, str]:
        fs, root = genuine(url)
        return Watched(fs), root

    patch.setattr(mirror, "file_system", watched)


def add(sessions: Sessions, path: Path, place: RemoteFolder) -> DemSet:
    return dem.import_dem(sessions, [path], place)


def seen_by(sessions: Sessions, place: RemoteFolder) -> DemSet:
    with sessions() as session:
        found = current_dem(session, place)
    assert found is not None
    return found


def test_a_raster_that_one_machine_imported_is_read_on_another(
    sessions: Sessions, raster: Path, machine: Callable[[str], RemoteFolder], chain: Callable[..., RoadTable]
) -> None:
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64)
    add(sessions, raster, machine("first"))
    found = seen_by(sessions, machine("second"))
    assert found.names == ("N49_dem.tif",)
    assert not (machine("second").copies).exists(), "names alone need no copy"
    with Dem.open(found.paths) as terrain:
        assert terrain.without_quality == (), "its quality layer comes with it"
    assert found.paths[0].read_bytes() == raster.read_bytes()
    assert found.paths[0].is_relative_to(machine("second").copies)
    with sessions() as session:
        slope, height_m = heights.terrain_under(current_dem(session, machine("third")), chain())
    assert np.isfinite(slope).all()
    assert np.isfinite(height_m).all()


def test_a_copy_is_fetched_once_by_all_who_ask_at_the_same_moment(
    sessions: Sessions,
    raster: Path,
    machine: Callable[[str], RemoteFolder],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    add(sessions, raster, machine("first"))
    found = seen_by(sessions, machine("second"))
    fetched: list[str] = []

    def counted(fs: Any, path: str, target: str) -> None:
        fetched.append(path.rsplit("/", 1)[-1])
        fs.get_file(path, target)

    fetching(monkeypatch, counted)
    with ThreadPoolExecutor(8) as pool:
        paths = list(pool.map(lambda _: found.paths, range(8)))
    assert fetched == ["N49_num.tif", "N49_dem.tif"]
    assert all(path.is_file() for (path,) in paths)
    assert list((machine("second").copies / "incoming").iterdir()) == []


def test_a_copy_that_breaks_off_is_not_there(
    sessions: Sessions,
    raster: Path,
    machine: Callable[[str], RemoteFolder],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    add(sessions, raster, machine("first"))
    found = seen_by(sessions, machine("second"))

    def half(fs: Any, path: str, target: str) -> None:
        Path(target).write_bytes(b"half")
        raise ConnectionError("reset")

    with monkeypatch.context() as patch:
        fetching(patch, half)
        with pytest.raises(TerrainError, match="VERSANT_DEM_URL"):
            _ = found.paths
        fetching(patch, lambda fs, path, target: Path(target).write_bytes(b"half"))
        with pytest.raises(TerrainError, match="its content is another one"):
            _ = found.paths
    left = [path.name for path in machine("second").copies.rglob("*.tif")]
    assert left == []
    assert found.paths[0].is_file()


def test_a_raster_that_is_gone_from_the_bucket_is_said(
    sessions: Sessions, raster: Path, bucket: str, machine: Callable[[str], RemoteFolder]
) -> None:
    add(sessions, raster, machine("first"))
    fsspec.filesystem("s3").rm(f"{bucket}/dem", recursive=True)
    with pytest.raises(TerrainError, match=r"N49_dem\.tif cannot be fetched .* it is not there\. See to"):
        _ = seen_by(sessions, machine("second")).paths


def test_a_raster_that_cannot_be_sent_is_not_referred_to(
    sessions: Sessions, raster: Path, bucket: str, tmp_path: Path
) -> None:
    nowhere = RemoteFolder(f"{bucket}-mistyped/dem", tmp_path / "copies")
    with pytest.raises(TerrainError, match=r"N49_dem\.tif cannot be kept: .*VERSANT_DEM_URL"):
        add(sessions, raster, nowhere)
    with sessions() as session:
        assert current_dem(session, nowhere) is None


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_a_folder_needs_no_copies(tmp_path: Path, scheme: str) -> None:
    assert Settings(dem_url=f"{scheme}{tmp_path}/shared").dem_dir == tmp_path / "shared"
    assert Settings(data_dir=tmp_path).dem_dir == tmp_path / "dem"
