"""Counters to rotations between epochs: interpolation, gaps, resets, other sensors in the wheels' place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.frames import LocalProjection
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.odometer_map.method import (
    Rotations,
    WheelSensors,
    rotations_between,
    with_inertial_turns,
    without_waiting,
)
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.types import AngularRate, Attitude, DriveLog, GnssFix, Odometry

PLANE = LocalProjection(7.85, 47.99)
OPTIONS = OdometerMapOptions()
T0 = 1000.0


def make_log(
    fix_s: np.ndarray,
    wheel_s: np.ndarray,
    left: np.ndarray,
    right: np.ndarray | None = None,
    **tables: object,
) -> DriveLog:
    n = len(fix_s)
    fix = GnssFix(
        time_s=T0 + fix_s,
        lat_deg=np.full(n, 47.99),
        lon_deg=7.85 + 1e-4 * fix_s,
        alt_msl_m=np.full(n, 300.0),
        height_ell_m=np.full(n, np.nan),
        h_acc_m=np.full(n, np.nan),
        v_acc_m=np.full(n, np.nan),
    )
    odometry = Odometry(
        time_s=T0 + wheel_s,
        wheel_left_rad=left,
        wheel_right_rad=left if right is None else right,
        speed_mps=np.full(len(wheel_s), np.nan),
    )
    return DriveLog("csv", fix, odometry=odometry, **tables)  # type: ignore[arg-type]


def between(log: DriveLog) -> tuple[Epochs, Rotations]:
    epochs = build_epochs(log, PLANE, 1.0)
    return epochs, rotations_between(log, epochs)


def test_rotations_are_the_differences_of_counters_read_at_the_epochs() -> None:
    wheel_s = np.arange(-0.37, 10.5, 0.1)
    rotated = 30 * wheel_s + np.sin(wheel_s)
    _, found = between(make_log(np.arange(10.0), wheel_s, rotated, 31 * wheel_s))
    t = np.arange(10.0)
    assert np.isnan(found.left_rad[0])
    np.testing.assert_allclose(found.left_rad[1:], np.diff(30 * t + np.sin(t)), atol=2e-3)
    np.testing.assert_allclose(found.right_rad[1:], 31.0, atol=1e-9)


def test_the_epochs_before_and_after_the_counters_know_nothing() -> None:
    wheel_s = np.arange(3.2, 6.9, 0.1)
    _, found = between(make_log(np.arange(10.0), wheel_s, 30 * wheel_s))
    assert np.flatnonzero(found.known).tolist() == [5, 6]  # from 4 to 5 and from 5 to 6


@pytest.mark.parametrize("jump_rad", [-1e4, 1e5, -(2**16) * 2 * np.pi / 96])
def test_a_counter_that_begins_anew_costs_one_step(jump_rad: float) -> None:
    wheel_s = np.arange(0.0, 12.0, 0.25)
    rotated = 30 * wheel_s + np.where(wheel_s > 5.3, jump_rad, 0.0)
    _, found = between(make_log(np.arange(12.0), wheel_s, rotated))
    assert np.flatnonzero(~found.known).tolist() == [0, 6]
    np.testing.assert_allclose(found.left_rad[found.known], 30.0)


def test_a_reset_soon_after_the_start_is_seen_by_its_neighbours() -> None:
    """From 60 rad back to 0 between two samples: no wheel runs backwards for a moment."""
    rotated = np.array([0.0, 20, 40, 60, 0, 20, 40, 60, 80])
    _, found = between(make_log(np.arange(9.0), np.arange(9.0), rotated))
    assert np.flatnonzero(~found.known).tolist() == [0, 4]


def test_hard_braking_is_no_reset() -> None:
    rate = np.array([50.0, 50, 50, 20, 0, 0, 0, 25, 50, 50])
    _, found = between(make_log(np.arange(10.0), np.arange(10.0), np.cumsum(rate)))
    assert found.known[1:].all()


def test_coarse_ticks_at_a_high_rate_are_no_reset() -> None:
    wheel_s = np.arange(0.0, 8.0, 0.01)
    tick = 2 * np.pi / 20
    _, found = between(make_log(np.arange(7.0), wheel_s, tick * np.floor(20 * wheel_s / tick)))
    assert found.known[1:].all()
    np.testing.assert_allclose(found.left_rad[1:], 20.0, atol=tick)


def test_nothing_is_read_across_a_hole_or_a_stated_gap() -> None:
    wheel_s = np.arange(0.0, 12.0, 0.2)
    holed = wheel_s[(wheel_s < 4.05) | (wheel_s > 6.95)]
    _, found = between(make_log(np.arange(12.0), holed, 30 * holed))
    assert np.flatnonzero(~found.known).tolist() == [0, 5, 6, 7]
    whole = make_log(np.arange(12.0), wheel_s, 30 * wheel_s)
    _, found = between(replace(whole, outages_s=np.array([T0 + 4.5])))
    assert np.flatnonzero(~found.known).tolist() == [0, 5]


def test_missing_cells_of_one_wheel_leave_the_other() -> None:
    wheel_s = np.arange(10.0)
    right = np.where((wheel_s > 2) & (wheel_s < 8), np.nan, 30 * wheel_s)
    _, found = between(make_log(wheel_s, wheel_s, 30 * wheel_s, right))
    assert np.isfinite(found.left_rad[1:]).all()
    assert np.flatnonzero(np.isfinite(found.right_rad)).tolist() == [1, 2, 9]


def test_a_log_without_wheels_has_no_rotations() -> None:
    log = replace(make_log(np.arange(5.0), np.arange(5.0), np.arange(5.0)), odometry=Odometry.empty())
    assert not between(log)[1].known.any()


def signal(time_s: np.ndarray, speed: float) -> Odometry:
    unknown = np.full(len(time_s), np.nan)
    return Odometry(T0 + time_s, unknown, unknown, np.full(len(time_s), speed))


def test_speed_and_gyroscope_stand_for_two_wheels() -> None:
    t = np.arange(6.0)
    zero = np.zeros(6)
    rate = AngularRate(T0 + t, zero, zero, np.full(6, 0.2))
    log = replace(make_log(t, t, t, rate=rate), odometry=signal(t, 10.0))
    epochs, found = between(log)
    made = with_inertial_turns(found, epochs, OPTIONS)
    np.testing.assert_allclose(made.left_rad[1:], (10.0 - 0.75 * 0.2) / 0.3)
    np.testing.assert_allclose(made.right_rad[1:], (10.0 + 0.75 * 0.2) / 0.3)


def test_without_a_gyroscope_the_yaw_turns_and_wraps() -> None:
    t = np.arange(6.0)
    unknown = np.full(6, np.nan)
    yaw = np.mod(0.35 - 0.2 * t, 2 * np.pi)  # anticlockwise, through north
    attitude = Attitude(T0 + t, unknown, unknown, yaw, unknown, unknown, unknown)
    log = replace(make_log(t, t, t, attitude=attitude), odometry=signal(t, 10.0))
    epochs, found = between(log)
    made = with_inertial_turns(found, epochs, OPTIONS)
    np.testing.assert_allclose(made.right_rad[1:] - made.left_rad[1:], 1.5 * 0.2 / 0.3)


def test_measured_wheels_are_not_replaced() -> None:
    t = np.arange(6.0)
    zero = np.zeros(6)
    log = make_log(t, t, 30 * t, rate=AngularRate(T0 + t, zero, zero, zero))
    log = replace(log, odometry=replace(log.odometry, speed_mps=np.full(6, 1.0)))
    epochs, found = between(log)
    made = with_inertial_turns(found, epochs, OPTIONS)
    np.testing.assert_array_equal(made.left_rad, found.left_rad)


@pytest.mark.parametrize("in_outages", [True, False])
def test_the_paper_does_not_look_at_wheels_while_there_is_a_fix(in_outages: bool) -> None:
    epochs, found = between(make_log(np.arange(5.0), np.arange(5.0), 30 * np.arange(5.0)))
    sensors = WheelSensors(epochs, OPTIONS, rotations=found, radii_m=(0.3, 0.3), in_outages=in_outages)
    with_fix = sensors.at(2, 1.0, use_fix=True, moving=True)
    without = sensors.at(2, 1.0, use_fix=False, moving=True)
    assert (with_fix.wheels is None) == in_outages
    assert without.wheels is not None
    assert without.wheels.left_rad == pytest.approx(30.0)


def test_one_wheel_alone_is_a_speed_signal() -> None:
    t = np.arange(5.0)
    epochs, found = between(make_log(t, t, 30 * t, np.full(5, np.nan)))
    sensors = WheelSensors(epochs, OPTIONS, rotations=found, radii_m=(0.3, 0.3), in_outages=True)
    wheels = sensors.at(2, 1.0, use_fix=False, moving=True).wheels
    assert wheels is not None
    assert wheels.speed_mps == pytest.approx(9.0)


def test_between_the_fixes_of_a_slow_receiver_nothing_fails() -> None:
    """Fixes every 2 s, wheels every second: no outage; but where two fixes are missing there is one."""
    fix_s = np.array([0.0, 2, 4, 6, 12, 14, 16])
    wheel_s = np.arange(17.0)
    epochs = build_epochs(make_log(fix_s, wheel_s, wheel_s), PLANE, 1.0)
    assert len(epochs) == 17
    kept = without_waiting(epochs)
    np.testing.assert_array_equal(kept.time_s - T0, [0, 2, 4, 6, 7, 8, 9, 10, 11, 12, 14, 16])
    assert kept.after_outage.tolist() == [True] + [False] * 11


def test_a_restart_between_two_fixes_is_not_lost() -> None:
    log = make_log(np.array([0.0, 2, 4, 6, 8]), np.arange(9.0), np.arange(9.0))
    kept = without_waiting(build_epochs(replace(log, outages_s=np.array([T0 + 4.5])), PLANE, 1.0))
    assert (kept.time_s[kept.after_outage] - T0).tolist() == [0.0, 6.0]
