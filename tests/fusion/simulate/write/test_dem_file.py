"""The elevation raster that a simulation writes: the ground, with errors of a stated size and width."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio

from fusion.simulate.demonstration import Demonstration
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write import dem_file
from fusion.simulate.write.dem_file import ERROR_LENGTH_M, ERROR_SIGMA_M, dem_heights, write_dem


def test_the_elevation_raster_is_the_ground_with_its_errors(bundle: Demonstration) -> None:
    town = bundle.town
    with rasterio.open(bundle.dem) as source:
        assert source.crs.is_geographic
        assert "EGM96" in source.crs.to_wkt()
        assert source.res == pytest.approx((1 / 3600, 1 / 3600))
        z = source.read(1, masked=True)
        west, south, east, north = source.bounds
        top_left = source.xy(0, 0)
    assert west < town.node_lon_deg.min() - 0.002
    assert east > town.node_lon_deg.max() + 0.002
    assert south < town.node_lat_deg.min() - 0.002
    assert north > town.node_lat_deg.max() + 0.002
    assert 0.0005 < np.mean(z.mask) < 0.05
    expected, left, top = dem_heights(town)
    assert top_left == pytest.approx((left + 0.5 / 3600, top - 0.5 / 3600))
    np.testing.assert_array_equal(np.isnan(expected), z.mask)
    assert np.nanmax(np.abs(expected - z.filled(0))[~z.mask]) <= 0.5


def test_posts_without_error_are_the_ground(
    tmp_path: Path, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dem_file, "ERROR_SIGMA_M", 0.0)
    write_dem(town, tmp_path / "dem.tif")
    with rasterio.open(tmp_path / "dem.tif") as source:
        z = source.read(1, masked=True).astype(float).filled(np.nan)
        rows, columns = np.indices(z.shape)
        lon, lat = source.xy(rows.ravel(), columns.ravel())
    ground = town.height(*town.projection.to_xy(lon, lat)).reshape(z.shape)
    assert np.nanmax(np.abs(z - ground)) <= 0.5 + 1e-6


def test_elevation_errors_are_correlated() -> None:
    squares, products, n = 0.0, np.zeros(2), 0
    for seed in range(20, 26):
        town = make_town(seed)
        z, west, north = dem_heights(town)
        lon = west + (np.arange(z.shape[1]) + 0.5) / 3600
        lat = north - (np.arange(z.shape[0]) + 0.5) / 3600
        error = z - town.height(*town.projection.to_xy(*np.meshgrid(lon, lat)))
        squares += float(np.nanmean(error**2))
        steps = (1, round(ERROR_LENGTH_M / 30.9))
        products += [np.nanmean(error[k:] * error[:-k]) for k in steps]
        n += 1
    assert np.sqrt(squares / n) == pytest.approx(ERROR_SIGMA_M, rel=0.2)
    near, at_length = products / squares
    assert near > 0.85
    assert at_length == pytest.approx(np.exp(-1), abs=0.15)
