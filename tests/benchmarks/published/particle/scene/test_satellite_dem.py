"""Rasters of the interchange: their grids, the size and the shape of their errors, what they see of embankments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio

from fusion.errors import UnknownNameError
from fusion.terrain.dem import Dem
from published.particle.scene.calais import Interchange, make_interchange
from published.particle.scene.satellite_dem import (
    DEM_MODELS,
    earthworks,
    raster_error,
    scene_numbers,
    write_quality,
    write_raster,
)


@pytest.fixture(scope="module")
def scene() -> Interchange:
    return make_interchange(2)


@pytest.fixture(scope="module")
def scenes() -> list[Interchange]:
    return [make_interchange(seed) for seed in range(1, 13)]


@pytest.mark.slow
@pytest.mark.parametrize(("model", "sigma_m"), (("aster", 12.6), ("world30", 6.0)))
def test_errors_are_as_large_as_the_thesis_says(
    scenes: list[Interchange], model: str, sigma_m: float
) -> None:
    variance = [np.mean(raster_error(scene, DEM_MODELS[model]) ** 2) for scene in scenes]
    assert np.sqrt(np.mean(variance)) == pytest.approx(sigma_m, rel=0.15)


def test_errors_of_neighbours_hang_together(scene: Interchange) -> None:
    for name in ("aster", "world30"):
        error = raster_error(scene, DEM_MODELS[name])
        error -= error.mean()
        near = np.mean(error[:, 1:] * error[:, :-1]) / np.var(error)
        far = np.mean(error[:, 20:] * error[:, :-20]) / np.var(error)
        assert near > 0.7
        assert abs(far) < 0.35


@pytest.mark.slow
def test_few_scenes_mean_large_errors(scenes: list[Interchange]) -> None:
    model = DEM_MODELS["aster"]
    poor, good = [], []
    for scene in scenes:
        number, error = scene_numbers(scene, model), raster_error(scene, model)
        assert number.min() >= 1
        assert np.median(number) == pytest.approx(8, abs=3)
        poor.append(error[number <= 3] - np.mean(error))
        good.append(error[number >= 10] - np.mean(error))
    assert np.std(np.concatenate(poor)) > 1.8 * np.std(np.concatenate(good))


@pytest.mark.slow
def test_aster_is_the_thesis_grid_in_utm(scene: Interchange, tmp_path: Path) -> None:
    write_raster(scene, tmp_path / "aster.tif")
    write_quality(scene, tmp_path / "num.tif")
    with rasterio.open(tmp_path / "aster.tif") as file, rasterio.open(tmp_path / "num.tif") as number:
        assert file.width * file.height == 14_560
        assert file.res == pytest.approx((19.51, 30.89))
        assert "UTM zone 31N" in file.crs.to_wkt()
        assert number.transform == file.transform
        np.testing.assert_array_equal(number.read(1), scene_numbers(scene, DEM_MODELS["aster"]))


@pytest.mark.slow
@pytest.mark.parametrize("model", ("aster", "world30"))
def test_the_raster_covers_every_road_and_errs_by_its_error(
    scene: Interchange, tmp_path: Path, model: str
) -> None:
    write_raster(scene, tmp_path / "dem.tif", model)
    with Dem.open([tmp_path / "dem.tif"]) as dem:
        assert dem.datum == "EGM96"
        seen = dem.heights(scene.node_lon_deg, scene.node_lat_deg)
    assert np.isfinite(seen).all()
    expected = np.std(raster_error(scene, DEM_MODELS[model]))
    ground = scene.height(scene.node_x_m, scene.node_y_m)
    assert np.std(seen - ground) == pytest.approx(expected, rel=0.35)


@pytest.mark.slow
def test_a_raster_without_error_is_the_surface_averaged(
    scene: Interchange, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("published.particle.scene.satellite_dem.raster_error", lambda town, model: 0.0)
    write_raster(scene, tmp_path / "dem.tif", "world30")
    with Dem.open([tmp_path / "dem.tif"]) as dem:
        seen = dem.heights(scene.node_lon_deg, scene.node_lat_deg)
    ground = scene.height(scene.node_x_m, scene.node_y_m)
    bank = earthworks(scene, scene.node_x_m, scene.node_y_m)
    flat = np.abs(bank) < 0.3
    assert np.sqrt(np.mean((seen - ground)[flat] ** 2)) < 0.5
    high = bank > 3
    assert high.sum() > 15
    share = (seen - ground)[high] / bank[high]
    assert 0.1 < np.mean(share) < 0.8  # 20 m of resolution see a part of a bank 30 m wide


def test_banks_fall_off_beside_the_road_and_leave_bridges_out(scene: Interchange) -> None:
    off = scene.node_height_m - scene.height(scene.node_x_m, scene.node_y_m)
    bridge = scene.roads.bridge
    on_bridge = np.union1d(scene.start[bridge], scene.end[bridge])
    inner = np.setdiff1d(on_bridge, np.union1d(scene.start[~bridge], scene.end[~bridge]))
    ordinary = np.setdiff1d(np.arange(len(off)), on_bridge)
    bank = earthworks(scene, scene.node_x_m, scene.node_y_m)
    np.testing.assert_allclose(bank[ordinary], off[ordinary], atol=1e-6)
    assert np.all(off[inner][off[inner] > 4] - bank[inner][off[inner] > 4] > 1)
    k = ordinary[np.argmax(off[ordinary])]
    away = np.array([0.0, 10.0, 60.0, 200.0])
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = [
        np.min(
            earthworks(
                scene,
                scene.node_x_m[k] + r * np.cos(angles),
                scene.node_y_m[k] + r * np.sin(angles),
            )
        )
        for r in away
    ]
    assert ring[0] > ring[1] > ring[2]


def test_unknown_rasters_are_refused(scene: Interchange, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="There is no elevation raster called 'lidar'"):
        write_raster(scene, tmp_path / "dem.tif", "lidar")
