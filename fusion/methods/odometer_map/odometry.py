"""Readings of wheels and of a speed signal as measurements of the step that they end.

At speed these are (4) and (5) of Lahrech et al. 2005, or |v|. Near standstill neither has a Jacobian, and the velocity
forgets where the nose points; there the way is laid along the heading that is remembered. Wheels that stand still
say more than a small number: the velocity is zero at both ends of the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fusion.methods.odometer_map.heading import RememberedHeading
from fusion.methods.odometer_map.measurements import WheelGeometry, known_heading_rows, speed_row, wheel_rows
from fusion.methods.odometer_map.options import OdometerMapOptions
from fusion.methods.odometer_map.state import AFTER, BEFORE, NEW_ROUNDING, ROUNDING, SCALE, WIDE
from fusion.types import Floats

_STILL_M = 0.02  # a wheel of a vehicle that stands may rock so far between two readings
_STILL_MPS = 0.05
_ASIDE_MPS = 0.05
_FLOOR_RAD = 0.005
_SHARPEST_RAD = 1.5  # within one step; beyond it the way is no chord any more
_BEND_SHARE = 0.05  # of what the wheels turn apart: tyres slip in bends


@dataclass(frozen=True)
class Rows:
    """A measurement against the wide state: residual (m,), Jacobian (m, 17), covariance (m, m)."""

    residual: Floats
    design: Floats
    noise: Floats


class Odometry:
    """Rows of readings, by the options' geometry and accuracies."""

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
    ) -> Rows:
        """Rows of two rotations over a step; ``heading`` is the remembered one at its beginning."""
        way, turn = self._geometry.way_and_turn(left_rad, right_rad)
        rocked = max(self._tick_rad, _STILL_M / max(self._geometry.radii_m))
        if max(abs(left_rad), abs(right_rad)) <= rocked * (1 + 1e-9):
            return self._standing(mean, dt_s)
        if abs(turn) > _SHARPEST_RAD:
            return self._anywhere(mean, self._way_rows(dt_s), abs(way))
        slowest = min(way / dt_s, _speed(mean[BEFORE]), _speed(mean[AFTER]))
        if slowest >= self._options.min_speed_mps:
            return self._rolling(mean, dt_s, np.array([left_rad, right_rad]))
        after = self.turned(heading, left_rad, right_rad)
        if not after.known:
            return self._anywhere(mean, self._way_rows(dt_s), abs(way))
        return self._creeping(mean, dt_s, way, after.angle_rad - 0.5 * turn, after)

    def speed(self, mean: Floats, speed_mps: float, heading: RememberedHeading) -> Rows:
        """Row of a speed signal at the end of a step; ``heading`` is the remembered one there."""
        o = self._options
        sigma = math.hypot(o.speed_sigma_mps, o.wheel_error_share * speed_mps)
        pick = np.zeros((2, WIDE))
        pick[0, AFTER[0]] = pick[1, AFTER[1]] = 1.0
        scale = 1.0 + float(mean[SCALE].mean())
        if min(speed_mps, _speed(mean[AFTER])) >= o.min_speed_mps:
            expected, along = speed_row(mean[AFTER])
            design = scale * along[None] @ pick
            design[0, SCALE] = 0.5 * expected
            return Rows(np.array([speed_mps - scale * expected]), design, np.array([[sigma**2]]))
        if not heading.known:
            return self._anywhere(mean, pick, math.hypot(speed_mps, sigma))
        design = known_heading_rows(heading.angle_rad) @ pick
        design[0] *= scale
        aside = math.hypot(_ASIDE_MPS, speed_mps * math.sqrt(heading.variance))
        return Rows(np.array([speed_mps, 0.0]) - design @ mean, design, np.diag([sigma**2, aside**2]))

    def _rolling(self, mean: Floats, dt_s: float, measured_rad: Floats) -> Rows:
        """(4) and (5)."""
        expected, velocities = wheel_rows(mean[BEFORE], mean[AFTER], dt_s, self._share, self._geometry)
        scale = 1.0 + mean[SCALE]
        design = np.zeros((2, WIDE))
        design[:, BEFORE] = scale[:, None] * velocities[:, :2]
        design[:, AFTER] = scale[:, None] * velocities[:, 2:]
        design[:, SCALE] = np.diag(expected)
        design[:, NEW_ROUNDING], design[:, ROUNDING] = np.eye(2), -np.eye(2)
        rounding = mean[NEW_ROUNDING] - mean[ROUNDING]
        bend = _BEND_SHARE * (expected[1] - expected[0])
        each = (self._options.wheel_each_error_share * expected) ** 2 + bend**2 + _FLOOR_RAD**2
        common = self._options.wheel_error_share * expected
        noise = np.outer(common, common) + np.diag(each)
        return Rows(measured_rad - scale * expected - rounding, design, noise)

    def _standing(self, mean: Floats, dt_s: float) -> Rows:
        design = np.zeros((4, WIDE))
        design[:2] = self._way_rows(dt_s)
        design[2, AFTER[0]] = design[3, AFTER[1]] = 1.0
        way, speed = _STILL_M**2, _STILL_MPS**2
        return Rows(-design @ mean, design, np.diag([way, way, speed, speed]))

    def _creeping(
        self, mean: Floats, dt_s: float, way_m: float, middle_rad: float, after: RememberedHeading
    ) -> Rows:
        """Along and across the way, and across and along the velocity at its end.

        A vehicle that creeps does not turn back: its speed ends between nothing and twice the mean.
        """
        o, sigma = self._options, math.sqrt(after.variance)
        design = np.zeros((4, WIDE))
        design[:2] = known_heading_rows(middle_rad) @ self._way_rows(dt_s)
        design[0] *= 1.0 + float(mean[SCALE].mean())
        design[2:, AFTER] = known_heading_rows(after.angle_rad)[::-1]
        mean_mps = way_m / dt_s
        along = math.hypot(o.wheel_error_share, o.wheel_each_error_share) * way_m
        variances = [
            along**2 + self._ticks_m**2 + _STILL_M**2,
            (sigma * way_m) ** 2 + _STILL_M**2,
            (sigma * mean_mps) ** 2 + _ASIDE_MPS**2,
            mean_mps**2 + _STILL_MPS**2,
        ]
        return Rows(np.array([way_m, 0.0, 0.0, mean_mps]) - design @ mean, design, np.diag(variances))

    def _anywhere(self, mean: Floats, rows: Floats, size: float) -> Rows:
        """A vector of known size and unknown direction: zero, give or take the size."""
        return Rows(-rows @ mean, rows, max(size, _STILL_M) ** 2 * np.eye(2))

    def _way_rows(self, dt_s: float) -> Floats:
        """Rows (2, 17) of the way over the step."""
        rows = np.zeros((2, WIDE))
        rows[:, BEFORE] = self._share * dt_s * np.eye(2)
        rows[:, AFTER] = (1.0 - self._share) * dt_s * np.eye(2)
        return rows


def _speed(velocity: Floats) -> float:
    return math.hypot(velocity[0], velocity[1])
