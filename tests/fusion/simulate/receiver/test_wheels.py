"""Wheels: they roll what the motion drives, slip by what was asked for, and leave the rest of a drive alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.receiver.wheels import WheelReadings, WheelSet
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns, write_csv
from published.odometer_map.scene import TEN_PERCENT_WHEELS, lahrech_drive

PERFECT_WHEELS = WheelSet(radius_error=0.0, slip=0.0, slip_each=0.0, ticks_per_turn=0)
"""Wheels that roll without slip and are read without steps."""


def rolling(drive: SimulatedDrive) -> WheelReadings:
    assert drive.wheels is not None
    return drive.wheels


def test_perfect_wheels_give_way_and_turn_back(town: Town) -> None:
    drive = simulate_drive(town, 3, 240.0, receiver="perfect", rate_hz=10.0, wheels=PERFECT_WHEELS)
    wheels = rolling(drive)
    left, right = 0.3 * wheels.left_rad, 0.3 * wheels.right_rad
    speed, t = drive.truth.speed_mps, drive.elapsed_s
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))])
    np.testing.assert_allclose((left + right) / 2 - (left[0] + right[0]) / 2, way, atol=0.02 * way[-1] / 100)
    turn = (left - right) / 1.5
    np.testing.assert_allclose(turn - turn[0], drive.truth.yaw_rad - drive.truth.yaw_rad[0], atol=1e-9)
    assert np.ptp(turn) > 1.0
    assert way[-1] > 1000


def test_the_outer_wheel_of_a_bend_runs_farther(town: Town) -> None:
    drive = simulate_drive(town, 3, 240.0, rate_hz=10.0, wheels=PERFECT_WHEELS)
    wheels = rolling(drive)
    to_the_right = np.diff(drive.truth.yaw_rad)
    sharp = np.abs(to_the_right) > 0.01
    assert sharp.sum() > 50
    ahead = np.diff(wheels.left_rad) - np.diff(wheels.right_rad)
    assert np.all(np.sign(ahead[sharp]) == np.sign(to_the_right[sharp]))


def test_wheels_roll_along_the_slope_not_along_the_map(town: Town) -> None:
    drive = simulate_drive(town, 3, 240.0, rate_hz=10.0, wheels=PERFECT_WHEELS)
    wheels, truth = rolling(drive), drive.truth
    flat = np.sum(np.hypot(np.diff(truth.x_m), np.diff(truth.y_m)))
    rolled = 0.15 * (np.ptp(wheels.left_rad) + np.ptp(wheels.right_rad))
    expected = np.sum(np.sqrt(np.diff(truth.x_m) ** 2 + np.diff(truth.y_m) ** 2 + np.diff(truth.z_m) ** 2))
    assert rolled > flat + 0.5
    assert rolled == pytest.approx(expected, rel=3e-4)


def test_ticks_are_whole_and_fall_behind_by_less_than_one(town: Town) -> None:
    coarse = WheelSet(radius_error=0.0, slip=0.0, slip_each=0.0, ticks_per_turn=48)
    counted = rolling(simulate_drive(town, 4, 90.0, wheels=coarse))
    exact = rolling(simulate_drive(town, 4, 90.0, wheels=PERFECT_WHEELS))
    tick = 2 * np.pi / 48
    for ticks, angle in ((counted.left_rad, exact.left_rad), (counted.right_rad, exact.right_rad)):
        np.testing.assert_allclose(ticks / tick, np.round(ticks / tick), atol=1e-9)
        assert np.all(np.diff(ticks) >= 0)
        assert np.ptp(angle - ticks) <= tick
        assert np.all(np.abs(angle - ticks) <= tick)


def test_standing_wheels_stand(town: Town) -> None:
    drive = simulate_drive(town, 4, 300.0, wheels=WheelSet(slip=0.1, slip_each=0.1))
    wheels = rolling(drive)
    still = (drive.truth.speed_mps[1:] < 1e-3) & (drive.truth.speed_mps[:-1] < 1e-3)
    assert still.sum() >= 3
    np.testing.assert_array_equal(np.diff(wheels.left_rad)[still], 0.0)


@pytest.mark.slow
def test_errors_have_the_size_that_was_asked_for(town: Town) -> None:
    asked = WheelSet(radius_error=0.01, slip=0.05, slip_each=0.02, ticks_per_turn=0)
    radii, common, own = [], [], []
    for seed in range(40):
        drive = simulate_drive(town, seed, 60.0, wheels=asked)
        plain = rolling(simulate_drive(town, seed, 60.0, wheels=PERFECT_WHEELS))
        wheels = rolling(drive)
        radii += [wheels.left_radius_m / 0.3 - 1, wheels.right_radius_m / 0.3 - 1]
        moving = drive.truth.speed_mps[1:] > 3
        shares = [
            np.diff(got)[moving] * radius / 0.3 / np.diff(true)[moving] - 1
            for got, true, radius in (
                (wheels.left_rad, plain.left_rad, wheels.left_radius_m),
                (wheels.right_rad, plain.right_rad, wheels.right_radius_m),
            )
        ]
        common.append((shares[0] + shares[1]) / 2)
        own.append((shares[0] - shares[1]) / np.sqrt(2))
    assert np.std(radii) == pytest.approx(0.01, rel=0.3)
    assert np.std(np.concatenate(common)) == pytest.approx(np.hypot(0.05, 0.02 / np.sqrt(2)), rel=0.1)
    assert np.std(np.concatenate(own)) == pytest.approx(0.02, rel=0.1)


def test_the_rest_of_a_drive_does_not_notice_wheels(town: Town) -> None:
    without, with_wheels = (
        simulate_drive(town, 11, 60.0),
        simulate_drive(town, 11, 60.0, wheels=TEN_PERCENT_WHEELS),
    )
    before, after = csv_columns(without), csv_columns(with_wheels)
    assert set(after) - set(before) == {"wheel_left_rad", "wheel_right_rad"}
    for name, column in before.items():
        np.testing.assert_array_equal(column, after[name])


def test_a_seed_turns_the_wheels_one_way(town: Town) -> None:
    a, b, c = (rolling(simulate_drive(town, s, 60.0, wheels=TEN_PERCENT_WHEELS)) for s in (11, 11, 12))
    np.testing.assert_array_equal(a.left_rad, b.left_rad)
    assert a.left_radius_m != c.left_radius_m


def test_the_csv_carries_the_wheels_to_the_log(town: Town, tmp_path: Path) -> None:
    drive = simulate_drive(town, 5, 60.0, wheels=WheelSet(), outages=[(10.0, 20.0)])
    write_csv(drive, tmp_path / "drive.csv")
    log = read_log(tmp_path / "drive.csv")
    wheels = rolling(drive)
    np.testing.assert_allclose(log.odometry.wheel_left_rad, wheels.left_rad, atol=1e-4)
    np.testing.assert_allclose(log.odometry.wheel_right_rad, wheels.right_rad, atol=1e-4)
    assert not log.warnings


def test_wheels_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="must be positive, not 0 m"):
        WheelSet(track_m=0)
    with pytest.raises(ValueError, match="must not be negative"):
        WheelSet(slip=-0.1)


@pytest.fixture(scope="module", params=(1, 2, 3))
def lahrech(request: pytest.FixtureRequest) -> SimulatedDrive:
    return lahrech_drive(request.param)


def test_lahrech_drive_has_the_shape_of_the_papers(lahrech: SimulatedDrive) -> None:
    assert len(lahrech.elapsed_s) == 325
    lost = np.diff(np.concatenate([[False], ~lahrech.has_gnss, [False]]).astype(int))
    begins, ends = np.flatnonzero(lost == 1), np.flatnonzero(lost == -1)
    np.testing.assert_array_equal(ends - begins, [40, 31])
    speed = lahrech.truth.speed_mps
    assert 13 < speed.max() < 16.7
    assert np.sum(np.diff((speed < 0.3).astype(int)) == 1) >= 2  # halts after the start
    used = lahrech.town.roads.highway[lahrech.truth.segment]
    assert not {"motorway", "motorway_link"} & set(used)
    assert rolling(lahrech).left_rad[-1] > 1000


def test_lahrech_odometer_errs_by_ten_percent(lahrech: SimulatedDrive) -> None:
    wheels, truth = rolling(lahrech), lahrech.truth
    driven = 0.15 * (np.diff(wheels.left_rad) + np.diff(wheels.right_rad))
    mean_speed = (truth.speed_mps[1:] + truth.speed_mps[:-1]) / 2
    moving = mean_speed > 5
    assert np.std(driven[moving] / mean_speed[moving] - 1) == pytest.approx(0.1, rel=0.25)
