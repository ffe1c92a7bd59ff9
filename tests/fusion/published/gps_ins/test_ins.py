"""What stands for the INS: sources of speed and heading, conventions, alignment, and what is held for how long."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fusion.errors import MissingSensorError
from fusion.frames import LocalProjection, wrap_angle
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.gps_ins.ins import NEED, build_drive, course, gyro_heading, read_ins, yaw_heading
from fusion.published.gps_ins.options import ExtendedOptions
from fusion.types import AngularRate, Attitude, DriveLog, GnssFix, GnssVelocity, Odometry

PLANE = LocalProjection(8.0, 49.0)
OPTIONS = ExtendedOptions(period_s=1.0)
TURN_RADPS = 0.05


def circling(seconds: int = 120, *, speed_mps: float = 10.0, north_first: bool = False) -> DriveLog:
    """A car that turns left at a constant rate, starting east (or north), with every sensor and no noise."""
    time = np.arange(float(seconds))
    heading = TURN_RADPS * time + (math.pi / 2 if north_first else 0.0)
    radius = speed_mps / TURN_RADPS
    lon, lat = PLANE.to_lonlat(radius * np.sin(heading), -radius * np.cos(heading))
    return DriveLog(
        "csv",
        fix=GnssFix.assemble(time, lon_deg=lon, lat_deg=lat, alt_msl_m=np.full(seconds, 100.0)),
        velocity=GnssVelocity.assemble(
            time, vel_n_mps=speed_mps * np.sin(heading), vel_e_mps=speed_mps * np.cos(heading)
        ),
        attitude=Attitude.assemble(time, yaw_rad=np.mod(math.pi / 2 - heading, 2 * math.pi)),
        rate=AngularRate.assemble(time, gyr_z_radps=np.full(seconds, TURN_RADPS)),
        odometry=Odometry.assemble(time, speed_mps=np.full(seconds, speed_mps)),
    )


def only(log: DriveLog, *tables: str) -> DriveLog:
    """The log's positions and these tables."""
    return DriveLog("csv", log.fix, **{name: getattr(log, name) for name in tables})


def epochs_of(log: DriveLog) -> Epochs:
    return build_epochs(log, PLANE, OPTIONS.period_s)


def true_heading(epochs: Epochs) -> np.ndarray:
    return wrap_angle(TURN_RADPS * (epochs.time_s - epochs.time_s[0]))


def test_a_compass_bearing_becomes_an_angle_from_east_anticlockwise() -> None:
    log = only(circling(), "velocity")
    yaw = np.radians([0.0, 90.0, 180.0, 270.0, 359.0])
    attitude = Attitude.assemble(np.arange(5.0), yaw_rad=yaw)
    heading, offset = yaw_heading(epochs_of(replace(log, attitude=attitude)), align=False)
    assert np.degrees(heading[:5]) == pytest.approx([90, 0, -90, 180, 91], abs=1e-9)
    assert offset == 0.0


@pytest.mark.parametrize("source", ["attitude", "rate", "velocity"])
def test_every_source_gives_the_heading(source: str) -> None:
    log = circling()
    tables = {"velocity", "odometry", source}
    epochs = epochs_of(only(log, *tables))
    ins = read_ins("gps-ins-ekf", epochs, OPTIONS)
    assert wrap_angle(ins.heading_rad - true_heading(epochs)) == pytest.approx(0.0 * epochs.time_s, abs=2e-3)
    name = {"attitude": "yaw", "rate": "gyroscope", "velocity": "course"}[source]
    assert ins.heading_share[name] == 1.0
    assert sum(ins.heading_share.values()) == 1.0


@pytest.mark.parametrize("misalignment_deg", [-170.0, -12.0, 1.5, 90.0])
def test_a_yaw_sensor_that_is_misaligned_is_turned_to_the_course(misalignment_deg: float) -> None:
    log = circling()
    misaligned = replace(log.attitude, yaw_rad=log.attitude.yaw_rad + math.radians(misalignment_deg))
    epochs = epochs_of(replace(log, attitude=misaligned))
    heading, offset = yaw_heading(epochs, align=True)
    assert math.degrees(offset) == pytest.approx(misalignment_deg, abs=0.1)
    assert wrap_angle(heading - true_heading(epochs)) == pytest.approx(0.0 * epochs.time_s, abs=2e-3)
    untouched, none = yaw_heading(epochs, align=False)
    assert none == 0.0
    assert np.abs(wrap_angle(untouched - heading)) == pytest.approx(
        math.radians(abs(misalignment_deg)), abs=2e-3
    )


def test_a_few_minutes_in_reverse_do_not_turn_the_yaw_sensor() -> None:
    log = circling()
    back = np.where(np.arange(120) % 10 == 0, -1.0, 1.0)
    velocity = replace(
        log.velocity, vel_n_mps=back * log.velocity.vel_n_mps, vel_e_mps=back * log.velocity.vel_e_mps
    )
    epochs = epochs_of(replace(log, velocity=velocity))
    assert yaw_heading(epochs, align=True)[1] == pytest.approx(0.0, abs=1e-3)
    ins = read_ins("gps-ins-ekf", epochs, OPTIONS)
    assert ins.speed_mps == pytest.approx(10.0 * back)


@pytest.mark.parametrize("bias_dps", [-0.5, 0.0, 0.5])
def test_a_gyroscope_learns_its_offset_and_carries_the_course_through_an_outage(bias_dps: float) -> None:
    log = circling(240)
    lost = (np.arange(240) >= 150) & (np.arange(240) < 210)
    rate = replace(log.rate, gyr_z_radps=log.rate.gyr_z_radps + math.radians(bias_dps))
    cut = replace(log, fix=log.fix.take(~lost), velocity=log.velocity.take(~lost), rate=rate)
    epochs = epochs_of(replace(cut, attitude=Attitude.empty()))
    assert len(epochs) == 240
    heading = gyro_heading(epochs)
    off = np.abs(wrap_angle(heading - true_heading(epochs)))
    assert np.degrees(off[149]) < 0.5
    # A minute at an unlearnt half degree a second would be 30 degrees.
    assert np.degrees(off[150:210].max()) < 6.0


def test_a_gyroscope_without_a_course_says_nothing() -> None:
    assert np.isnan(gyro_heading(epochs_of(only(circling(), "rate", "odometry")))).all()


def test_a_course_counts_while_moving_and_is_worth_what_the_speed_makes_it() -> None:
    log = circling(speed_mps=2.0)
    stated = replace(log.velocity, s_acc_mps=np.full(120, 0.1))
    epochs = epochs_of(replace(log, velocity=stated))
    angle, sigma = course(epochs, 1.0)
    assert wrap_angle(angle - true_heading(epochs)) == pytest.approx(0.0 * angle, abs=1e-9)
    assert sigma == pytest.approx(np.full(120, math.hypot(0.1 / 2.0, 0.01)))
    assert np.isnan(course(epochs, 2.5)[0]).all()


def test_in_an_outage_the_odometer_and_the_yaw_stay() -> None:
    log = circling()
    lost = (np.arange(120) >= 40) & (np.arange(120) < 80)
    odometry = replace(log.odometry, speed_mps=np.full(120, 9.0))
    cut = replace(log, fix=log.fix.take(~lost), velocity=log.velocity.take(~lost), odometry=odometry)
    epochs = epochs_of(cut)
    ins = read_ins("gps-ins-ekf", epochs, OPTIONS)
    assert ins.speed_mps == pytest.approx(np.where(lost, 9.0, 10.0))
    assert not ins.speed_age_s.any()
    drive = build_drive(epochs, ins, OPTIONS)
    assert not drive.spread_m.any()
    assert np.isnan(drive.x_m[lost]).all()
    assert np.isfinite(drive.heading_rad).all()


def test_a_missing_speed_is_held_and_then_given_up() -> None:
    """Held: the spread grows with the age. Given up: within t seconds the car is anywhere within 15 m/s times t."""
    log = circling()
    lost = (np.arange(120) >= 40) & (np.arange(120) < 80)
    cut = replace(log, fix=log.fix.take(~lost), velocity=log.velocity.take(~lost), odometry=Odometry.empty())
    ins = read_ins("gps-ins-ekf", epochs_of(cut), OPTIONS)
    assert ins.speed_mps[40:45] == pytest.approx(np.full(5, 10.0))
    assert np.isnan(ins.speed_mps[45:80]).all()
    assert ins.speed_age_s[40:45] == pytest.approx([1, 2, 3, 4, 5])
    drive = build_drive(epochs_of(cut), ins, OPTIONS)
    assert (np.diff(drive.spread_m[39:44]) > 0).all()
    assert not drive.speed_mps[46:79].any()
    assert np.isfinite(drive.speed_mps).all()
    variance = np.sum(drive.spread_m[45:79] ** 2)
    assert math.sqrt(variance) == pytest.approx(15.0 * math.sqrt(40**2 - 6**2), rel=1e-6)


def test_a_car_that_stands_keeps_its_heading_however_long() -> None:
    time = np.arange(200.0)
    speed = np.where((time >= 50) & (time < 150), 0.0, 10.0)
    log = DriveLog(
        "csv",
        fix=GnssFix.assemble(time, lon_deg=np.full(200, 8.0), lat_deg=np.full(200, 49.0)),
        velocity=GnssVelocity.assemble(time, vel_n_mps=speed, vel_e_mps=0 * time),
    )
    epochs = epochs_of(log)
    ins = read_ins("gps-ins-kf", epochs, OPTIONS)
    assert ins.heading_rad == pytest.approx(np.full(200, math.pi / 2))
    assert ins.heading_age_s.max() == 0.0
    assert build_drive(epochs, ins, OPTIONS).spread_m.max() == 0.0


def test_a_step_is_driven_at_the_mean_of_its_ends_or_at_its_start() -> None:
    time = np.arange(30.0)
    north = np.where(time < 10, 0.0, np.where(time < 20, time - 10, 10.0))
    log = DriveLog(
        "csv",
        fix=GnssFix.assemble(time, lon_deg=np.full(30, 8.0), lat_deg=np.full(30, 49.0)),
        velocity=GnssVelocity.assemble(time, vel_n_mps=north, vel_e_mps=np.full(30, 1.0)),
        attitude=Attitude.assemble(time, yaw_rad=np.where(time < 15, 0.1, 2 * math.pi - 0.1)),
    )
    epochs = epochs_of(log)
    options = ExtendedOptions(period_s=1.0, align_heading=False)
    ins = read_ins("gps-ins-ekf", epochs, options)
    middle = build_drive(epochs, ins, options)
    start = build_drive(epochs, ins, options.model_copy(update={"command_at": "start"}))
    assert start.speed_mps == pytest.approx(ins.speed_mps)
    assert middle.speed_mps[:-1] == pytest.approx(0.5 * (ins.speed_mps[1:] + ins.speed_mps[:-1]))
    # Across north the mean of 0.1 and -0.1 is north and not south.
    assert middle.heading_rad[14] == pytest.approx(math.pi / 2)
    assert start.heading_rad[14] == pytest.approx(math.pi / 2 - 0.1)


def test_the_logs_own_accuracy_goes_before_the_option() -> None:
    log = circling()
    stated = np.where(np.arange(120) < 60, 2.0, np.nan)
    epochs = epochs_of(replace(log, fix=replace(log.fix, h_acc_m=stated)))
    drive = build_drive(epochs, read_ins("gps-ins-kf", epochs, OPTIONS), OPTIONS)
    assert drive.fix_sigma_m == pytest.approx(np.where(np.arange(120) < 60, math.sqrt(2), 12.5))


@pytest.mark.parametrize("tables", [(), ("odometry",), ("attitude",), ("rate",), ("odometry", "rate")])
def test_a_log_without_speed_or_heading_is_refused_in_one_sentence(tables: tuple[str, ...]) -> None:
    epochs = epochs_of(only(circling(), *tables))
    with pytest.raises(MissingSensorError) as refusal:
        read_ins("gps-ins-kf", epochs, OPTIONS)
    message = str(refusal.value)
    assert f"'gps-ins-kf' needs {NEED}" in message
    assert "choose a method" in message
    assert message.count(". ") == 0


@pytest.mark.parametrize("tables", [("velocity",), ("odometry", "attitude"), ("velocity", "attitude")])
def test_a_log_with_both_is_enough(tables: tuple[str, ...]) -> None:
    epochs = epochs_of(only(circling(), *tables))
    ins = read_ins("gps-ins-kf", epochs, OPTIONS)
    assert ins.speed_mps == pytest.approx(np.full(120, 10.0))
    assert wrap_angle(ins.heading_rad - true_heading(epochs)) == pytest.approx(0.0 * ins.speed_mps, abs=2e-3)
