"""How a phone lies in its vehicle: told from what it felt, or not told at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fusion.formats.phones.mounting import STANDARD_GRAVITY, TURNED, in_vehicle_axes
from fusion.types import DeviceMotion, DriveLog, Floats, GnssFix, GnssVelocity, ThreeAxes

DRIVE_S = 400.0


def vehicle_motion(seed: int = 1, bends: float = 1.0) -> tuple[Floats, Floats, Floats, GnssVelocity]:
    """Times, specific force and rates (n, 3) in the vehicle's axes, and velocities at 1 Hz, of a hilly drive."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, DRIVE_S, 0.05)
    speed = 11 + 4 * np.sin(time / 7) + 2 * np.sin(time / 2.9 + 1)
    turn = bends * 0.2 * np.sin(time / 11) * (np.sin(time / 37) > 0)  # to the left
    slope = 0.06 * np.sin(np.cumsum(speed) * 0.05 / 150)
    course = -np.cumsum(turn) * 0.05
    acceleration = np.gradient(speed, time)
    force = np.column_stack([
        acceleration + STANDARD_GRAVITY * slope, speed * turn, np.full(len(time), STANDARD_GRAVITY)
    ])  # fmt: skip
    force += rng.normal(0, 0.15, force.shape)
    rate = np.column_stack([0 * turn, -np.gradient(slope, time), turn]) + rng.normal(0, 0.005, force.shape)
    each = slice(0, None, 20)
    velocity = GnssVelocity.assemble(
        1.5e9 + time[each],
        vel_n_mps=(speed * np.cos(course))[each] + rng.normal(0, 0.05, len(time[each])),
        vel_e_mps=(speed * np.sin(course))[each] + rng.normal(0, 0.05, len(time[each])),
    )
    return 1.5e9 + time, force, rate, velocity


def phone_log(
    turned: Rotation, sign: int = 1, unit: float = 1.0, bends: float = 1.0, **left_out: bool
) -> DriveLog:
    """The drive as a phone tells it that lies in the vehicle in some way."""
    time, force, rate, velocity = vehicle_motion(bends=bends)
    fix = GnssFix.assemble(
        velocity.time_s, lat_deg=np.full(len(velocity), 50.0), lon_deg=np.full(len(velocity), 1.0)
    )
    felt, spun = turned.apply(force) * sign / unit, turned.apply(rate)
    device = DeviceMotion(force=ThreeAxes(time, *felt.T), rate=ThreeAxes(time, *spun.T))
    if left_out.get("rate"):
        device = replace(device, rate=ThreeAxes.empty())
    return DriveLog("test", fix, velocity, device=device)


rotations = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=25, deadline=None)
@given(rotations, st.sampled_from([1, -1]), st.sampled_from([1.0, STANDARD_GRAVITY]))
def test_forces_and_rates_come_out_in_the_vehicles_axes_however_the_phone_lies(
    quaternion: tuple[float, ...], sign: int, unit: float
) -> None:
    log = in_vehicle_axes(phone_log(Rotation.from_quat(quaternion), sign, unit))
    _, force, rate, _ = vehicle_motion()
    assert log.repaired[TURNED] == 1
    assert not log.warnings
    assert not log.device
    found = np.column_stack([log.force.acc_x_mps2, log.force.acc_y_mps2, log.force.acc_z_mps2])
    # what the mean slope and acceleration tilt is one more mount pitch: the rest agrees
    assert np.abs(found[:, 2] - force[:, 2]).max() < 0.5
    off = (found - force)[:, :2]
    assert np.abs(off - off.mean(axis=0)).max() < 0.35
    assert np.abs(off.mean(axis=0)).max() < 0.3
    turned = np.column_stack([log.rate.gyr_x_radps, log.rate.gyr_y_radps, log.rate.gyr_z_radps])
    assert np.abs(turned - rate).max() < 0.03


def test_on_a_straight_road_forward_is_found_and_what_is_left_open_is_left_out() -> None:
    log = in_vehicle_axes(
        phone_log(Rotation.from_euler("xyz", [80, 10, 35], degrees=True), bends=0.0, rate=True)
    )
    _, force, _, _ = vehicle_motion(bends=0.0)
    off = log.force.acc_x_mps2 - force[:, 0]
    assert np.abs(off - off.mean()).max() < 0.3
    assert not len(log.rate)


def test_without_velocities_nothing_but_the_turning_could_be_told_and_not_even_its_sign() -> None:
    log = in_vehicle_axes(replace(phone_log(Rotation.identity()), velocity=GnssVelocity.empty()))
    assert not len(log.force)
    assert not len(log.rate)
    assert any("cannot be told from this drive" in warning for warning in log.warnings)


def test_forces_that_have_nothing_to_do_with_the_drive_are_left_out() -> None:
    log = phone_log(Rotation.identity())
    rng = np.random.default_rng(2)
    force = log.device.force
    other = ThreeAxes(force.time_s, *(rng.normal(0, 1, (2, len(force)))), force.z)  # type: ignore[call-arg]
    log = in_vehicle_axes(replace(log, device=replace(log.device, force=other)))
    assert not len(log.force)
    assert len(log.rate)  # the turning agrees with the course
    assert np.isnan(log.rate.gyr_x_radps).all()


def test_a_phone_that_was_moved_says_nothing_of_forces() -> None:
    log = phone_log(Rotation.identity())
    force = log.device.force
    later = force.time_s > force.time_s[0] + DRIVE_S / 2
    swapped = ThreeAxes(
        force.time_s, force.x, np.where(later, force.z, force.y), np.where(later, force.y, force.z)
    )
    log = in_vehicle_axes(replace(log, device=replace(log.device, force=swapped)))
    assert not len(log.force)
    assert log.warnings == (
        "The phone's accelerometer and gyroscope are left out: the phone was moved on the drive; fix it to the "
        "vehicle.",
    )


@pytest.mark.parametrize("scale", [0.0, 0.3, 3.0])
def test_what_is_no_gravity_is_no_up(scale: float) -> None:
    log = phone_log(Rotation.identity())
    force = log.device.force
    scaled = ThreeAxes(force.time_s, *(getattr(force, n) * scale for n in "xyz"))
    log = in_vehicle_axes(replace(log, device=replace(log.device, force=scaled)))
    assert not len(log.force)
    assert "which gravity is not" in log.warnings[0]


def test_gravity_and_motion_apart_are_put_together() -> None:
    log = phone_log(Rotation.from_euler("x", 70, degrees=True))
    force = log.device.force
    down = Rotation.from_euler("x", 70, degrees=True).apply([0, 0, STANDARD_GRAVITY])
    moved = ThreeAxes(force.time_s, *(getattr(force, n) - down[k] for k, n in enumerate("xyz")))
    seldom = force.take(slice(None, None, 7))
    gravity = ThreeAxes(seldom.time_s, *(np.full(len(seldom), down[k]) for k in range(3)))
    apart = replace(log, device=DeviceMotion(moved=moved, gravity=gravity, rate=log.device.rate))
    whole, put = in_vehicle_axes(log), in_vehicle_axes(apart)
    assert put.force.acc_x_mps2 == pytest.approx(whole.force.acc_x_mps2[: len(put.force)], abs=1e-3)
