"""What wheels, a speed signal and a road measure, with their Jacobians: Lahrech et al. 2005, (3)-(7).

Velocities (2,) are those at the two ends of a step, east and north, m/s. Rows of Jacobians run over (vx, vy) before,
(vx, vy) after. Neither heading nor |v| has a derivative at standstill; below ``SLOWEST_MPS`` they are taken as if the
vehicle moved that fast, and the caller uses ``known_heading_rows`` there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fusion.methods.nine_state.measurements import SLOWEST_MPS, heading_row
from fusion.methods.nine_state.motion import STATES, X, Y
from fusion.methods.nine_state.protocol import Road
from fusion.types import Floats

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


def direction(velocity: Floats) -> tuple[Floats, Floats]:
    """The unit vector (c, s) along a velocity and its derivative (2, 2)."""
    speed = float(np.hypot(velocity[0], velocity[1]))
    if speed < SLOWEST_MPS:
        return velocity / SLOWEST_MPS, np.eye(2) / SLOWEST_MPS
    along: Floats = velocity / speed
    return along, (np.eye(2) - np.outer(along, along)) / speed


def wheel_rows(
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
    expected, design = np.zeros(2), np.zeros((2, 4))
    for wheel, side in ((0, -1.0), (1, 1.0)):
        way = middle + side * aside
        length = max(float(np.hypot(way[0], way[1])), 1e-9)
        radius = geometry.radii_m[wheel]
        swing = 0.5 * side * geometry.track_m * _TO_THE_RIGHT
        expected[wheel] = length / radius
        pull = way / (length * radius)
        design[wheel, :2] = pull @ (dt_s * share * np.eye(2) - swing @ turn_before)
        design[wheel, 2:] = pull @ (dt_s * (1.0 - share) * np.eye(2) + swing @ turn_after)
    return expected, design


def speed_row(velocity: Floats) -> tuple[float, Floats]:
    """|v| and its derivative (2,)."""
    along, _ = direction(velocity)
    return float(np.hypot(velocity[0], velocity[1])), along


def known_heading_rows(heading_rad: float) -> Floats:
    """Rows (2, 2) that turn a velocity into its components along a heading and to the left of it."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return np.array([[c, s], [-s, c]])


def map_rows(state: Floats, road: Road) -> tuple[Floats, Floats]:
    """Residual (3,) of a matched road point, (6) and (7), and the Jacobian (3, 9) of what it is compared with.

    The rows are turned into the road: position along it, position across it (to its left), direction.
    """
    heading, row = heading_row(state)
    design = np.zeros((3, STATES))
    design[:2, [X, Y]] = known_heading_rows(road[2])
    design[2] = row
    away = np.array([road[0] - state[X], road[1] - state[Y]])
    turn = math.remainder(road[2] - heading, 2 * math.pi)
    return np.append(design[:2, [X, Y]] @ away, turn), design
