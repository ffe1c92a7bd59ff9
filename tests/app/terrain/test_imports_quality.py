"""Quality layers (ASTER's NUM files) of the stored elevation rasters."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine

from app.core.db import Sessions
from app.terrain import files
from app.terrain import imports as dem
from app.terrain.store import DemSet, current_dem
from fusion.errors import TerrainError
from fusion.terrain.dem import Dem

STEP_DEG = 1 / 3600
NAME = "ASTGTM2_N49E008"


def write_raster(path: Path, values: np.ndarray) -> Path:
    with rasterio.open(
        path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, dtype=values.dtype,
        crs="EPSG:4326", transform=Affine(STEP_DEG, 0, 8.5, 0, -STEP_DEG, 49.0),
    ) as raster:  # fmt: skip
        raster.write(values, 1)
    return path


def pair_in(folder: Path, scenes: int, size: int = 24) -> Path:
    """Elevations of 100 m, and beside them a quality layer that says ``scenes`` everywhere."""
    folder.mkdir(exist_ok=True)
    write_raster(folder / f"{NAME}_num.tif", np.full((size, size), scenes, np.int16))
    return write_raster(folder / f"{NAME}_dem.tif", np.full((24, 24), 100, np.int16))


def add(sessions: Sessions, paths: list[Path], folder: Path) -> DemSet:
    return dem.import_dem(sessions, paths, folder)


def most_scenes(found: DemSet) -> int:
    """The highest threshold at which the stored set still knows a height; 0 where it has no quality layer."""
    with Dem.open(found.paths) as terrain:
        if terrain.without_quality:
            return 0
        at = 8.5 + 10 * STEP_DEG, 49.0 - 10 * STEP_DEG
        return max(n for n in range(30) if np.isfinite(terrain.filtered(n).heights(*at)))


def test_the_quality_layer_goes_with_its_raster(sessions: Sessions, tmp_path: Path) -> None:
    original = pair_in(tmp_path / "in", 7)
    found = add(sessions, [original], tmp_path / "dem")
    assert found.names == (f"{NAME}_dem.tif",)
    for file in (tmp_path / "in").iterdir():
        file.unlink()
    assert most_scenes(found) == 7
    with sessions() as session:
        again = current_dem(session, tmp_path / "dem")
    assert again == found


def test_another_quality_layer_is_another_version_and_the_former_stays_for_who_reads_it(
    sessions: Sessions, tmp_path: Path
) -> None:
    first = add(sessions, [pair_in(tmp_path / "a", 7)], tmp_path / "dem")
    same = add(sessions, [pair_in(tmp_path / "b", 7)], tmp_path / "dem")
    assert same == first
    other = add(sessions, [pair_in(tmp_path / "c", 9)], tmp_path / "dem")
    assert (other.version_id > first.version_id, other.names) == (True, first.names)
    assert (most_scenes(first), most_scenes(other)) == (7, 9)
    (tmp_path / "c" / f"{NAME}_num.tif").unlink()
    bare = add(sessions, [tmp_path / "c" / f"{NAME}_dem.tif"], tmp_path / "dem")
    assert (bare.names, most_scenes(bare)) == (first.names, 0)
    assert most_scenes(other) == 9


@pytest.mark.parametrize("quality", [f"{NAME}_num.tif", "astgtm2_n49e008_NUM.TIFF", f"{NAME}_num.tif.gz"])
def test_a_quality_layer_may_be_named_itself_and_lie_elsewhere(
    sessions: Sessions, tmp_path: Path, quality: str
) -> None:
    """A pattern such as ASTGTM2_* names both; each spelling is found again after storing."""
    elevations = pair_in(tmp_path / "in", 3)
    (tmp_path / "in" / f"{NAME}_num.tif").unlink()
    plain = write_raster(tmp_path / "plain.tif", np.full((24, 24), 8, np.uint8)).read_bytes()
    (tmp_path / quality).write_bytes(gzip.compress(plain) if quality.endswith(".gz") else plain)
    found = add(sessions, [tmp_path / quality, elevations], tmp_path / "dem")
    assert found.names == (f"{NAME}_dem.tif",)
    assert most_scenes(found) == 8


def test_a_layer_that_does_not_fit_or_stands_alone_is_refused_and_nothing_is_kept(tmp_path: Path) -> None:
    elevations = pair_in(tmp_path / "in", 7, size=23)
    for given, says in (
        (elevations, f"{NAME}_num.tif does not fit {NAME}_dem.tif"),
        (tmp_path / "in" / f"{NAME}_num.tif", f"{NAME}_num.tif is a quality layer"),
    ):
        with pytest.raises(TerrainError, match=says):
            files.store_files([given], tmp_path / "dem")
    assert [file for file in (tmp_path / "dem").rglob("*") if file.is_file()] == []
