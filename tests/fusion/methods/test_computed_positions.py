"""Positions computed from raw signals: slopes take their places, never their heights alone; roads give heights back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.gnss.positioning import positioned
from fusion.methods.computed_positions import (
    NO_GRADE,
    above_ellipsoid,
    heights_under,
    knows_grade,
    without_heights,
)
from fusion.pipeline import _helped, run_drive
from fusion.published.canyon.drive import canyon_of
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, GnssFix, Pressure


@pytest.fixture(scope="module")
def drive() -> SimulatedDrive:
    return simulate_drive(make_town(1), 4, 240.0)


@pytest.fixture(scope="module")
def log(drive: SimulatedDrive) -> DriveLog:
    return DriveLog("test", GnssFix.empty(), raw=canyon_of(drive).raw())


def silent(log: DriveLog) -> DriveLog:
    """The log without Doppler."""
    assert log.raw is not None
    rates = np.full_like(log.raw.signals.range_rate_mps, np.nan)
    return replace(log, raw=replace(log.raw, signals=replace(log.raw.signals, range_rate_mps=rates)))


def test_slopes_of_raw_signals_with_doppler_are_true(drive: SimulatedDrive, log: DriveLog) -> None:
    network, result = run_drive(log, drive.town.roads, None)
    assert result.report["gnss"]["positioning"] == "one-sided"
    assert len(result.slopes) > 10
    row = {tuple(key): k for k, key in enumerate(keys(drive.town.roads))}
    at = [row[tuple(keys(network.table)[one.segment])] for one in result.slopes]
    error = np.array([one.slope_percent for one in result.slopes]) - drive.town.true_slope_percent[at]
    assert np.sqrt(np.mean(error**2)) < 1.5


def test_heights_of_a_solver_play_no_part_in_slopes(drive: SimulatedDrive, log: DriveLog) -> None:
    found = positioned(log)
    fix = found.log.fix
    wrong = replace(found, log=replace(found.log, fix=replace(fix, height_ell_m=fix.height_ell_m[::-1])))
    first, second = (run_drive(one, drive.town.roads, None)[1] for one in (found, wrong))
    assert first.slopes == second.slopes


def test_a_drive_that_knows_no_grade_lies_on_its_roads_and_says_why(
    drive: SimulatedDrive, log: DriveLog
) -> None:
    _, result = run_drive(silent(log), drive.town.roads, None)
    assert result.slopes == ()
    assert result.factors == ()
    assert result.report["warnings"].count(NO_GRADE) == 1
    assert result.report["segments_driven"] > 10
    assert np.isnan(result.track.alt_m).all()


def test_what_knows_a_grade() -> None:
    bare, time = DriveLog("test", GnssFix.empty()), np.arange(3.0)
    assert not knows_grade(bare)
    assert knows_grade(replace(bare, pressure=Pressure.assemble(time, pressure_pa=time + 9e4)))
    assert knows_grade(replace(bare, attitude=Attitude.assemble(time, pitch_rad=time)))
    assert not knows_grade(replace(bare, attitude=Attitude.assemble(time, yaw_rad=time)))


def test_places_are_kept_and_heights_are_not(log: DriveLog) -> None:
    found = positioned(log).log
    bare = without_heights(found)
    assert not bare.fix.has("height_ell_m")
    assert not bare.fix.has("v_acc_m")
    assert np.array_equal(bare.fix.lat_deg, found.fix.lat_deg)


def test_heights_of_the_ground_are_shifted_by_one_number() -> None:
    ground = np.array([1.0, np.nan, 3.0, 5.0])
    assert np.allclose(
        above_ellipsoid(ground, np.array([41.0, 42.0, 44.0, 90.0])),
        [42.0, np.nan, 44.0, 46.0],
        equal_nan=True,
    )
    assert np.isnan(above_ellipsoid(ground, np.full(4, np.nan))).all()


def test_the_road_s_heights_come_from_the_elevation_model_but_on_bridges_and_in_tunnels(
    drive: SimulatedDrive, log: DriveLog, tmp_path: Path
) -> None:
    write_dem(drive.town, tmp_path / "town.tif")
    found = positioned(log, "one-sided")
    network = RoadNetwork.project(drive.town.roads)
    with Dem.open([tmp_path / "town.tif"]) as dem:
        height = heights_under(found.log, network, dem)
        helped = _helped(found, network, dem)
    at = np.clip(np.searchsorted(drive.time_s, found.log.fix.time_s), 0, len(drive.time_s) - 1)
    on_ground = ~(drive.town.roads.bridge | drive.town.roads.tunnel)[drive.truth.segment[at]]
    assert np.mean(np.isfinite(height[on_ground])) > 0.8
    assert np.nanmedian(np.abs(height[on_ground] - drive.truth.z_m[at][on_ground])) < 3.0
    assert helped.with_heights is None
    assert len(helped.log.fix) == len(found.log.fix)
    assert not np.array_equal(helped.height_ell_m, found.height_ell_m)


def keys(table: object) -> np.ndarray:
    """What names a segment, whatever the table."""
    return np.column_stack([getattr(table, name) for name in ("osm_way_id", "from_node", "to_node")])
