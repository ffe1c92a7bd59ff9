"""smartLoc as measurements and as files: the same numbers, the earth's turn once."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from fusion.gnss.earth import EARTH_RATE_RADPS
from fusion.signals import LIGHT_MPS
from published.positioning import smartloc

FOLDER = Path(__file__).parents[5] / "shared/data/smartloc"
there = pytest.mark.skipif(not FOLDER.is_dir(), reason="smartLoc is not there")


def test_satellites_are_turned_by_the_time_of_flight() -> None:
    satellite, user = np.array([[2.0e7, 1.5e7, 1.0e7]]), np.array([3.8e6, 9.0e5, 5.0e6])
    flight = np.linalg.norm(satellite[0] - user) / LIGHT_MPS
    moved = smartloc.turned(satellite, user)[0] - satellite[0]
    spin = np.cross([0, 0, EARTH_RATE_RADPS], satellite[0]) * flight
    np.testing.assert_allclose(moved, -spin, atol=1e-2)
    assert 50 < np.linalg.norm(moved) < 200


@there
def test_the_truth_explains_the_ranges() -> None:
    scene = smartloc.read(FOLDER)
    measured = scene.measured
    assert len(measured) == 1372 and measured.groups == ("G", "R")
    distance = np.linalg.norm(measured.satellite_m - scene.truth_m[measured.epoch], axis=1)
    off = measured.pseudorange_m - distance
    clear = (measured.cn0_dbhz > 47) & (measured.group == 0)
    for k in range(0, 1372, 100):
        here = off[clear & (measured.epoch == k)]
        assert len(here) < 2 or np.ptp(here) < 60.0  # all share one clock
    assert scene.aids.speed_mps.max() < 15
    assert np.median(np.abs(measured.elevation_rad)) < np.pi / 2


@there
def test_the_files_hold_the_log(tmp_path: Path) -> None:
    pseudoranges, sensors = smartloc.convert(FOLDER, tmp_path)
    scene = smartloc.read(FOLDER)
    with pseudoranges.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(scene.measured.satellite)
    np.testing.assert_allclose(
        [float(row["pseudorange_m"]) for row in rows], scene.measured.pseudorange_m, atol=1e-4
    )
    raw = np.array([[float(row[f"sat_{axis}_m"]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(
        smartloc.turned(raw, scene.measured.rough_m), scene.measured.satellite_m, atol=1e-3
    )
    with sensors.open() as file:
        driven = list(csv.DictReader(file))
    np.testing.assert_allclose(
        [float(row["odo_speed_mps"]) for row in driven], scene.aids.speed_mps, atol=1e-6
    )
    turns = np.radians([float(row["gyr_z_dps"]) for row in driven])
    np.testing.assert_allclose(turns, -scene.aids.yaw_rate_radps, atol=1e-8)
