"""Which measurements a log yields, where they lie, and what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from factor_support import street
from fusion.pipeline import run_drive
from fusion.profile.measurements import (
    ALTITUDE,
    BARO,
    DEM_CLEARANCE_M,
    DOPPLER,
    FORCE,
    MIN_SPEED_MPS,
    PITCH,
    TERRAIN,
    binned,
)
from fusion.simulate.write.csv_file import csv_columns
from profile_support import Levels, World, hills, log_of, pressure_of, smoothed, street_log

TABLE = street(*[60.0] * 20)
LONG_TABLE = street(*[80.0] * 122)
TIME_S = 1.7e9 + np.arange(110.0)
ALONG_M = 5 + 10 * (TIME_S - TIME_S[0])
CALM = Levels(0.0, 0.0, 0.0, 0.0, springs=0.0, force=0.0, position_m=0.0, mount=0.0)
"""A receiver without errors on a vehicle without springs."""


@pytest.mark.parametrize("back", [False, True], ids=["there", "back"])
def test_without_noise_every_sensor_says_the_truth(back: bool) -> None:
    """Slopes in the direction of travel: uphill one way is downhill the other; heights are what they are."""
    along, sign = (ALONG_M[::-1], -1.0) if back else (ALONG_M, 1.0)
    log = street_log(TIME_S, along, hills, np.random.default_rng(0), nose=sign, levels=CALM)
    one = smoothed(replace(log, pressure=pressure_of(TIME_S, hills(along))), TABLE)
    measured = one.measured
    traversal, distance = one.path.match.position_on(measured.along_m)
    place = 60.0 * one.path.match.segment[traversal] + distance
    fine = np.linspace(0, 1200, 12_001)
    grade = sign * np.interp(place, fine, np.gradient(hills(fine), fine))
    inner = (place > 30) & (place < 1080)
    for sensor in (DOPPLER, PITCH, FORCE):
        mine = (measured.sensor == sensor) & inner
        assert mine.sum() > 90
        np.testing.assert_allclose(measured.value[mine], grade[mine], atol=0.003)
    for sensor in (ALTITUDE, BARO):
        mine = (measured.sensor == sensor) & inner
        assert mine.sum() > 90
        np.testing.assert_allclose(measured.value[mine], hills(place[mine]), atol=0.1)
    assert np.all(np.diff(measured.time_s) >= 0)


def test_a_standing_vehicle_has_heights_only() -> None:
    along = np.minimum(ALONG_M, ALONG_M[50])
    measured = smoothed(
        street_log(
            TIME_S,
            along,
            hills,
            np.random.default_rng(0),
            levels=replace(CALM, altitude_m=0.5, position_m=0.5),
        ),
        TABLE,
    ).measured
    standing = measured.time_s > TIME_S[53]
    assert np.all(measured.sensor[standing] == ALTITUDE)
    assert standing.sum() > 50
    slopes = np.isin(measured.sensor, (DOPPLER, PITCH, FORCE))
    assert np.all(measured.speed_mps[slopes] > MIN_SPEED_MPS)


def test_a_height_that_a_receiver_repeats_while_the_vehicle_stands_is_measured_once() -> None:
    """Black boxes freeze their height below walking speed. While driving, equal heights are measurements."""
    along = np.minimum(ALONG_M, ALONG_M[50])
    log = street_log(TIME_S, along, hills, np.random.default_rng(0), levels=replace(CALM, altitude_m=0.5))
    standing = TIME_S - TIME_S[0] > 53
    frozen = np.where(standing, 100.0, np.where(TIME_S - TIME_S[0] < 20, 90.0, log.fix.alt_msl_m))
    measured = smoothed(replace(log, fix=replace(log.fix, alt_msl_m=frozen)), TABLE).measured
    heights = measured.value[measured.sensor == ALTITUDE]
    assert np.sum(heights == 100.0) == 1
    assert np.sum(heights == 90.0) > 15


@pytest.mark.parametrize("level_share", [0.7, 0.3])
def test_heights_come_from_one_datum(level_share: float) -> None:
    """Fixes with the height above the geoid or above the ellipsoid, 48 m apart: no step where one gives way."""
    log = street_log(TIME_S, ALONG_M, hills, np.random.default_rng(0), levels=CALM)
    level = np.arange(len(TIME_S)) < level_share * len(TIME_S)
    height = log.fix.alt_msl_m
    fix = replace(
        log.fix,
        alt_msl_m=np.where(level, height, np.nan),
        height_ell_m=np.where(level, np.nan, height + 48.0),
    )
    measured = smoothed(replace(log, fix=fix), TABLE).measured
    values = measured.value[measured.sensor == ALTITUDE]
    assert len(values) == pytest.approx(max(level_share, 1 - level_share) * len(TIME_S), abs=2)
    assert np.ptp(values) < 20


def test_the_dem_is_left_out_around_bridges_and_tunnels(tmp_path_factory: pytest.TempPathFactory) -> None:
    world = World(tmp_path_factory.mktemp("profile"))
    drive = world.drive(1, duration_s=300.0)
    one = smoothed(log_of(csv_columns(drive)), drive.town.roads, world.dem(1))
    match = one.path.match
    terrain = one.measured.along_m[one.measured.sensor == TERRAIN]
    assert len(terrain) > 30
    table = one.path.network.table
    structure = (table.bridge | table.tunnel)[match.segment]
    assert structure.sum() >= 3
    for k in np.flatnonzero(structure):
        start = match.start_m[k]
        end = start + abs(match.leave_m[k] - match.enter_m[k])
        assert not np.any((terrain > start - DEM_CLEARANCE_M) & (terrain < end + DEM_CLEARANCE_M))


def test_dense_samples_are_averaged_and_sparse_ones_left_alone() -> None:
    time = 1.7e9 + np.arange(0, 20, 0.1)
    value = np.arange(len(time), dtype=float)
    at, mean = binned(time, 0.5, value)
    assert len(at) == 40
    np.testing.assert_allclose(mean, 2 + 5 * np.arange(40.0))
    np.testing.assert_allclose(at, time.reshape(40, 5).mean(axis=1))
    holed = value.copy()
    holed[7] = np.nan
    assert binned(time, 0.5, holed)[1][1] == pytest.approx(np.mean([5, 6, 8, 9]))
    sparse = 1.7e9 + np.arange(0, 20, 1.0)
    same = binned(sparse, 0.5, np.sin(sparse))
    np.testing.assert_array_equal(same[0], sparse)
    np.testing.assert_array_equal(same[1], np.sin(sparse))


@pytest.mark.slow
def test_only_heights_that_an_altimeter_can_know_are_late() -> None:
    """Steady ones that state no accuracy; above the ellipsoid they are a receiver's, however steady."""
    time_s = 1.7e9 + np.arange(1200.0)
    steady = Levels(altitude_m=0.1, drift=1e-4)
    along = 5 + 8 * (time_s - time_s[0])
    rng = np.random.default_rng(1)
    log = street_log(time_s, along, hills, rng, levels=steady, without=("attitude", "force"))
    unknown = np.full(len(time_s), np.nan)
    by_level = replace(log.fix, v_acc_m=unknown)
    by_ellipsoid = replace(by_level, alt_msl_m=unknown, height_ell_m=by_level.alt_msl_m + 48.0)
    late = [run_drive(replace(log, fix=fix), LONG_TABLE, None)[1].late_by for fix in (by_level, by_ellipsoid)]
    assert [by is not None for by in late] == [True, False]
