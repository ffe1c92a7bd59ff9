"""Laying a log's tables on one clock: outages, rates, gaps, circular means."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.frames import LocalProjection
from fusion.published.epochs.table import build_epochs
from fusion.types import (
    LONGEST_BRIDGED_OUTAGE_S,
    AngularRate,
    Attitude,
    DriveLog,
    GnssFix,
    GnssVelocity,
    Odometry,
    SpecificForce,
)

PLANE = LocalProjection(8.0, 49.0)


def fixes(time_s: np.ndarray, speed_mps: float = 10.0) -> GnssFix:
    lon, lat = PLANE.to_lonlat(speed_mps * (time_s - time_s[0]), np.zeros(len(time_s)))
    return GnssFix.assemble(time_s, lon_deg=lon, lat_deg=lat, alt_msl_m=100 + 0.1 * time_s)


def test_bare_positions_give_epochs_with_speed_from_their_distances() -> None:
    epochs = build_epochs(DriveLog("gpx", fixes(np.arange(20.0))), PLANE)
    assert len(epochs) == 20
    assert epochs.has_gnss.all()
    assert np.allclose(epochs.speed_mps, 10.0, atol=1e-3)
    assert np.isnan(epochs.pitch_rad).all()
    assert epochs.after_outage.tolist() == [True] + [False] * 19


def test_fast_fixes_are_thinned_to_the_period() -> None:
    epochs = build_epochs(DriveLog("csv", fixes(np.arange(0, 10, 0.1))), PLANE, period_s=0.5)
    assert np.diff(epochs.time_s).min() >= 0.475
    assert len(epochs) == pytest.approx(20, abs=1)


def test_other_sensors_carry_on_through_an_outage() -> None:
    time = np.arange(60.0)
    received = (time < 20) | (time >= 40)
    log = DriveLog(
        "csv",
        fix=fixes(time).take(received),
        attitude=Attitude.assemble(time, pitch_rad=np.full(60, 0.05), yaw_rad=np.full(60, 1.0)),
    )
    epochs = build_epochs(log, PLANE)
    assert len(epochs) == 60
    assert np.count_nonzero(~epochs.has_gnss) == 20
    assert np.isfinite(epochs.pitch_rad).all()
    assert epochs.after_outage.sum() == 1


def test_a_long_hole_and_a_stated_gap_start_anew() -> None:
    time = np.concatenate([np.arange(10.0), 300 + np.arange(10.0), 330 + np.arange(5.0)])
    epochs = build_epochs(DriveLog("gpx", fixes(time), outages_s=np.array([330.0])), PLANE)
    assert LONGEST_BRIDGED_OUTAGE_S < 290
    assert np.flatnonzero(epochs.after_outage).tolist() == [0, 10, 20]


def test_fast_samples_are_averaged_and_yaw_on_the_circle() -> None:
    fast = np.arange(-0.45, 10.5, 0.1)
    wobble = np.where(np.arange(len(fast)) % 2 == 0, 0.1, -0.1)
    log = DriveLog(
        "ubx",
        fix=fixes(np.arange(10.0)),
        attitude=Attitude.assemble(
            fast, roll_rad=np.zeros(len(fast)), pitch_rad=0.03 + wobble, yaw_rad=np.mod(wobble, 2 * np.pi)
        ),
        force=SpecificForce.assemble(
            fast, acc_x_mps2=wobble, acc_y_mps2=0 * fast, acc_z_mps2=np.full(len(fast), 9.80665)
        ),
    )
    epochs = build_epochs(log, PLANE)
    assert np.allclose(epochs.pitch_rad, 0.03, atol=1e-9)
    # Around north: a plain mean of 0.1 and 2 pi - 0.1 would point south and turn the acceleration round.
    assert np.allclose(epochs.acc_n_mps2, -9.80665 * np.sin(0.03), atol=0.02)


def test_doppler_speed_goes_before_the_vehicles_and_that_before_positions() -> None:
    time = np.arange(10.0)
    velocity = GnssVelocity.assemble(time[:5], vel_n_mps=np.full(5, 3.0), vel_e_mps=np.full(5, 4.0))
    odometry = Odometry.assemble(time[:8], speed_mps=np.full(8, 7.0))
    epochs = build_epochs(DriveLog("csv", fixes(time), velocity=velocity, odometry=odometry), PLANE)
    assert np.allclose(epochs.speed_mps[:5], 5.0)
    assert np.allclose(epochs.speed_mps[5:8], 7.0)
    assert np.allclose(epochs.speed_mps[8:], 10.0, atol=1e-3)
    assert np.isnan(epochs.vel_u_mps).all()


def test_pitch_does_not_count_in_reverse_gear() -> None:
    time = np.arange(20.0)
    yaw = np.where(time < 10, np.pi / 2, -np.pi / 2)  # the vehicle goes east all the time
    log = DriveLog(
        "csv",
        fix=fixes(time),
        velocity=GnssVelocity.assemble(time, vel_n_mps=np.zeros(20), vel_e_mps=np.full(20, 10.0)),
        attitude=Attitude.assemble(time, pitch_rad=np.full(20, 0.05), yaw_rad=yaw),
    )
    epochs = build_epochs(log, PLANE)
    assert np.allclose(epochs.pitch_rad[:10], 0.05)
    assert np.isnan(epochs.pitch_rad[10:]).all()


def test_without_an_attitude_the_accelerometer_says_the_pitch() -> None:
    time = np.arange(30.0)
    log = DriveLog(
        "csv",
        fix=fixes(time),
        odometry=Odometry.assemble(time, speed_mps=10 + 0.5 * time),
        force=SpecificForce.assemble(time, acc_x_mps2=np.full(30, 0.5 + 9.80665 * np.sin(0.04))),
    )
    epochs = build_epochs(log, PLANE)
    assert np.allclose(epochs.pitch_rad, 0.04, atol=1e-6)


def test_heights_above_the_ellipsoid_serve_where_there_are_no_others() -> None:
    time = np.arange(5.0)
    fix = GnssFix.assemble(time, lon_deg=np.full(5, 8.0), lat_deg=np.full(5, 49.0), height_ell_m=150 + time)
    assert build_epochs(DriveLog("ubx", fix), PLANE).alt_m.tolist() == [150, 151, 152, 153, 154]


def test_yaw_the_vehicles_own_speed_and_its_turns_are_laid_on_the_epochs() -> None:
    """Yaw stays as logged; a gyroscope's rate is the mean over the epoch, so that steps of it add up to the turn."""
    fast = np.arange(-0.45, 10.5, 0.1)
    wobble = np.where(np.arange(len(fast)) % 2 == 0, 0.1, -0.1)
    log = DriveLog(
        "ubx",
        fix=fixes(np.arange(10.0)),
        attitude=Attitude.assemble(fast, yaw_rad=np.mod(np.pi + wobble, 2 * np.pi)),
        rate=AngularRate.assemble(fast, gyr_z_radps=0.2 + wobble),
        odometry=Odometry.assemble(np.arange(0.0, 5.0), speed_mps=np.full(5, 7.0)),
    )
    epochs = build_epochs(log, PLANE)
    assert np.allclose(np.abs(epochs.yaw_rad), np.pi, atol=1e-9)
    assert np.allclose(epochs.turn_radps, 0.2, atol=1e-9)
    assert epochs.odo_mps.tolist()[:5] == [7.0] * 5
    assert np.isnan(epochs.odo_mps[5:]).all()


def test_a_log_of_positions_has_no_yaw_no_turns_and_no_speed_signal() -> None:
    epochs = build_epochs(DriveLog("gpx", fixes(np.arange(20.0))), PLANE)
    for column in (epochs.yaw_rad, epochs.turn_radps, epochs.odo_mps):
        assert column.shape == (20,)
        assert np.isnan(column).all()
