"""Drives: sensors agree with the truth, statistically where they are noisy and exactly where they are not."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import UnknownNameError
from fusion.frames import acceleration_enu, wrap_angle
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.receiver.profiles import RECEIVERS
from fusion.simulate.receiver.readings import gauss_markov
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write.csv_file import csv_columns

RATE_HZ = 20.0


@pytest.fixture(scope="module", params=(3, 4))
def perfect(request: pytest.FixtureRequest) -> SimulatedDrive:
    """A drive without any error, sampled densely."""
    return simulate_drive(make_town(2), request.param, 300.0, receiver="perfect", rate_hz=RATE_HZ)


@pytest.fixture(scope="module")
def several(town: Town) -> list[SimulatedDrive]:
    return [simulate_drive(town, 100 + k, 300.0, rate_hz=10.0) for k in range(8)]


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


def test_two_way_roads_are_driven_on_the_right(perfect: SimulatedDrive) -> None:
    town, truth = perfect.town, perfect.truth
    a, b = town.start[truth.segment], town.end[truth.segment]
    dx, dy = town.node_x_m[b] - town.node_x_m[a], town.node_y_m[b] - town.node_y_m[a]
    aside = dy * (truth.x_m - town.node_x_m[a]) - dx * (truth.y_m - town.node_y_m[a])
    right = np.where(truth.forward, 1, -1) * aside / town.length_m[truth.segment]
    two_way = town.roads.oneway[truth.segment] == 0
    assert np.median(right[two_way]) == pytest.approx(1.5, abs=0.4)
    if np.sum(~two_way) > 100:
        assert np.abs(np.median(right[~two_way])) < 1.0


def test_motion_is_that_of_a_car(several: list[SimulatedDrive]) -> None:
    for drive in several:
        t = np.arange(0, drive.motion.duration_s, 0.1)
        state = drive.motion.at(t)
        assert np.max(state.speed_mps) < 40
        assert np.min(np.sum(state.velocity_mps * heading(state.yaw_rad), axis=1)) > -0.05
        assert np.max(np.linalg.norm(state.acceleration_mps2[:, :2], axis=1)) < 4.5
        assert np.max(np.abs(state.yaw_rate_radps)) < 1.7
        course = np.arctan2(state.velocity_mps[:, 0], state.velocity_mps[:, 1])
        moving = state.speed_mps > 0.5
        assert np.max(np.abs(wrap_angle(course - state.yaw_rad)[moving])) < 1e-3
        assert state.speed_mps[0] < 0.1


def heading(yaw_rad: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(yaw_rad), np.cos(yaw_rad), np.zeros(len(yaw_rad))])


def test_some_drives_stop_on_the_way(several: list[SimulatedDrive]) -> None:
    stood = [np.mean(d.truth.speed_mps[d.elapsed_s > 10] < 0.05) for d in several]
    assert 0 < np.mean(stood) < 0.4


def test_one_way_roads_are_driven_one_way(several: list[SimulatedDrive]) -> None:
    for drive in several:
        oneway = drive.town.roads.oneway[drive.truth.segment]
        assert np.all(drive.truth.forward[oneway == 1])
        assert not np.any(drive.truth.forward[oneway == -1])


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


def test_the_body_moves_on_its_springs(several: list[SimulatedDrive]) -> None:
    off, squat, near, far = [], [], [], []
    for drive in several:
        state = drive.truth
        moving = state.speed_mps > 5
        d = (np.tan(state.pitch_rad) - state.grade)[moving]
        forward = np.sum(state.acceleration_mps2 * heading(state.yaw_rad), axis=1)[moving]
        off.append(np.std(d))
        squat.append(np.degrees(np.polyfit(forward, d, 1)[0]))
        near.append(np.corrcoef(d[1:], d[:-1])[0, 1])
        far.append(np.corrcoef(d[50:], d[:-50])[0, 1])
    assert 0.006 < np.mean(off) < 0.013
    assert np.mean(squat) == pytest.approx(0.2, abs=0.1)
    assert np.mean(near) > 0.9
    assert np.mean(far) < 0.4


def test_gravity_is_in_the_specific_force(several: list[SimulatedDrive]) -> None:
    for drive in several:
        still = drive.truth.speed_mps < 0.02
        force = drive.inertial.force_mps2[still].mean(axis=0) - drive.mounting.acc_bias_mps2
        assert np.linalg.norm(force) == pytest.approx(9.80665, abs=0.05)
        assert force[2] > 9.6


def test_gnss_is_lost_in_the_tunnel_and_in_outages(town: Town) -> None:
    drive = simulate_drive(town, 4, 900.0, outages=[(50.0, 20.0), (200.0, 5.0)], first=town.roads.tunnel)
    t = drive.elapsed_s
    cut = ((t >= 50) & (t < 70)) | ((t >= 200) & (t < 205))
    tunnel = town.roads.tunnel[drive.truth.segment]
    assert tunnel.sum() > 5
    np.testing.assert_array_equal(drive.has_gnss, ~(cut | tunnel))


@pytest.mark.parametrize(("rate_hz", "count"), ((1.0, 60), (5.0, 300), (10.0, 600)))
def test_epochs_come_at_the_rate_on_whole_milliseconds(town: Town, rate_hz: float, count: int) -> None:
    drive = simulate_drive(town, 2, 60.0, rate_hz=rate_hz)
    assert len(drive.elapsed_s) in (count - 1, count)
    np.testing.assert_allclose(np.diff(drive.elapsed_s), 1 / rate_hz, atol=1e-9)
    np.testing.assert_allclose(drive.elapsed_s * 1000, np.round(drive.elapsed_s * 1000), atol=1e-6)


def test_passes_follow_the_route(several: list[SimulatedDrive]) -> None:
    for drive in several:
        passes = drive.passes()
        length = drive.town.length_m
        assert [p.segment for p in passes] == list(drive.motion.route.segment[: len(passes)])
        assert all(0 <= p.driven_m <= length[p.segment] + 1e-9 for p in passes)
        whole = [p.driven_m / length[p.segment] for p in passes[1:-1]]
        assert np.median(whole) > 0.9


def test_visits_count_what_was_driven(town: Town) -> None:
    visits = np.zeros(len(town.roads), np.int64)
    drive = simulate_drive(town, 6, 120.0, visits=visits)
    expected = np.bincount([p.segment for p in drive.passes()], minlength=len(visits))
    np.testing.assert_array_equal(visits, expected)


def test_a_seed_makes_one_drive(town: Town) -> None:
    a, b, c = simulate_drive(town, 11, 60.0), simulate_drive(town, 11, 60.0), simulate_drive(town, 12, 60.0)
    for name, column in csv_columns(a).items():
        np.testing.assert_array_equal(column, csv_columns(b)[name])
    assert a.start_time_s != c.start_time_s
    assert not np.array_equal(a.gnss.alt_msl_m[:50], c.gnss.alt_msl_m[:50])


def test_a_driver_may_be_held_back(town: Town) -> None:
    plain, slow = (
        simulate_drive(town, 11, 200.0),
        simulate_drive(town, 11, 200.0, driver=Driver(top_speed_mps=6.0)),
    )
    assert plain.truth.speed_mps.max() > 8
    assert slow.truth.speed_mps.max() < 6.1
    np.testing.assert_array_equal(slow.motion.route.segment, plain.motion.route.segment)
    never = simulate_drive(town, 11, 400.0, driver=Driver(stop_chance=0.0))
    always = simulate_drive(town, 11, 400.0, driver=Driver(stop_chance=1.0))
    halts = [int(np.sum(np.diff((d.truth.speed_mps < 0.2).astype(int)) == 1)) for d in (never, always)]
    assert halts[0] == 0
    assert halts[1] >= 3


def test_bad_wishes_are_refused(town: Town) -> None:
    with pytest.raises(UnknownNameError, match="There is no receiver called 'x9'"):
        simulate_drive(town, 1, 60.0, receiver="x9")
    with pytest.raises(ValueError, match="positive duration"):
        simulate_drive(town, 1, 0.0)
    with pytest.raises(ValueError, match="positive duration and rate"):
        simulate_drive(town, 1, 60.0, rate_hz=0.0)
    with pytest.raises(ValueError, match=r"a top speed, not 0\.0 m/s"):
        simulate_drive(town, 1, 60.0, driver=Driver(top_speed_mps=0.0))


def test_profiles_have_no_negative_figure() -> None:
    assert {"m8", "phone", "f9p", "perfect"} <= set(RECEIVERS)
    for _, profile in RECEIVERS.items():
        assert all(getattr(profile, f.name) >= 0 for f in fields(profile))
