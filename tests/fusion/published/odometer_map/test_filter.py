"""The filter of ``odometer-map`` on motions whose answer is known: straight on, round a bend, standing, reversing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np
import pytest

from fusion.published.nine_state.motion import STATES, VX, VY, VZ, X, Y, Z
from fusion.published.nine_state.protocol import Estimate, Measurement, WheelReading
from fusion.published.odometer_map.filter import OdometerMapFilter
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.published.odometer_map.state import SCALE

TRACK, RADIUS = 1.5, 0.3
NOTHING = np.zeros(STATES)

SMOOTH = {"wheel_ticks_per_turn": 0, "wheel_error_share": 0.01, "wheel_each_error_share": 0.001}
"""Wheels that hardly err."""


def rotations(way_m: float, turn_rad: float) -> WheelReading:
    aside = 0.5 * TRACK * turn_rad
    return WheelReading((way_m - aside) / RADIUS, (way_m + aside) / RADIUS, math.nan)


def speed_only(speed_mps: float) -> WheelReading:
    return WheelReading(math.nan, math.nan, speed_mps)


def start(
    speed: float = 10.0, heading: float = 0.3, speed_sigma: float = 0.1, **options: object
) -> OdometerMapFilter:
    engine = OdometerMapFilter(OdometerMapOptions(**options))  # type: ignore[arg-type]
    mean = np.zeros(STATES)
    mean[[VX, VY, Z]] = speed * math.cos(heading), speed * math.sin(heading), 300.0
    engine.restart(mean, np.array([0.1, speed_sigma, 1.0, 0.1, speed_sigma, 1.0, 0.1, 0.1, 1.0]))
    engine.sense(None, Measurement(NOTHING, NOTHING))
    engine.locate(None, False, None, 0.0)
    return engine


def drive(engine: OdometerMapFilter, readings: Iterable[WheelReading | None]) -> list[Estimate]:
    out = []
    for wheels in readings:
        engine.sense(1.0, Measurement(NOTHING, NOTHING, wheels=wheels))
        out.append(engine.locate(None, False, None, 0.0))
    return out


def test_straight_on_the_odometer_is_the_distance() -> None:
    speeds = 10.0 + 4.0 * np.sin(np.arange(40) / 6)
    last = drive(start(**SMOOTH), [rotations(v, 0.0) for v in speeds])[-1]
    way = speeds.sum()
    along = last.state[X] * math.cos(0.3) + last.state[Y] * math.sin(0.3)
    assert along == pytest.approx(way, abs=1.0)
    assert last.heading_rad == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("turn", [-0.2, 0.05, 0.1])
def test_a_constant_turn_is_recovered_from_the_wheels(turn: float) -> None:
    """dTheta = (dR - dL) / e."""
    found = drive(start(**SMOOTH), [rotations(10.0, turn)] * 20)
    headings = np.unwrap([0.3] + [e.heading_rad for e in found])
    np.testing.assert_allclose(np.diff(headings)[3:], turn, rtol=0.02)
    assert headings[-1] - headings[0] == pytest.approx(20 * turn, rel=0.01)


def test_a_circle_ends_where_it_began() -> None:
    found = drive(start(**SMOOTH), [rotations(10.0, 2 * math.pi / 40)] * 40)
    across = found[19].state[[X, Y]]
    assert np.hypot(*across) == pytest.approx(10.0 * 40 / math.pi, rel=0.03)
    assert np.hypot(*found[-1].state[[X, Y]]) < 4.0


@pytest.mark.parametrize("discretisation", ["thesis", "exact"])
def test_the_way_corrects_speed_and_position_through_the_velocity_before(discretisation: str) -> None:
    """Were the velocity before taken as known, (4) and (5) as printed would say nothing of the speed."""
    engine = start(speed_sigma=5.0, discretisation=discretisation, **SMOOTH)
    found = drive(engine, [rotations(14.0, 0.0)] * 6)
    assert np.hypot(*found[-1].state[[VX, VY]]) == pytest.approx(14.0, abs=0.3)
    ways = [np.hypot(*(b.state[[X, Y]] - a.state[[X, Y]])) for a, b in pairwise(found[1:])]
    np.testing.assert_allclose(ways, 14.0, atol=0.3)


def test_wheels_that_stand_still_stop_the_vehicle_and_do_not_spin_it() -> None:
    engine = start(**SMOOTH)
    drive(engine, [rotations(way, 0.0) for way in (9.0, 6.0, 3.0, 0.8)])
    standing = drive(engine, [rotations(0.0, 0.0)] * 60)
    assert all(np.hypot(*e.state[[VX, VY]]) < 0.05 for e in standing[1:])
    assert all(e.heading_rad == pytest.approx(0.3, abs=0.03) for e in standing)
    moved = standing[-1].state[[X, Y]] - standing[0].state[[X, Y]]
    assert np.hypot(*moved) < 0.3
    gone = drive(engine, [rotations(way, 0.0) for way in (0.7, 2.1, 3.5, 4.9, 6.3)])
    assert gone[-1].heading_rad == pytest.approx(0.3, abs=0.05)
    way = gone[-1].state[[X, Y]] - standing[-1].state[[X, Y]]
    assert way @ [math.cos(0.3), math.sin(0.3)] == pytest.approx(17.5, abs=1.0)


def test_a_turn_on_the_spot_is_remembered() -> None:
    """Wheels feel a turn at walking pace, where the velocity's direction is noise."""
    engine = start(speed=2.0, **SMOOTH)
    drive(engine, [rotations(1.0, 0.0), rotations(0.0, 0.0)])
    drive(engine, [rotations(0.6, 0.4)] * 3)
    after = drive(
        engine, [rotations(0.0, 0.0), rotations(0.7, 0.0), rotations(2.0, 0.0), rotations(4.0, 0.0)]
    )
    assert after[-1].heading_rad == pytest.approx(0.3 + 1.2, abs=0.2)


def test_reversing_goes_back_along_the_nose() -> None:
    engine = start(speed=3.0, **SMOOTH)
    drive(engine, [rotations(way, 0.0) for way in (2.0, 0.8, 0.0)])
    at = drive(engine, [rotations(0.0, 0.0)])[-1].state[[X, Y]]
    back = drive(engine, [rotations(way, 0.0) for way in (-0.6, -1.5, -2.0, -2.0, -1.0, 0.0)])[-1]
    way = back.state[[X, Y]] - at
    assert way @ [math.cos(0.3), math.sin(0.3)] == pytest.approx(-7.1, abs=0.5)
    on = drive(engine, [rotations(way, 0.0) for way in (0.7, 2.1, 3.5)])[-1]
    assert on.heading_rad == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize("speed", [-1.5, -3.0])
def test_fixes_of_a_vehicle_that_reverses_do_not_turn_its_nose(speed: float) -> None:
    engine = start(speed=3.0, heading=0.0, policy="always", **SMOOTH)
    drive(engine, [rotations(way, 0.0) for way in (2.0, 0.8, 0.0, 0.0)])
    x = float(engine._state.mean[X])
    sigma = np.full(STATES, np.inf)
    sigma[[X, VX, Y, VY]] = 0.5, 0.05, 0.5, 0.05
    for k in range(1, 8):
        z = np.zeros(STATES)
        z[[X, VX]] = x + speed * k, speed
        engine.sense(1.0, Measurement(z, sigma**-2.0, wheels=rotations(speed, 0.0)))
        estimate = engine.locate(None, True, None, 0.0)
    assert abs(estimate.heading_rad) == pytest.approx(math.pi, abs=0.05)  # it travels west
    on = drive(engine, [rotations(way, 0.0) for way in (-1.0, 0.0, 0.0, 0.7, 2.1, 3.5)])[-1]
    assert on.heading_rad == pytest.approx(0.0, abs=0.1)


def test_a_first_reading_at_speed_is_laid_along_the_remembered_nose() -> None:
    """The state still stands when the wheels have gone 4 m: its own direction says nothing."""
    engine = start(speed=2.0, **SMOOTH)
    drive(engine, [rotations(way, 0.0) for way in (0.8, 0.0, 0.0)])
    engine._state.mean[[VX, VY]] = 0.04 * np.array([math.sin(0.3), -math.cos(0.3)])
    after = drive(engine, [rotations(4.0, 0.0)])[0]
    assert after.heading_rad == pytest.approx(0.3, abs=0.1)


def test_a_creeping_vehicle_of_unknown_heading_may_be_anywhere_near() -> None:
    engine = start(speed=0.0, speed_sigma=8.0, **SMOOTH)
    estimate = drive(engine, [rotations(2.0, 0.0)])[0]
    assert 1.5 < estimate.h_sigma_m < 5.0
    assert np.hypot(*estimate.state[[X, Y]]) < 2.0


def test_a_step_that_turns_too_far_for_a_chord_is_not_taken_for_one() -> None:
    """Readings 6 s apart: 30 m through 2.5 rad."""
    engine = start(speed=5.0, heading=0.0, **SMOOTH)
    engine.sense(6.0, Measurement(NOTHING, NOTHING, wheels=rotations(30.0, 2.5)))
    after = engine.locate(None, False, None, 0.0)
    radius = 30.0 / 2.5
    miss = after.state[[X, Y]] - radius * np.array([math.sin(2.5), 1 - math.cos(2.5)])
    assert np.hypot(*miss) < 2 * after.h_sigma_m


@pytest.mark.parametrize("discretisation", ["thesis", "exact"])
def test_a_long_step_is_several_short_ones(discretisation: str) -> None:
    long, short = start(discretisation=discretisation), start(discretisation=discretisation)
    long.sense(6.0, Measurement(NOTHING, NOTHING))
    for _ in range(6):
        short.sense(1.0, Measurement(NOTHING, NOTHING))
    for ours, theirs in zip(long._state.motion, short._state.motion, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_a_tail_taken_for_the_nose_is_turned_about() -> None:
    """An outage that begins while the vehicle reverses: the fixes had shown its course only."""
    found = drive(start(speed=3.0, heading=0.3, **SMOOTH), [rotations(-3.0, 0.0)] * 6)
    way = found[-1].state[[X, Y]]
    assert way @ [math.cos(0.3), math.sin(0.3)] == pytest.approx(18.0, abs=1.0)


def test_a_speed_signal_alone_gives_the_distance() -> None:
    speeds = 10.0 + 4.0 * np.sin(np.arange(1, 31) / 6)
    engine = start(wheel_error_share=0.001, speed_sigma_mps=0.05)
    last = drive(engine, [speed_only(v) for v in speeds])[-1]
    assert np.hypot(*last.state[[X, Y]]) == pytest.approx(speeds.sum(), rel=0.03)
    assert engine.counts["speed"] == 30
    assert engine.blind["turns"] == 30
    standing = drive(engine, [speed_only(v) for v in (6.0, 2.0, *[0.0] * 20)])
    assert np.hypot(*standing[-1].state[[VX, VY]]) < 0.05


@pytest.mark.parametrize("share", [0.02, 0.1])
def test_the_spread_along_a_straight_road_is_that_of_the_odometer(share: float) -> None:
    """Nothing but the odometer knows how far: n white errors of a share of the way add up to sqrt(n)."""
    engine = start(wheel_error_share=share, wheel_each_error_share=0.001, wheel_ticks_per_turn=0)
    drive(engine, [rotations(10.0, 0.0)] * 40)
    options, (_, covariance) = OdometerMapOptions(), engine._state.motion
    along = np.zeros(STATES)
    along[[X, Y]] = math.cos(0.3), math.sin(0.3)
    # A step of the velocity's own noise moves the mean velocity, which wheels measure, by half of it.
    of_model = math.hypot(0.5 * options.sigma_vel_mps, options.sigma_pos_m)
    expected = math.hypot(1.0, math.sqrt(40) * math.hypot(share * 10.0, of_model))
    assert math.sqrt(along @ covariance @ along) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("ticks", [24, 96])
def test_rounding_does_not_add_up(ticks: int) -> None:
    """The roundings of successive readings cancel: after 60 steps the heading is as good as one tick says.

    Taken as white, a tick's error would grow with the square root of the steps.
    """
    engine = start(wheel_ticks_per_turn=ticks, wheel_error_share=0.02, wheel_each_error_share=1e-6)
    tick = 2 * math.pi / ticks
    turn = 0.02 * np.sin(np.arange(1, 61) / 5)
    left = np.cumsum((10.0 - 0.75 * turn) / RADIUS)
    right = np.cumsum((10.0 + 0.75 * turn) / RADIUS)
    counted = [np.diff(tick * np.floor(w / tick + 0.4), prepend=0.0) for w in (left, right)]
    found = drive(engine, [WheelReading(a, b, math.nan) for a, b in zip(*counted, strict=True)])
    one = tick * RADIUS * math.sqrt(2) / TRACK
    assert found[-1].heading_rad == pytest.approx(0.3 + turn.sum(), abs=one + 0.03)
    white = one / math.sqrt(6) * math.sqrt(60)
    row = np.zeros(STATES)
    _, covariance = engine._state.motion
    row[[VX, VY]] = -math.sin(0.3) / 10, math.cos(0.3) / 10
    sigma = math.sqrt(row @ covariance @ row)
    assert sigma < 0.6 * math.hypot(0.01, white)


def test_missing_readings_and_strange_ones_leave_numbers() -> None:
    """Spins, jolts, silence, half a wheel: no NaN, no indefinite covariance."""
    rng = np.random.default_rng(4)
    engine = start()
    readings: list[WheelReading | None] = []
    for _ in range(400):
        way, turn = rng.choice([0.0, 0.02, 0.5, 3.0, 30.0, -2.0]), rng.normal() * rng.choice([0.0, 0.1, 2.0])
        kinds = [None, rotations(way, turn), speed_only(abs(way)), WheelReading(way, math.nan, math.nan)]
        readings.append(kinds[rng.integers(4)])
    for wheels in readings:
        predicted = engine.sense(1.0, Measurement(NOTHING, NOTHING, wheels=wheels))
        assert np.linalg.eigvalsh(predicted.covariance)[0] >= -1e-6
        road = (predicted.x_m + 1.0, predicted.y_m, predicted.heading_rad)
        estimate = engine.locate(road if rng.random() < 0.5 else None, rng.random() < 0.5, None, 0.0)
        assert np.isfinite(estimate.state).all()
        assert math.isfinite(estimate.heading_rad + estimate.h_sigma_m + estimate.z_sigma_m)


@pytest.mark.parametrize("correction", ["line", "point"])
def test_a_road_says_where_across_and_as_a_point_also_where_along(correction: str) -> None:
    engine = start(heading=0.0, map_correction=correction, map_sigma_m=1.0)
    before = engine.sense(1.0, Measurement(NOTHING, NOTHING))
    estimate = engine.locate((before.x_m + 5.0, before.y_m + 3.0, 0.0), True, None, 0.0)
    assert 1.0 < estimate.state[Y] < 3.0
    along = estimate.state[X] - before.x_m
    if correction == "line":
        assert along == pytest.approx(0.0, abs=1e-6)
    else:
        assert 1.5 < along < 5.0


def test_a_line_leaves_the_spread_along_it_and_a_point_does_not() -> None:
    def spread(correction: str) -> float:
        engine = start(heading=0.0, map_correction=correction)
        for _ in range(20):
            at = engine.sense(1.0, Measurement(NOTHING, NOTHING, wheels=rotations(10.0, 0.0)))
            engine.locate((at.x_m, at.y_m, 0.0), True, None, 0.0)
        return math.sqrt(engine._state.motion[1][X, X])

    assert spread("line") == pytest.approx(math.hypot(1.0, math.sqrt(20)), rel=0.1)
    assert spread("point") < 0.7 * spread("line")


def test_in_a_bend_the_roads_direction_counts_less() -> None:
    def heading(turn: float) -> float:
        engine = start(heading=0.0, **SMOOTH)
        at = engine.sense(1.0, Measurement(NOTHING, NOTHING, wheels=rotations(10.0, turn)))
        after = engine.locate((at.x_m, at.y_m, at.heading_rad + 0.3), True, None, 0.0)
        return abs(math.remainder(after.heading_rad - at.heading_rad, 2 * math.pi))

    assert heading(0.5) < 0.6 * heading(0.0)


def test_altitude_is_open_loop_and_says_so() -> None:
    """z and its spread without any height: the climb fades, the spread grows by what roads can do."""
    engine = start(speed=10.0)
    engine._state.mean[VZ] = 0.8
    found = drive(engine, [rotations(10.0, 0.0)] * 40)
    sigmas = [e.z_sigma_m for e in found]
    assert all(b > a for a, b in pairwise(sigmas))
    assert 5.0 < sigmas[-1] < 40.0
    assert abs(found[-1].state[VZ]) < 0.2
    assert 300.0 < found[-1].state[Z] < 320.0


@pytest.mark.parametrize("radius", [0.3, 0.33])
def test_lasting_errors_of_the_radii_are_learned_while_there_are_fixes(radius: float) -> None:
    """Wheels of 0.3 m that are given as 10 % larger, and 1 % larger on the left."""
    engine = start(
        heading=0.0,
        policy="always",
        wheel_radius_left_m=radius * 1.01,
        wheel_radius_right_m=radius,
        wheel_error_share=0.02,
    )
    sigma = np.full(STATES, np.inf)
    sigma[[X, VX, Y, VY]] = 1.0, 0.1, 1.0, 0.1
    for e in range(1, 200):
        z = np.zeros(STATES)
        z[[X, VX]] = 10.0 * e, 10.0
        engine.sense(1.0, Measurement(z, sigma**-2.0, wheels=rotations(10.0, 0.0)))
        engine.locate(None, True, None, 0.0)
    factor, spread = engine.scale
    assert factor == pytest.approx(0.3 / radius, abs=0.008 + 0.1 * abs(1 - 0.3 / radius))
    assert spread < 0.005
    left, right = engine._state.mean[SCALE]
    assert left - right == pytest.approx(0.01, abs=0.003)
    engine.restart(np.zeros(STATES), np.ones(STATES))
    engine.sense(None, Measurement(NOTHING, NOTHING))
    engine.locate(None, False, None, 0.0)
    assert engine.scale == (factor, spread)


def test_the_papers_policy_has_no_lasting_errors() -> None:
    engine = start()
    drive(engine, [rotations(10.0, 0.0)] * 10)
    assert engine.scale == (1.0, 0.0)


@pytest.mark.parametrize("make", [lambda: rotations(10.0, 0.0), lambda: speed_only(10.0), lambda: None])
def test_what_corrected_an_epoch_is_counted(make: Callable[[], WheelReading | None]) -> None:
    engine = start()
    drive(engine, [make()] * 7)
    wheels = make()
    kind = None if wheels is None else "wheels" if math.isfinite(wheels.left_rad) else "speed"
    assert engine.counts["open_loop"] == 7
    assert engine.counts["wheel"] == (7 if kind == "wheels" else 0)
    assert engine.counts["speed"] == (7 if kind == "speed" else 0)
    assert engine.blind["everything"] == (7 if kind is None else 0)
