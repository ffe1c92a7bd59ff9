"""How a vehicle moves along a path: speeds, stops, springs; its true state at any instant.

Knows no sensor: what a receiver reads of the state stands in ``receiver``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from fusion.simulate.motion.path import STEP_M, DrivenPath, draw_path, slow_noise
from fusion.simulate.motion.routes import CRUISE_MPS, MOTORWAYS, Route
from fusion.simulate.scene.town import Town
from fusion.types import Floats, Ints

_GRID_S = 0.05
"""Knots of the splines over time."""
_SIDEWAYS_MPS2 = 2.2
"""Acceleration towards the inside of a bend that the driver accepts: it sets the speed there."""
_SPEED_UP_MPS2 = 1.4
_SLOW_DOWN_MPS2 = 1.9
_CRAWL_MPS = 0.6
"""Speed before a halt and after it; the blur over time makes a standstill of it."""
_SMOOTH_S = 0.6
"""Width of the Gaussian that rounds the distance over time, so that acceleration does not jump."""
_STOP_S = (3.0, 18.0)
"""Shortest and longest halt."""
_FIRST_STAND_S = 4.0
"""How long a drive stands before it begins."""
_BEFORE_JUNCTION_M = 8.0
"""Where a vehicle halts, metres before the node."""
_SQUAT_RAD_PER_MPS2 = np.radians(0.2)
"""Pitch of the body under acceleration; ``_LEAN`` is its roll in a bend."""
_LEAN_RAD_PER_MPS2 = np.radians(0.4)
_PITCH_SPRINGS_RAD = 0.009
"""One sigma of the body's pitch on its springs while it moves, as of its roll below, correlated over ``_SPRINGS_S``."""
_ROLL_SPRINGS_RAD = 0.006
_SPRINGS_S = 0.45


class Driver(NamedTuple):
    """How a vehicle is driven: the highest speed wanted, the share of junctions of ordinary streets at which it halts.

    ``lane_m`` is the way right of the centre line of two-way roads, ``wander_m`` one sigma of not keeping to it.
    """

    top_speed_mps: float = np.inf
    stop_chance: float = 0.18
    lane_m: float = 1.5
    wander_m: float = 0.2


class MotionState(NamedTuple):
    """The true state at n instants; x east, y north, metres on the town's plane; ``z_m`` is the road's
    height.

    ``yaw_rad`` is clockwise from north, ``pitch_rad`` and ``roll_rad`` are the body's (springs included),
    rates are their time derivatives. ``grade`` is the road's under the vehicle, rise over run in the
    direction of travel. ``distance_m`` is measured along the segment from its from_node, ``arc`` counts
    segments along the route.
    """

    time_s: Floats
    x_m: Floats
    y_m: Floats
    z_m: Floats
    velocity_mps: Floats
    acceleration_mps2: Floats
    yaw_rad: Floats
    pitch_rad: Floats
    roll_rad: Floats
    yaw_rate_radps: Floats
    pitch_rate_radps: Floats
    roll_rate_radps: Floats
    grade: Floats
    segment: Ints
    forward: NDArray[np.bool_]
    distance_m: Floats
    arc: Ints

    @property
    def speed_mps(self) -> Floats:
        """Speed over the road's surface."""
        return np.asarray(np.linalg.norm(self.velocity_mps, axis=1))


@dataclass(frozen=True)
class Motion:
    """A vehicle's movement from 0 to ``duration_s``, continuous and twice differentiable."""

    town: Town
    route: Route
    path: DrivenPath
    travelled: CubicSpline
    attitude: CubicSpline
    """(yaw, pitch, roll) over time"""
    duration_s: float

    def at(self, time_s: Floats) -> MotionState:
        """The state at times within the movement, seconds from its beginning."""
        t = np.asarray(time_s, float)
        s = np.clip(self.travelled(t), 0.0, self.path.length_m)
        v, a = self.travelled(t, 1)[:, None], self.travelled(t, 2)[:, None]
        point, d1, d2 = (self.path.curve(s, k) for k in range(3))
        body, rate = self.attitude(t), self.attitude(t, 1)
        knot = np.clip(np.round(np.interp(s, self.path.s_m, np.arange(len(self.path.s_m)))), 0, None)
        arc = self.path.arc[knot.astype(np.int64)]
        segment = self.route.segment[arc]
        return MotionState(
            time_s=t,
            x_m=point[:, 0],
            y_m=point[:, 1],
            z_m=point[:, 2],
            velocity_mps=d1 * v,
            acceleration_mps2=d2 * v**2 + d1 * a,
            yaw_rad=body[:, 0],
            pitch_rad=body[:, 1],
            roll_rad=body[:, 2],
            yaw_rate_radps=rate[:, 0],
            pitch_rate_radps=rate[:, 1],
            roll_rate_radps=rate[:, 2],
            grade=d1[:, 2] / np.hypot(d1[:, 0], d1[:, 1]),
            segment=segment,
            forward=self.route.forward[arc],
            distance_m=_distance_along(self.town, segment, point),
            arc=arc,
        )


def _distance_along(town: Town, segment: Ints, point: Floats) -> Floats:
    """Metres from from_node to the projection on the segment, within its ends."""
    ax, ay = town.node_x_m[town.start[segment]], town.node_y_m[town.start[segment]]
    bx, by = town.node_x_m[town.end[segment]], town.node_y_m[town.end[segment]]
    length = town.length_m[segment]
    along = ((point[:, 0] - ax) * (bx - ax) + (point[:, 1] - ay) * (by - ay)) / length
    return np.asarray(np.clip(along, 0.0, length))


def move(
    town: Town,
    route: Route,
    duration_s: float,
    rng: np.random.Generator,
    *,
    springs: float = 1.0,
    driver: Driver = Driver(),  # noqa: B008  a tuple of numbers, never changed
) -> Motion:
    """Drive a route for ``duration_s``, or to its end if that comes first.

    ``springs`` scales the body's motion against the road (1: pitch leaves the grade by about 1 %, correlated
    over about a second, besides 0.2 degree of squat per m/s2; 0: the body follows the road).
    """
    path = draw_path(town, route, driver.lane_m, driver.wander_m, rng)
    knots_s, knots_m = _timetable(town, route, path, driver, rng)
    duration_s = min(duration_s, float(knots_s[-1]))
    grid = np.arange(-2.0, duration_s + 2.0, _GRID_S)
    travelled_m = gaussian_filter1d(np.interp(grid, knots_s, knots_m), _SMOOTH_S / _GRID_S, mode="nearest")
    travelled = CubicSpline(grid, travelled_m)
    attitude = CubicSpline(grid, _attitude(path, travelled, grid, springs, rng))
    return Motion(town, route, path, travelled, attitude, duration_s)


def _timetable(
    town: Town, route: Route, path: DrivenPath, driver: Driver, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Time and distance travelled at the path's knots, standing included."""
    speed = np.minimum(_speed_limits(town, route, path, rng), driver.top_speed_mps)
    stops = _stops(town, route, path, driver.stop_chance, rng)
    speed[stops] = _CRAWL_MPS
    speed[[0, -1]] = _CRAWL_MPS
    square, s = speed**2, path.s_m
    square = np.minimum.accumulate(square - 2 * _SPEED_UP_MPS2 * s) + 2 * _SPEED_UP_MPS2 * s
    back = np.minimum.accumulate((square + 2 * _SLOW_DOWN_MPS2 * s)[::-1])[::-1]
    speed = np.sqrt(np.maximum(back - 2 * _SLOW_DOWN_MPS2 * s, _CRAWL_MPS**2))
    step = 2 * np.diff(s) / (speed[1:] + speed[:-1])
    standing = np.zeros(len(s))
    standing[stops] = rng.uniform(*_STOP_S, len(stops))
    standing[0] = _FIRST_STAND_S
    arrive = np.r_[0.0, np.cumsum(step + standing[:-1])]
    time = np.column_stack([arrive, arrive + standing]).ravel()
    return time, np.repeat(s, 2)


def _speed_limits(town: Town, route: Route, path: DrivenPath, rng: np.random.Generator) -> Floats:
    """The speed a driver would have at each knot but for inertia: by road class, mood and curvature."""
    by_class = np.array([CRUISE_MPS[h] for h in town.roads.highway[route.segment]])[path.arc]
    mood = slow_noise(len(path.s_m), 60.0 / STEP_M, rng)
    free = by_class * rng.uniform(0.92, 1.08) * np.clip(1 + 0.06 * mood, 0.8, 1.2)
    curve = np.sqrt(_SIDEWAYS_MPS2 / np.maximum(path.curvature(), 1e-4))
    return np.minimum(free, np.maximum(curve, 1.5))


def _stops(town: Town, route: Route, path: DrivenPath, chance: float, rng: np.random.Generator) -> Ints:
    """Knots at which the driver halts: at some junctions of ordinary streets, some metres before the node."""
    last = np.flatnonzero(np.diff(path.arc) > 0)
    arc = path.arc[last]
    node = np.where(route.forward, town.end[route.segment], town.start[route.segment])[arc]
    here, then = (town.roads.highway[route.segment[k]].astype(str) for k in (arc, path.arc[last + 1]))
    junction = (town.junction_degree[node] > 2) & ~(np.isin(here, MOTORWAYS) | np.isin(then, MOTORWAYS))
    halt = junction & (rng.random(len(last)) < chance)
    return np.maximum(last[halt] - round(_BEFORE_JUNCTION_M / STEP_M), 1)


def _attitude(
    path: DrivenPath, travelled: CubicSpline, grid_s: Floats, springs: float, rng: np.random.Generator
) -> Floats:
    """Yaw (continuous), pitch and roll of the body over the grid, shape (n, 3)."""
    s = np.clip(travelled(grid_s), 0.0, path.length_m)
    d1, d2 = path.curve(s, 1), path.curve(s, 2)
    v, a = travelled(grid_s, 1), travelled(grid_s, 2)
    run = np.hypot(d1[:, 0], d1[:, 1])
    leftward = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / run**3 * v**2
    moving = np.minimum(1.0, np.abs(v) / 4.0)
    pitch = np.arctan2(d1[:, 2], run)
    pitch += springs * (_SQUAT_RAD_PER_MPS2 * a + moving * _PITCH_SPRINGS_RAD * _swing(len(s), rng))
    roll = springs * (_LEAN_RAD_PER_MPS2 * leftward + moving * _ROLL_SPRINGS_RAD * _swing(len(s), rng))
    yaw = np.unwrap(np.arctan2(d1[:, 0], d1[:, 1]))
    return np.column_stack([yaw, gaussian_filter1d(pitch, 2.0), gaussian_filter1d(roll, 2.0)])


def _swing(count: int, rng: np.random.Generator) -> Floats:
    """Noise of unit variance through two equal low-passes: differentiable, correlated over about a second."""
    a = float(np.exp(-_GRID_S / _SPRINGS_S))
    noise = np.empty(count + 200)
    one_before = two_before = 0.0
    for k, new in enumerate(rng.normal(size=len(noise)).tolist()):
        two_before, one_before = one_before, new + (2 * a * one_before - a * a * two_before)
        noise[k] = one_before
    return np.asarray(noise[200:] * np.sqrt((1 - a * a) ** 3 / (1 + a * a)))
