"""Elevation models made of a track: right at the road, wrong by what they are to be wrong by, and in one corner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import elevation_models
from accuracy.logs import Columns, write_columns
from fusion.terrain.dem import Dem


@pytest.fixture
def track() -> Columns:
    """Eastwards, then north: three quarters of the way lie in the south."""
    east = np.concatenate([np.arange(0.0, 600.0), np.full(200, 600.0)])
    north = np.concatenate([np.zeros(600), np.arange(0.0, 200.0)])
    along = np.arange(800.0)
    return {
        "t_s": along / 10,
        "lat_deg": 49 + north / 111_132.0,
        "lon_deg": 8 + east / (111_320.0 * np.cos(np.radians(49))),
        "alt_m": 200 + 0.05 * along,
    }


def heights(track: Columns, folder: Path, model: elevation_models.Model) -> np.ndarray:
    """What a made model says along the track."""
    reference = write_columns(track, folder / "ref.csv")
    with Dem.open([elevation_models.make_model(model, reference, 1, folder / "dem.tif")]) as dem:
        return np.asarray(dem.heights(track["lon_deg"], track["lat_deg"]))


def test_a_model_without_error_has_the_road_s_heights(track: Columns, tmp_path: Path) -> None:
    error = heights(track, tmp_path, elevation_models.Model(0.0)) - track["alt_m"]
    assert np.isfinite(error).all()
    assert np.abs(error).max() < 0.25  # a post takes the height of a place up to half a posting on


def test_errors_are_as_large_as_they_are_to_be(track: Columns, tmp_path: Path) -> None:
    error = heights(track, tmp_path, elevation_models.Model(3.0)) - track["alt_m"]
    assert 1.5 < np.std(error) < 4.5
    assert np.abs(np.diff(error)).max() < 1.0  # it hangs together over tens of metres


def test_one_corner_is_off_and_the_road_crosses_its_border(track: Columns, tmp_path: Path) -> None:
    off = heights(track, tmp_path, elevation_models.Model(0.0, 30.0)) - track["alt_m"] > 15
    assert 0.1 < off.mean() < 0.5
    assert np.count_nonzero(np.diff(off)) == 1


def test_the_report_is_read_for_what_it_says_of_the_model() -> None:
    said = "3 of 40 measurements of 'dem' are far off and were given little weight."
    report = {
        "sensors": {"dem": {"measurements": 40, "outliers": 3}},
        "noise": {"dem_m": 3.0, "drift": 1.0},
        "warnings": [said, "The GNSS height jumped at 12:00:00 UTC; slopes do not follow it."],
    }
    row = elevation_models.reported([report, {**report, "warnings": []}, report])
    alike = said.replace("3 of 40", "# of #")
    assert row == {"measurements": 40, "outliers": 0.075, "noise": "dem_m 3", "warnings": {alike: 2}}
    assert elevation_models.reported([{"sensors": {}, "warnings": []}])["measurements"] is None
