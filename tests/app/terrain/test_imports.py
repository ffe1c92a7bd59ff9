"""The set of elevation rasters."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil
from affine import Affine

from app.core.db import Sessions
from app.map import store as map_store
from app.network import cells
from app.terrain import files, heights
from app.terrain import imports as dem
from app.terrain import store as dem_store
from app.terrain.files import Limits
from app.terrain.store import DemSet, current_dem
from fusion.errors import TerrainError
from fusion.roads.table import RoadTable
from road_support import replace_roads

STEP_DEG = 1 / 1200


def write_raster(path: Path, west: float, north: float, rise_m: float, size: int = 24) -> Path:
    """A plane that rises by ``rise_m`` per post towards the east."""
    heights = np.tile(100 + rise_m * np.arange(size, dtype=np.float32), (size, 1))
    with rasterio.open(
        path, "w", driver="GTiff", width=size, height=size, count=1, dtype="float32", crs="EPSG:4326",
        transform=Affine(STEP_DEG, 0, west, 0, -STEP_DEG, north), nodata=-9999,
    ) as raster:  # fmt: skip
        raster.write(heights, 1)
    return path


def add(sessions: Sessions, paths: list[Path], folder: Path, *, trusted: bool = False) -> DemSet:
    return dem.import_dem(sessions, paths, folder, limits=Limits(trusted=trusted))


def stored_slopes(sessions: Sessions) -> list[float | None]:
    with sessions() as session:
        return [row.dem_slope_percent for row in map_store.all_segments(session)]


@pytest.fixture
def chain_in_db(sessions: Sessions, chain: Callable[..., RoadTable]) -> RoadTable:
    """Ten segments from 8.500 to 8.510 E at 49 N."""
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64)
    return chain()


def test_slopes_of_the_covered_segments_are_renewed(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path
) -> None:
    with sessions() as session:
        assert current_dem(session, tmp_path) is None
        version = cells.data_version(session)
    assert stored_slopes(sessions) == [None] * 10
    east = write_raster(tmp_path / "east.tif", 8.5055, 49.01, 2.0)
    found = add(sessions, [east], tmp_path / "dem")
    run_m = STEP_DEG / 0.001 * chain_in_db.length_m[0]
    assert stored_slopes(sessions)[:5] == [None] * 5
    assert stored_slopes(sessions)[7:] == pytest.approx([200 / run_m] * 3, rel=1e-3)
    assert found.names == ("east.tif",)
    with sessions() as session:
        assert cells.data_version(session) > version

    west = write_raster(tmp_path / "west.tif", 8.4915, 49.01, -1.0)
    found = add(sessions, [west], tmp_path / "dem")
    assert found.names == ("east.tif", "west.tif")
    assert stored_slopes(sessions)[:4] == pytest.approx([-100 / run_m] * 4, rel=1e-3)
    assert stored_slopes(sessions)[7:] == pytest.approx([200 / run_m] * 3, rel=1e-3)


def test_the_same_raster_again_changes_nothing(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path
) -> None:
    path = write_raster(tmp_path / "a.tif", 8.49, 49.01, 1.0)
    first = add(sessions, [path, path], tmp_path / "dem")
    with sessions() as session:
        version = cells.data_version(session)
    assert add(sessions, [path], tmp_path / "dem") == first
    assert first.names == ("a.tif",)
    with sessions() as session:
        assert cells.data_version(session) == version


def test_a_raster_of_the_same_name_takes_the_others_place(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path
) -> None:
    path = write_raster(tmp_path / "a.tif", 8.4995, 49.01, 1.0)
    first = add(sessions, [path], tmp_path / "dem")
    assert all(value is not None for value in stored_slopes(sessions))
    write_raster(path, 12.0, 49.01, 1.0)
    second = add(sessions, [path], tmp_path / "dem")
    assert second.names == ("a.tif",)
    assert second.version_id > first.version_id
    assert stored_slopes(sessions) == [None] * 10
    assert all(file.is_file() for file in first.paths)  # a drive that runs may still read it


def test_a_raster_made_of_several_files_becomes_one(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path
) -> None:
    tile = write_raster(tmp_path / "tile.tif", 8.4995, 49.01, 1.0)
    mosaic = tmp_path / "mosaic.vrt"
    rasterio.shutil.copy(tile, mosaic, driver="VRT")
    with pytest.raises(TerrainError, match=r"mosaic\.vrt is a VRT, which names other files"):
        add(sessions, [mosaic], tmp_path / "dem")
    found = add(sessions, [mosaic], tmp_path / "dem", trusted=True)
    tile.unlink()
    mosaic.unlink()
    with sessions() as session:
        again, _ = heights.terrain_under(dem_store.current_dem(session, tmp_path / "dem"), chain_in_db)
    assert found.names == ("mosaic.tif",)
    assert np.isfinite(again).all()
    assert stored_slopes(sessions) == pytest.approx(again.tolist())


@pytest.mark.parametrize("content", [b"", b"no raster", b"\x89PNG\r\n\x1a\n"])
def test_a_file_that_is_no_raster_is_refused_and_not_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.tif"
    path.write_bytes(content)
    with pytest.raises(TerrainError, match=r"bad\.tif"):
        files.store_files([path], tmp_path / "dem")
    assert [file for file in (tmp_path / "dem").rglob("*") if file.is_file()] == []


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TerrainError, match=r"none\.tif"):
        files.store_files([tmp_path / "none.tif"], tmp_path / "dem")


def test_a_moved_folder_still_serves(sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path) -> None:
    add(sessions, [write_raster(tmp_path / "a.tif", 8.4995, 49.01, 1.0)], tmp_path / "dem")
    (tmp_path / "dem").rename(tmp_path / "elsewhere")
    with sessions() as session:
        slope, height_m = heights.terrain_under(
            dem_store.current_dem(session, tmp_path / "elsewhere"), chain_in_db
        )
    assert np.isfinite(slope).all()
    assert np.isfinite(height_m).all()


def hgt(height_m: int) -> bytes:
    """An SRTM tile of 3 arc seconds, level."""
    return np.full((1201, 1201), height_m, ">i2").tobytes()


def test_a_gzipped_tile_is_unpacked_and_its_name_counts_in_any_case(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path
) -> None:
    packed, plain = tmp_path / "N49E008.hgt.gz", tmp_path / "n49e008.HGT"
    packed.write_bytes(gzip.compress(hgt(100)))
    first = add(sessions, [packed], tmp_path / "dem")
    assert first.names == ("N49E008.hgt",)
    assert first.paths[0].read_bytes() == hgt(100)
    plain.write_bytes(hgt(200))
    assert add(sessions, [plain], tmp_path / "dem").names == ("n49e008.HGT",)
    assert stored_slopes(sessions) == [0.0] * 10


def test_a_damaged_or_void_tile_is_refused_and_not_kept(tmp_path: Path) -> None:
    (tmp_path / "N49E008.hgt.gz").write_bytes(gzip.compress(hgt(100))[:-20])
    (tmp_path / "N49E009.hgt").write_bytes(hgt(-32768))
    (tmp_path / "N49E010.hgt.gz").write_bytes(gzip.compress(b"text"))
    for name, says in (
        ("N49E008.hgt.gz", "cannot be unpacked"),
        ("N49E009.hgt", "holds no height"),
        ("N49E010.hgt.gz", "cannot be read as a raster"),
    ):
        with pytest.raises(TerrainError, match=says) as caught:
            files.store_files([tmp_path / name], tmp_path / "dem")
        assert ".. " not in str(caught.value)
    assert [file for file in (tmp_path / "dem").rglob("*") if file.is_file()] == []
