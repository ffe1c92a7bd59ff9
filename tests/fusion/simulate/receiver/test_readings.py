"""What a receiver reads: statistically the truth where it is noisy, exactly where it is not."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.frames import acceleration_enu
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.receiver.readings import RECEIVERS, gauss_markov
from fusion.simulate.scene.town import Town

RATE_HZ = 20.0
"""Of the drive ``perfect``."""


def integrate(rate: np.ndarray) -> np.ndarray:
    """Trapezoidal integral over the samples, from zero."""
    step = (rate[1:] + rate[:-1]) / 2 / RATE_HZ
    return np.concatenate([np.zeros((1, *rate.shape[1:])), np.cumsum(step, axis=0)])


def test_perfect_vertical_velocity_integrates_to_the_heights(perfect: SimulatedDrive) -> None:
    climbed = integrate(-perfect.gnss.velocity_ned_mps[:, 2])
    z = perfect.gnss.alt_msl_m
    np.testing.assert_allclose(climbed, z - z[0], atol=0.02)
    assert np.ptp(z) > 5


def test_perfect_velocity_integrates_to_the_positions(perfect: SimulatedDrive) -> None:
    moved = integrate(perfect.gnss.velocity_ned_mps)
    np.testing.assert_allclose(moved[:, 1], perfect.gnss.x_m - perfect.gnss.x_m[0], atol=0.3)
    np.testing.assert_allclose(moved[:, 0], perfect.gnss.y_m - perfect.gnss.y_m[0], atol=0.3)


def test_perfect_specific_force_integrates_to_the_velocity(perfect: SimulatedDrive) -> None:
    imu = perfect.inertial
    enu = acceleration_enu(imu.force_mps2, imu.roll_rad, imu.pitch_rad, imu.yaw_rad)
    ned = perfect.gnss.velocity_ned_mps
    gained = integrate(enu)
    np.testing.assert_allclose(gained[:, 0], ned[:, 1] - ned[0, 1], atol=0.15)
    np.testing.assert_allclose(gained[:, 1], ned[:, 0] - ned[0, 0], atol=0.15)
    np.testing.assert_allclose(gained[:, 2], ned[0, 2] - ned[:, 2], atol=0.15)


def test_perfect_gyroscope_integrates_to_the_attitude(perfect: SimulatedDrive) -> None:
    imu = perfect.inertial
    turned = integrate(imu.rate_radps)
    yaw = np.unwrap(imu.yaw_rad)
    assert np.ptp(yaw) > 2
    # z up counts anticlockwise, yaw clockwise; on slopes of some percent the difference of the axes is small
    np.testing.assert_allclose(turned[:, 2], yaw[0] - yaw, atol=0.03 * np.ptp(yaw))
    straight = np.abs(imu.rate_radps[:, 2]) < 0.02
    pitch_rate = np.gradient(imu.pitch_rad, 1 / RATE_HZ)
    np.testing.assert_allclose(-imu.rate_radps[straight, 1], pitch_rate[straight], atol=0.02)


def test_perfect_pitch_is_the_road_and_speed_is_the_odometer(perfect: SimulatedDrive) -> None:
    np.testing.assert_allclose(np.tan(perfect.inertial.pitch_rad), perfect.truth.grade, atol=3e-3)
    speed = np.linalg.norm(perfect.gnss.velocity_ned_mps, axis=1)
    np.testing.assert_allclose(perfect.inertial.odo_speed_mps, speed, atol=1e-9)


def test_perfect_heights_are_the_roads_plus_the_antenna(perfect: SimulatedDrive) -> None:
    town, truth = perfect.town, perfect.truth
    road = town.road_height(truth.segment, truth.distance_m / town.length_m[truth.segment])
    off = perfect.gnss.alt_msl_m - perfect.antenna_m - road
    assert np.sqrt(np.mean(off**2)) < 0.1  # corners and kinks are rounded
    assert perfect.antenna_m == 1.55


def test_antenna_height_is_an_option(town: Town) -> None:
    low, high = (simulate_drive(town, 9, 60.0, receiver="perfect", antenna_m=a) for a in (0.0, 2.0))
    np.testing.assert_allclose(high.gnss.alt_msl_m - low.gnss.alt_msl_m, 2.0)


@given(sigma=st.floats(0.1, 10), tau=st.floats(2, 40), interval=st.floats(0.1, 1), seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_gauss_markov_has_its_sigma_and_time_constant(
    sigma: float, tau: float, interval: float, seed: int
) -> None:
    n = int(4000 * tau / interval)  # 4000 time constants: the sample variance is good to some 3 %
    e = gauss_markov(n, interval, sigma, tau, np.random.default_rng(seed))
    assert np.std(e) == pytest.approx(sigma, rel=0.15)
    lag = max(1, round(tau / interval))
    expected = np.exp(-lag * interval / tau)
    assert np.mean(e[lag:] * e[:-lag]) / np.var(e) == pytest.approx(expected, abs=0.12)


def test_gauss_markov_starts_in_its_stationary_state() -> None:
    first = [gauss_markov(3, 1.0, 2.0, 100.0, np.random.default_rng(k))[0] for k in range(2000)]
    assert np.std(first) == pytest.approx(2.0, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("receiver", ("m8", "m8u", "phone", "f9p"))
def test_errors_have_the_size_that_the_profile_says(town: Town, receiver: str) -> None:
    p = RECEIVERS[receiver]
    drives = [simulate_drive(town, 300 + k, 120.0, receiver=receiver) for k in range(40)]
    doppler = np.concatenate([d.gnss.velocity_ned_mps[:, 2] + d.truth.velocity_mps[:, 2] for d in drives])
    assert np.std(doppler) == pytest.approx(p.doppler_vertical_mps, rel=0.1)
    north = np.concatenate([d.gnss.velocity_ned_mps[:, 0] - d.truth.velocity_mps[:, 1] for d in drives])
    assert np.std(north) == pytest.approx(p.doppler_mps, rel=0.1)
    # one independent sample per drive for what is correlated; the standard error of an sd of 40 is 11 %
    up = [d.gnss.alt_msl_m[50] - d.antenna_m - d.truth.z_m[50] for d in drives]
    total = np.sqrt(p.vertical_m**2 + p.vertical_white_m**2 + p.vertical_bias_m**2)
    assert np.std(up) == pytest.approx(total, rel=0.5)
    east = [d.gnss.x_m[50] - d.truth.x_m[50] for d in drives]
    assert np.std(east) == pytest.approx(np.hypot(p.horizontal_m / 2**0.5, p.horizontal_white_m), rel=0.5)
    mount = [np.degrees(np.mean(d.inertial.pitch_rad - d.truth.pitch_rad)) for d in drives]
    assert np.std(mount) == pytest.approx(p.mount_deg, rel=0.5)
    noise = np.concatenate([d.inertial.pitch_rad - d.truth.pitch_rad - d.mounting.pitch_rad for d in drives])
    assert np.degrees(np.std(noise)) == pytest.approx(p.pitch_deg, rel=0.1)


def test_gravity_is_in_the_specific_force(several: list[SimulatedDrive]) -> None:
    for drive in several:
        still = drive.truth.speed_mps < 0.02
        force = drive.inertial.force_mps2[still].mean(axis=0) - drive.mounting.acc_bias_mps2
        assert np.linalg.norm(force) == pytest.approx(9.80665, abs=0.05)
        assert force[2] > 9.6


def test_profiles_have_no_negative_figure() -> None:
    assert {"m8", "phone", "f9p", "perfect"} <= set(RECEIVERS)
    for _, profile in RECEIVERS.items():
        assert all(getattr(profile, f.name) >= 0 for f in fields(profile))
