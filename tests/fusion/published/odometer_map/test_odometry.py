"""Wheels, speed and road as functions of the state, (3)-(7) of Lahrech et al. 2005: closed forms, derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fusion.published.nine_state.motion import STATES, VX, VY, X, Y
from fusion.published.odometer_map.filter import road_measurement
from fusion.published.odometer_map.odometry import (
    WheelGeometry,
    direction,
    heading_axes,
    speed_measurement,
    wheel_measurement,
)

CAR = WheelGeometry(1.5, (0.3, 0.31))

speeds = st.floats(1.0, 50.0)
headings = st.floats(-math.pi, math.pi)
turns = st.floats(-0.6, 0.6)


def velocity(speed: float, heading: float) -> np.ndarray:
    return speed * np.array([math.cos(heading), math.sin(heading)])


def slopes(f: Callable[[np.ndarray], float | np.ndarray], at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences, shape (m, n)."""
    columns = []
    for k in range(len(at)):
        aside = np.zeros(len(at))
        aside[k] = step
        columns.append((np.atleast_1d(f(at + aside)) - np.atleast_1d(f(at - aside))) / (2 * step))
    return np.column_stack(columns)


@given(speeds, speeds, headings, turns, st.sampled_from([1.0, 0.5]), st.floats(0.2, 2.0))
def test_the_wheels_jacobian_is_the_derivative(
    before: float, after: float, heading: float, turn: float, share: float, dt_s: float
) -> None:
    at = np.concatenate([velocity(before, heading), velocity(after, heading + turn)])
    assume(min(before, after) * dt_s > 1.0)  # where a wheel may turn backwards its rotation has a kink
    expected, jacobian = wheel_measurement(at[:2], at[2:], dt_s, share, CAR)
    numeric = slopes(lambda v: wheel_measurement(v[:2], v[2:], dt_s, share, CAR)[0], at)
    np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-6)
    assert np.all(expected > 0)


@given(speeds, headings)
def test_the_speeds_jacobian_is_the_derivative(speed: float, heading: float) -> None:
    at = velocity(speed, heading)
    expected, row = speed_measurement(at)
    assert expected == pytest.approx(speed)
    np.testing.assert_allclose(row[None], slopes(lambda v: speed_measurement(v)[0], at), atol=1e-7)


@given(st.floats(0.0, 20.0), headings)
def test_a_direction_has_a_derivative_at_any_speed(speed: float, heading: float) -> None:
    along, derivative = direction(velocity(speed, heading))
    assert np.hypot(*along) <= 1 + 1e-12
    assume(abs(speed - 0.5) > 1e-3)
    numeric = slopes(lambda v: direction(v)[0], velocity(speed, heading), 1e-7)
    np.testing.assert_allclose(derivative, numeric, atol=1e-5)


def test_straight_on_a_wheel_turns_by_the_way_over_its_radius() -> None:
    rotations, _ = wheel_measurement(velocity(8.0, 0.7), velocity(12.0, 0.7), 1.0, 0.5, CAR)
    assert rotations == pytest.approx([10.0 / 0.3, 10.0 / 0.31])
    printed, _ = wheel_measurement(velocity(8.0, 0.7), velocity(12.0, 0.7), 1.0, 1.0, CAR)
    assert printed == pytest.approx([8.0 / 0.3, 8.0 / 0.31])


@given(speeds, headings, st.floats(-0.3, 0.3))
def test_in_a_bend_the_wheels_differ_by_the_turn(speed: float, heading: float, turn: float) -> None:
    """dTheta = (dR - dL) / e and dD = (dR + dL) / 2, to the third order that chords leave out."""
    assume(speed > 2.0)  # slower, the inner wheel would come to a stop
    before, after = velocity(speed, heading - turn / 2), velocity(speed, heading + turn / 2)
    rotations, _ = wheel_measurement(before, after, 1.0, 0.5, CAR)
    way, turned = CAR.way_and_turn(*rotations)
    assert turned == pytest.approx(turn, abs=0.02 * abs(turn) + 1e-9)
    assert way == pytest.approx(speed, rel=0.02)


def test_a_turn_to_the_left_turns_the_right_wheel_further() -> None:
    left, right = wheel_measurement(
        velocity(5.0, 0.0), velocity(5.0, 0.4), 1.0, 0.5, WheelGeometry(1.5, (0.3, 0.3))
    )[0]
    assert right > left


@given(headings, headings, speeds)
def test_the_maps_jacobian_is_the_derivative(road: float, heading: float, speed: float) -> None:
    state = np.arange(9.0)
    state[[VX, VY]] = velocity(speed, heading)
    turned = math.remainder(road - heading, 2 * math.pi)
    assume(abs(abs(turned) - math.pi) > 0.01)  # the innovation wraps there
    innovation, jacobian = road_measurement(state, (40.0, -7.0, road))
    numeric = -slopes(lambda s: road_measurement(s, (40.0, -7.0, road))[0], state)
    np.testing.assert_allclose(jacobian, numeric, atol=1e-6)
    assert innovation[2] == pytest.approx(turned)


def test_the_maps_innovation_is_along_and_to_the_left_of_the_road() -> None:
    state = np.zeros(STATES)
    state[[X, Y, VX, VY]] = 10.0, 20.0, 0.0, 9.0
    innovation, _ = road_measurement(
        state, (7.0, 24.0, math.pi / 2)
    )  # the road runs north, 3 m west and 4 m ahead
    assert innovation == pytest.approx([4.0, 3.0, 0.0])


@given(headings)
def test_the_axes_of_a_heading_are_a_rotation(heading: float) -> None:
    axes = heading_axes(heading)
    np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(axes @ velocity(3.0, heading), [3.0, 0.0], atol=1e-12)
