"""What the wheels or a speed signal measure over a step, with Jacobians: Lahrech et al. 2005, (3)-(5) and (10).

``Odometry`` turns a reading into a measurement of the step that it ends. At speed that is (4) and (5), or |v|. Near
standstill neither has a Jacobian, and the velocity forgets where the nose points; there the way is laid along the
heading that is remembered. Wheels that stand still say more than a small number: the velocity is zero at both ends of
the step.

The functions below it take velocities (2,) at the two ends of a step, east and north, m/s; their Jacobians run over
(vx, vy) before, (vx, vy) after. Below ``SLOWEST_MPS`` derivatives are taken as if the vehicle moved that fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fusion.published.nine_state.measurements import SLOWEST_MPS
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.published.odometer_map.state import (
    AFTER,
    BEFORE,
    NEW_ROUNDING,
    ROUNDING,
    SCALE,
    WIDE,
    RememberedHeading,
)
from fusion.types import Floats

_STILL_M = 0.02  # a wheel of a vehicle that stands may rock so far between two readings
_STILL_MPS = 0.05  # one sigma of the velocity of a vehicle whose wheels stand still
_ASIDE_MPS = 0.05  # one sigma of the velocity across the heading that is remembered: wheels do not slide
_FLOOR_RAD = 0.005  # one sigma of a rotation that is left however short the way
_SHARPEST_RAD = 1.5  # turn within one step; beyond it the way is no chord any more
_BEND_SHARE = 0.05  # of what the wheels turn apart: tyres slip in bends

_TO_THE_RIGHT = np.array([[0.0, 1.0], [-1.0, 0.0]])


@dataclass(frozen=True)
class WheelGeometry:
    """Where the rear wheels touch the road, ``track_m`` apart, and the radii (left, right) they roll on, metres."""

    track_m: float
    radii_m: tuple[float, float]

    def way_and_turn(self, left_rad: float, right_rad: float) -> tuple[float, float]:
        """Way of the axle's middle, m, and turn to the left, rad, of two rotations."""
        left, right = left_rad * self.radii_m[0], right_rad * self.radii_m[1]
        return 0.5 * (left + right), (right - left) / self.track_m


@dataclass(frozen=True)
class StepMeasurement:
    """A measurement of a step, against the wide state: innovation (m,), Jacobian (m, 17), covariance (m, m)."""

    innovation: Floats
    jacobian: Floats
    noise: Floats


class Odometry:
    """Readings as measurements, by the options' geometry and accuracies."""

    def __init__(self, options: OdometerMapOptions) -> None:
        o = self._options = options
        self._geometry = WheelGeometry(o.track_width_m, (o.wheel_radius_left_m, o.wheel_radius_right_m))
        self._tick_rad = 2 * math.pi / o.wheel_ticks_per_turn if o.wheel_ticks_per_turn else 0.0
        self._ticks_m = max(self._geometry.radii_m) * self._tick_rad / math.sqrt(6)
        self._share = 1.0 if o.discretisation == "thesis" else 0.5

    @property
    def rounding_rad(self) -> Floats:
        """One sigma of the rounding of a reading: uniform over a tick, for each wheel (2,)."""
        return np.full(2, self._tick_rad / math.sqrt(12))

    @property
    def scale_covariance(self) -> Floats:
        """Lasting errors of the radii (left, right), as shares: what both have in common, and each for itself."""
        common, each = self._options.lasting_sigmas
        return np.full((2, 2), common**2) + each**2 * np.eye(2)

    def way_m(self, left_rad: float, right_rad: float) -> float:
        """Way of the axle's middle, negative backwards."""
        return self._geometry.way_and_turn(left_rad, right_rad)[0]

    def turned(self, heading: RememberedHeading, left_rad: float, right_rad: float) -> RememberedHeading:
        """Where the nose points after two rotations."""
        way, turn = self._geometry.way_and_turn(left_rad, right_rad)
        each = math.hypot(self._options.wheel_each_error_share, self._options.lasting_sigmas[1]) * way
        variance = 2 * (each**2 + self._ticks_m**2) / self._geometry.track_m**2
        return heading.turned(turn, variance + (_BEND_SHARE * turn) ** 2)

    def rotations(
        self, mean: Floats, dt_s: float, left_rad: float, right_rad: float, heading: RememberedHeading
    ) -> StepMeasurement:
        """Two rotations over a step; ``heading`` is the remembered one at its beginning."""
        way, turn = self._geometry.way_and_turn(left_rad, right_rad)
        rocked = max(self._tick_rad, _STILL_M / max(self._geometry.radii_m))
        if max(abs(left_rad), abs(right_rad)) <= rocked * (1 + 1e-9):
            return self._standing(mean, dt_s)
        if abs(turn) > _SHARPEST_RAD:
            return self._anywhere(mean, self._way_jacobian(dt_s), abs(way))
        slowest = min(way / dt_s, _speed(mean[BEFORE]), _speed(mean[AFTER]))
        if slowest >= self._options.min_speed_mps:
            return self._rolling(mean, dt_s, np.array([left_rad, right_rad]))
        after = self.turned(heading, left_rad, right_rad)
        if not after.known:
            return self._anywhere(mean, self._way_jacobian(dt_s), abs(way))
        return self._creeping(mean, dt_s, way, after.angle_rad - 0.5 * turn, after)

    def speed(self, mean: Floats, speed_mps: float, heading: RememberedHeading) -> StepMeasurement:
        """A speed signal at the end of a step; ``heading`` is the remembered one there."""
        o = self._options
        sigma = math.hypot(o.speed_sigma_mps, o.wheel_error_share * speed_mps)
        pick = np.zeros((2, WIDE))
        pick[0, AFTER[0]] = pick[1, AFTER[1]] = 1.0
        scale = 1.0 + float(mean[SCALE].mean())
        if min(speed_mps, _speed(mean[AFTER])) >= o.min_speed_mps:
            expected, along = speed_measurement(mean[AFTER])
            jacobian = scale * along[None] @ pick
            jacobian[0, SCALE] = 0.5 * expected
            return StepMeasurement(np.array([speed_mps - scale * expected]), jacobian, np.array([[sigma**2]]))
        if not heading.known:
            return self._anywhere(mean, pick, math.hypot(speed_mps, sigma))
        jacobian = heading_axes(heading.angle_rad) @ pick
        jacobian[0] *= scale
        aside = math.hypot(_ASIDE_MPS, speed_mps * math.sqrt(heading.variance))
        return StepMeasurement(
            np.array([speed_mps, 0.0]) - jacobian @ mean, jacobian, np.diag([sigma**2, aside**2])
        )

    def _rolling(self, mean: Floats, dt_s: float, measured_rad: Floats) -> StepMeasurement:
        """(4) and (5)."""
        expected, velocities = wheel_measurement(mean[BEFORE], mean[AFTER], dt_s, self._share, self._geometry)
        scale = 1.0 + mean[SCALE]
        jacobian = np.zeros((2, WIDE))
        jacobian[:, BEFORE] = scale[:, None] * velocities[:, :2]
        jacobian[:, AFTER] = scale[:, None] * velocities[:, 2:]
        jacobian[:, SCALE] = np.diag(expected)
        jacobian[:, NEW_ROUNDING], jacobian[:, ROUNDING] = np.eye(2), -np.eye(2)
        rounding = mean[NEW_ROUNDING] - mean[ROUNDING]
        bend = _BEND_SHARE * (expected[1] - expected[0])
        each = (self._options.wheel_each_error_share * expected) ** 2 + bend**2 + _FLOOR_RAD**2
        common = self._options.wheel_error_share * expected
        noise = np.outer(common, common) + np.diag(each)
        return StepMeasurement(measured_rad - scale * expected - rounding, jacobian, noise)

    def _standing(self, mean: Floats, dt_s: float) -> StepMeasurement:
        jacobian = np.zeros((4, WIDE))
        jacobian[:2] = self._way_jacobian(dt_s)
        jacobian[2, AFTER[0]] = jacobian[3, AFTER[1]] = 1.0
        way, speed = _STILL_M**2, _STILL_MPS**2
        return StepMeasurement(-jacobian @ mean, jacobian, np.diag([way, way, speed, speed]))

    def _creeping(
        self, mean: Floats, dt_s: float, way_m: float, middle_rad: float, after: RememberedHeading
    ) -> StepMeasurement:
        """Along and across the way, and across and along the velocity at its end.

        A vehicle that creeps does not turn back: its speed ends between nothing and twice the mean.
        """
        o, sigma = self._options, math.sqrt(after.variance)
        jacobian = np.zeros((4, WIDE))
        jacobian[:2] = heading_axes(middle_rad) @ self._way_jacobian(dt_s)
        jacobian[0] *= 1.0 + float(mean[SCALE].mean())
        jacobian[2:, AFTER] = heading_axes(after.angle_rad)[::-1]
        mean_mps = way_m / dt_s
        along = math.hypot(o.wheel_error_share, o.wheel_each_error_share) * way_m
        variances = [
            along**2 + self._ticks_m**2 + _STILL_M**2,
            (sigma * way_m) ** 2 + _STILL_M**2,
            (sigma * mean_mps) ** 2 + _ASIDE_MPS**2,
            mean_mps**2 + _STILL_MPS**2,
        ]
        return StepMeasurement(
            np.array([way_m, 0.0, 0.0, mean_mps]) - jacobian @ mean, jacobian, np.diag(variances)
        )

    def _anywhere(self, mean: Floats, jacobian: Floats, size: float) -> StepMeasurement:
        """A vector of known size and unknown direction: zero, give or take the size."""
        return StepMeasurement(-jacobian @ mean, jacobian, max(size, _STILL_M) ** 2 * np.eye(2))

    def _way_jacobian(self, dt_s: float) -> Floats:
        """Of the way over the step, shape (2, 17)."""
        jacobian = np.zeros((2, WIDE))
        jacobian[:, BEFORE] = self._share * dt_s * np.eye(2)
        jacobian[:, AFTER] = (1.0 - self._share) * dt_s * np.eye(2)
        return jacobian


def direction(velocity: Floats) -> tuple[Floats, Floats]:
    """The unit vector (c, s) along a velocity and its derivative (2, 2)."""
    speed = float(np.hypot(velocity[0], velocity[1]))
    if speed < SLOWEST_MPS:
        return velocity / SLOWEST_MPS, np.eye(2) / SLOWEST_MPS
    along: Floats = velocity / speed
    return along, (np.eye(2) - np.outer(along, along)) / speed


def wheel_measurement(
    before: Floats, after: Floats, dt_s: float, share: float, geometry: WheelGeometry
) -> tuple[Floats, Floats]:
    """Rotations (left, right), radians, of (4) and (5) and their Jacobian (2, 4).

    ``share`` is the weight of the velocity before in the way of the middle: 1 as printed, one half for a velocity that
    changes evenly over the step. A wheel's way is the middle's and half the track's turn.
    """
    heading_before, turn_before = direction(before)
    heading_after, turn_after = direction(after)
    middle = dt_s * (share * before + (1.0 - share) * after)
    aside = 0.5 * geometry.track_m * _TO_THE_RIGHT @ (heading_after - heading_before)
    expected, jacobian = np.zeros(2), np.zeros((2, 4))
    for wheel, side in ((0, -1.0), (1, 1.0)):
        way = middle + side * aside
        length = max(float(np.hypot(way[0], way[1])), 1e-9)
        radius = geometry.radii_m[wheel]
        swing = 0.5 * side * geometry.track_m * _TO_THE_RIGHT
        expected[wheel] = length / radius
        pull = way / (length * radius)
        jacobian[wheel, :2] = pull @ (dt_s * share * np.eye(2) - swing @ turn_before)
        jacobian[wheel, 2:] = pull @ (dt_s * (1.0 - share) * np.eye(2) + swing @ turn_after)
    return expected, jacobian


def speed_measurement(velocity: Floats) -> tuple[float, Floats]:
    """|v| and its derivative (2,)."""
    along, _ = direction(velocity)
    return float(np.hypot(velocity[0], velocity[1])), along


def heading_axes(heading_rad: float) -> Floats:
    """Rows (2, 2) that turn a velocity into its components along a heading and to the left of it."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return np.array([[c, s], [-s, c]])


def _speed(velocity: Floats) -> float:
    return math.hypot(velocity[0], velocity[1])
