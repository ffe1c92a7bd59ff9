"""Rasters that a request brought: within limits, with room on the disk, and given up when that is asked for."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import rasterio
from affine import Affine

from app.core.errors import StorageFullError
from app.core.settings import Settings
from app.terrain import files
from app.terrain.files import Limits, operator_limits, request_limits
from fusion.errors import TerrainError
from fusion.terrain.drivers import HGT_MOST_BYTES

MIB = 2**20


class Disk(NamedTuple):
    """What ``shutil.disk_usage`` tells."""

    total: int
    used: int
    free: int


def sparse(path: Path, side: int, height_m: int | None = None) -> Path:
    """A GeoTIFF of kilobytes with side x side posts, of which one tile may have heights."""
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "int16", "crs": 4326}
    tiled = {"tiled": True, "blockxsize": 512, "blockysize": 512, "sparse_ok": True, "compress": "deflate"}
    posts = Affine(1e-5, 0, 8.4, 0, -1e-5, 49.1)
    with rasterio.open(path, "w", transform=posts, nodata=-9999, **profile, **tiled) as raster:
        if height_m is not None:
            raster.write(np.full((512, 512), height_m, np.int16), 1, window=((0, 512), (0, 512)))
    return path


def left(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_posts_are_counted_in_the_header(tmp_path: Path) -> None:
    path, place = sparse(tmp_path / "a.tif", 20_000, 100), tmp_path / "dem"
    with pytest.raises(TerrainError, match=r"20000 x 20000 posts.*VERSANT_MAX_RASTER_POSTS"):
        files.store_files([path], place, limits=Limits(max_posts=10**8))
    assert left(place) == []
    settings = Settings(data_dir=tmp_path, max_raster_posts=10**8)
    assert request_limits(settings).max_posts == 10**8
    assert not request_limits(settings).trusted
    assert files.store_files([path], place, limits=operator_limits(settings))


@pytest.mark.parametrize(("name", "mib"), [("N49E008.hgt.gz", 300), ("a.tif.gz", 70)])
def test_a_bomb_is_not_unpacked_onto_the_disk(tmp_path: Path, name: str, mib: int) -> None:
    with gzip.open(tmp_path / name, "wb") as file:
        for _ in range(mib):
            file.write(bytes(MIB))
    most = 0

    def progress(stage: str, _share: float) -> None:
        nonlocal most
        most = max([most, *(path.stat().st_size for path in left(tmp_path / "dem"))])

    with pytest.raises(TerrainError, match="unpacks to more than"):
        files.store_files([tmp_path / name], tmp_path / "dem", progress)
    assert most <= HGT_MOST_BYTES + MIB
    assert left(tmp_path / "dem") == []


def test_what_unpacks_to_more_than_is_taken_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.tif.gz").write_bytes(gzip.compress(np.random.default_rng(1).bytes(3 * MIB)))
    with pytest.raises(TerrainError, match="unpacks to more than 2 MiB"):
        files.store_files([tmp_path / "a.tif.gz"], tmp_path / "dem", limits=Limits(max_bytes=2 * MIB))


@pytest.mark.parametrize("packed", [False, True])
def test_room_stays_free_while_a_raster_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packed: bool
) -> None:
    content = np.full((1201, 1201), 7, ">i2").tobytes()
    path = tmp_path / ("N49E008.hgt.gz" if packed else "N49E008.hgt")
    path.write_bytes(gzip.compress(content) if packed else content)
    place = tmp_path / "dem"

    def usage(_: object) -> Disk:
        return Disk(0, 0, 100 * MIB - sum(file.stat().st_size for file in left(place)))

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with pytest.raises(StorageFullError):
        files.store_files([path], place, limits=Limits(keep_free_bytes=99 * MIB))
    assert left(place) == []
    assert files.store_files([path], place, limits=Limits(keep_free_bytes=97 * MIB))


class StopError(Exception):
    """The worker stops."""


@pytest.mark.parametrize("stage", ["unpacking", "copying", "checking", "looking for heights"])
def test_every_stage_asks_whether_to_go_on(tmp_path: Path, stage: str) -> None:
    content = np.full((3601, 3601), 7, ">i2").tobytes()
    path = tmp_path / ("N49E008.hgt.gz" if stage == "unpacking" else "N49E008.hgt")
    path.write_bytes(gzip.compress(content) if stage == "unpacking" else content)
    asked = 0

    def progress(said: str, share: float) -> None:
        nonlocal asked
        assert 0 <= share <= 1
        asked += (said == stage and share > 0) or said == "looking for heights"
        if asked:
            raise StopError

    with pytest.raises(StopError):
        files.store_files([path], tmp_path / "dem", progress)
    assert left(tmp_path / "dem") == []


def test_a_format_of_the_operator_s_becomes_one_that_is_read_alone(tmp_path: Path) -> None:
    sparse(tmp_path / "a.tif", 512, 100)
    rasterio.shutil.copy(tmp_path / "a.tif", tmp_path / "a.img", driver="HFA")
    with pytest.raises(TerrainError, match="neither a GeoTIFF"):
        files.store_files([tmp_path / "a.img"], tmp_path / "dem")
    (kept,) = files.store_files([tmp_path / "a.img"], tmp_path / "dem", limits=Limits(trusted=True))
    assert kept.name == "a.tif"
    assert files.bounds_deg(tmp_path / "dem" / kept.uri) == pytest.approx((8.4, 49.09488, 8.40512, 49.1))
