"""How a vehicle moves: within what a car can do, with halts, on its springs."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.frames import wrap_angle
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.scene.town import Town


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
