"""Files that are no elevation: one clear sentence each, with the file's name in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from fusion.errors import TerrainError
from fusion.terrain.dem import Dem
from fusion.terrain.raster import refuse_void

Write = Callable[..., Path]
POSTS = Affine(0.001, 0, 8.0, 0, -0.001, 49.0)


def refused(path: Path, *, trusted: bool = False) -> str:
    with pytest.raises(TerrainError) as caught:
        Dem.open([path], trusted=trusted)
    assert path.name in str(caught.value)
    return str(caught.value)


def test_nothing_given() -> None:
    with pytest.raises(TerrainError, match="at least one"):
        Dem.open([])


def test_missing_empty_and_foreign_files(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "absent.tif")
    assert "Is a directory" in refused(tmp_path)
    (tmp_path / "empty.tif").write_bytes(b"")
    assert "is empty" in refused(tmp_path / "empty.tif")
    (tmp_path / "text.tif").write_text("no raster at all")
    assert "cannot be read as a raster" in refused(tmp_path / "text.tif")


@pytest.mark.parametrize("size", [100, 2_884_800])
def test_an_hgt_of_a_wrong_size(tmp_path: Path, size: int) -> None:
    (tmp_path / "N48E008.hgt").write_bytes(bytes(size))
    assert "cannot be read as a raster" in refused(tmp_path / "N48E008.hgt")


def test_an_hgt_without_its_name(tmp_path: Path, write_hgt: Write) -> None:
    assert "such as N48E008.hgt" in refused(write_hgt(tmp_path / "mine.hgt", np.zeros((1201, 1201))))


def test_a_picture(tmp_path: Path) -> None:
    profile = {"driver": "PNG", "width": 4, "height": 4, "count": 3, "dtype": "uint8"}
    with (
        pytest.warns(rasterio.errors.NotGeoreferencedWarning),
        rasterio.open(tmp_path / "a.png", "w", **profile) as dataset,
    ):
        dataset.write(np.zeros((3, 4, 4), np.uint8))
    assert "does not say where on Earth" in refused(tmp_path / "a.png", trusted=True)
    assert "neither a GeoTIFF" in refused(tmp_path / "a.png")


def test_a_georeferenced_picture(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "width": 4, "height": 4, "count": 3, "dtype": "uint8", "photometric": "RGB"}
    with rasterio.open(tmp_path / "a.tif", "w", crs="EPSG:4326", transform=POSTS, **profile) as dataset:
        dataset.write(np.zeros((3, 4, 4), np.uint8))
    assert "is a picture" in refused(tmp_path / "a.tif")


def test_complex_numbers(tmp_path: Path, write_raster: Write) -> None:
    assert "is a picture" in refused(write_raster(tmp_path / "a.tif", np.zeros((4, 4), np.complex64), POSTS))


def test_a_local_coordinate_system(tmp_path: Path, write_raster: Write) -> None:
    crs = 'LOCAL_CS["my field",UNIT["metre",1]]'
    assert "neither geographic nor projected" in refused(
        write_raster(tmp_path / "a.tif", np.zeros((4, 4)), POSTS, crs)
    )


def test_damage_that_shows_only_when_heights_are_read(tmp_path: Path, write_raster: Write) -> None:
    z = np.random.default_rng(0).normal(size=(400, 400))
    path = write_raster(tmp_path / "cut.tif", z, POSTS)
    broken = bytearray(path.read_bytes())
    broken[2000:-4000] = b"\x55" * (len(broken) - 6000)  # the heights, not the header or the directory
    path.write_bytes(broken)
    with Dem.open([path]) as dem, pytest.raises(TerrainError, match=r"cut\.tif is damaged"):
        dem.heights(8.2, 48.8)


def test_a_file_that_vanishes(tmp_path: Path, write_raster: Write) -> None:
    path = write_raster(tmp_path / "gone.tif", np.zeros((4, 4)), POSTS)
    with Dem.open([path]) as dem:
        path.unlink()
        with pytest.raises(TerrainError, match=r"gone\.tif cannot be read"):
            dem.heights(8.001, 48.999)


def test_a_raster_without_one_height(tmp_path: Path, write_raster: Write) -> None:
    z = np.full((5, 600), -9999.0)
    empty = write_raster(tmp_path / "void.tif", z, POSTS, nodata=-9999)
    with pytest.raises(TerrainError, match=r"void\.tif holds no height: all of its 5 x 600 posts"):
        refuse_void(empty)
    z[4, 599] = 0.0
    refuse_void(write_raster(tmp_path / "sea.tif", z, POSTS, nodata=-9999))


def test_damaged_gzip(tmp_path: Path) -> None:
    (tmp_path / "N48E008.hgt.gz").write_bytes(b"\x1f\x8bno gzip")
    said = refused(tmp_path / "N48E008.hgt.gz")
    assert "cannot be read as a raster" in said and "vsigzip" not in said
    (tmp_path / "mine.hgt.gz").write_bytes(b"\x1f\x8b")
    assert "such as N48E008.hgt" in refused(tmp_path / "mine.hgt.gz")
