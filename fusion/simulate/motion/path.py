"""The line on which a vehicle drives a route: right of the centre line, through corners in smooth curves.

Streets run straight from node to node, or bend smoothly through their nodes (``Town.curved``). Knows no time: how fast
the line is driven stands in ``vehicle``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from fusion.simulate.motion.routes import Route
from fusion.simulate.scene.town import Town
from fusion.types import Floats, Ints

STEP_M = 1.0
"""Distance between two points of a line, metres, about."""
_CORNER_M = 4.5
"""Width of the Gaussian that rounds corners, profiles included; a right angle gets a radius of about 7 m."""
_TURNING_CIRCLE_M = 5.5
_TURN_FROM_M = 9.0
"""Where the lane is left for the turning circle, metres before the end."""
_WANDER_LENGTH_M = 40.0
"""Width of the Gaussian that blurs how far the driver strays from the lane."""
_SHARPEST_RAD = np.radians(50.0)
"""What turns by more between two segments is a corner, not a bend; a roundabout's nodes turn by 45 degrees."""
_MOTORWAY_LANE_M = 1.75
"""The right lane's distance from the middle of a carriageway of two lanes, which is what a map draws."""
_CHANGE_LANE_M = 25.0
"""Width of the Gaussian over which the vehicle passes from one lane's offset to the next."""


@dataclass(frozen=True)
class DrivenPath:
    """A curve over its horizontal length ``s_m``: ``curve(s)`` gives (x, y, road height), shape (..., 3)."""

    s_m: Floats
    curve: CubicSpline
    arc: Ints
    """Position in the route of the segment on which each knot lies."""

    @property
    def length_m(self) -> float:
        """Horizontal length."""
        return float(self.s_m[-1])

    def curvature(self) -> Floats:
        """Absolute curvature at the knots, 1/m."""
        d1, d2 = self.curve(self.s_m, 1), self.curve(self.s_m, 2)
        cross = d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]
        return np.asarray(np.abs(cross) / np.hypot(d1[:, 0], d1[:, 1]) ** 3)


def draw_path(
    town: Town, route: Route, lane_m: float, wander_m: float, rng: np.random.Generator
) -> DrivenPath:
    """Draw the driven line, ``lane_m`` right of the centre of two-way roads, ``wander_m`` its one sigma."""
    points, arc = (_curved_points if town.curved else _straight_points)(town, route, lane_m)
    s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))]
    keep = np.r_[True, np.diff(s) > 1e-6]
    s, points, arc = s[keep], points[keep], arc[keep]
    even = np.arange(0.0, s[-1], STEP_M)
    smooth = np.column_stack([np.interp(even, s, points[:, k]) for k in range(3)])
    smooth = gaussian_filter1d(smooth, _CORNER_M / STEP_M, axis=0, mode="nearest")
    smooth[:, :2] += _wander(smooth[:, :2], wander_m, rng)
    s2 = np.r_[0.0, np.cumsum(np.hypot(*np.diff(smooth[:, :2], axis=0).T))]
    nearest = np.minimum(np.searchsorted(s, even), len(s) - 1)
    return DrivenPath(s2, CubicSpline(s2, smooth), arc[nearest])


def _wander(xy: Floats, wander_m: float, rng: np.random.Generator) -> Floats:
    """Sideways displacement of a driver who does not keep the lane exactly, shape (n, 2)."""
    aside = wander_m * slow_noise(len(xy), _WANDER_LENGTH_M / STEP_M, rng)
    return _to_the_right(np.gradient(xy, axis=0), aside)


def _to_the_right(along: Floats, aside_m: Floats) -> Floats:
    """Displacement (n, 2) by so much to the right of directions (n, 2)."""
    along = along / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return np.asarray(_right_of(along) * aside_m[:, None])


def _right_of(along: Floats) -> Floats:
    return np.column_stack([along[:, 1], -along[:, 0]])


def slow_noise(count: int, width: float, rng: np.random.Generator) -> Floats:
    """Gaussian noise of unit variance, blurred by a Gaussian of ``width`` samples."""
    noise = gaussian_filter1d(rng.normal(size=count), width, mode="reflect")
    return np.asarray(noise * np.sqrt(2 * width * np.sqrt(np.pi)))


def _straight_points(town: Town, route: Route, lane_m: float) -> tuple[Floats, Ints]:
    """Points of straight segments about every metre, shape (n, 3), corners still sharp, and each one's arc."""
    seg = route.segment
    a = np.where(route.forward, town.start[seg], town.end[seg])
    b = np.where(route.forward, town.end[seg], town.start[seg])
    from_xy = np.column_stack([town.node_x_m[a], town.node_y_m[a]])
    to_xy = np.column_stack([town.node_x_m[b], town.node_y_m[b]])
    along = (to_xy - from_xy) / town.length_m[seg][:, None]
    right = _right_of(along)
    lane = np.where(town.roads.oneway[seg] == 0, lane_m, 0.0)
    begin, finish, back = _corners(from_xy, to_xy, right, lane)
    count = np.maximum(2, np.ceil(town.length_m[seg] / STEP_M).astype(np.int64))
    parts = []
    for k in range(len(seg)):
        u = (np.arange(count[k]) / count[k])[:, None]
        lines = [begin[k] + u * (finish[k] - begin[k])]
        if back[k]:
            lines.append(_turn(to_xy[k], along[k], right[k]))
        parts.append(np.vstack(lines))
    owner = np.repeat(np.arange(len(seg)), [len(p) for p in parts])
    xy = np.vstack(parts)
    share = np.sum((xy - from_xy[owner]) * along[owner], axis=1) / town.length_m[seg[owner]]
    share = np.clip(share, 0.0, 1.0)
    z = town.road_height(seg[owner], np.where(route.forward[owner], share, 1 - share))
    return np.column_stack([xy, z]), owner


def _corners(
    from_xy: Floats, to_xy: Floats, right: Floats, lane: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Where each segment's lane begins and ends (mitred at corners), and after which the vehicle turns."""
    begin, finish = from_xy + right * lane[:, None], to_xy + right * lane[:, None]
    openness = 1 + np.sum(right[:-1] * right[1:], axis=1)
    mean_lane = (lane[:-1] + lane[1:]) / 2
    miter = (right[:-1] + right[1:]) / np.maximum(openness, 0.3)[:, None] * mean_lane[:, None]
    back = (openness < 1e-6)[:, None]
    ahead = np.column_stack([-right[:, 1], right[:, 0]])
    finish[:-1] = np.where(back, finish[:-1] - _TURN_FROM_M * ahead[:-1], to_xy[:-1] + miter)
    begin[1:] = np.where(back, begin[1:] + _TURN_FROM_M * ahead[1:], to_xy[:-1] + miter)
    return begin, finish, np.r_[back[:, 0], False]


def _turn(centre: Floats, along: Floats, right: Floats) -> Floats:
    """Two thirds of a turning circle around a dead end, from its right side to its left, shape (n, 2)."""
    angle = np.arange(-np.pi * 2 / 3, np.pi * 2 / 3, STEP_M / _TURNING_CIRCLE_M)[:, None]
    return np.asarray(centre + _TURNING_CIRCLE_M * (np.cos(angle) * along - np.sin(angle) * right))


def _curved_points(town: Town, route: Route, lane_m: float) -> tuple[Floats, Ints]:
    """Points of bends about every metre, shape (n, 3), corners still sharp, and each one's arc.

    A spline runs through the nodes between two corners. The vehicle keeps ``lane_m`` to the right of it on two-way
    roads, in the right lane on motorways, on it elsewhere, and changes gradually from one to the other. Routes that
    turn round are not for this (the scenes that are curved have no dead ends).
    """
    seg = route.segment
    node = np.where(route.forward, town.start[seg], town.end[seg])
    last = town.end[seg[-1]] if route.forward[-1] else town.start[seg[-1]]
    node = np.append(node, last)
    xy = np.column_stack([town.node_x_m[node], town.node_y_m[node]])
    parts, owners = [], []
    for first, stop in _bends(xy):
        points, owner = _through(xy[first : stop + 1])
        parts.append(points)
        owners.append(owner + first)
    line, owner = np.vstack(parts), np.concatenate(owners)
    share = _shares(line, xy[owner], xy[owner + 1])
    z = town.road_height(seg[owner], np.where(route.forward[owner], share, 1 - share))
    return np.column_stack([line + _aside(town, seg[owner], line, lane_m), z]), owner


def _bends(xy: Floats) -> list[tuple[int, int]]:
    """First and last node of each stretch without a corner."""
    along = np.diff(xy, axis=0)
    heading = np.arctan2(along[:, 1], along[:, 0])
    turn = np.abs(np.remainder(np.diff(heading) + np.pi, 2 * np.pi) - np.pi)
    corners = np.flatnonzero(turn > _SHARPEST_RAD) + 1
    return list(zip([0, *corners], [*corners, len(xy) - 1], strict=True))


def _through(xy: Floats) -> tuple[Floats, Ints]:
    """Points of a spline through nodes, the last node left out, and the segment each belongs to."""
    chord = np.hypot(*np.diff(xy, axis=0).T)
    knot = np.concatenate([[0.0], np.cumsum(chord)])
    count = np.maximum(2, np.ceil(chord / STEP_M).astype(np.int64))
    owner = np.repeat(np.arange(len(chord)), count)
    within = np.concatenate([np.arange(c) / c for c in count])
    at = knot[owner] + within * chord[owner]
    if len(xy) < 3:
        return np.column_stack([np.interp(at, knot, xy[:, k]) for k in range(2)]), owner
    return np.asarray(CubicSpline(knot, xy, bc_type="natural")(at)), owner


def _shares(line: Floats, a: Floats, b: Floats) -> Floats:
    """How far along its chord each point lies, 0..1."""
    along = b - a
    share = np.sum((line - a) * along, axis=1) / np.sum(along**2, axis=1)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _aside(town: Town, segment: Ints, line: Floats, lane_m: float) -> Floats:
    """Displacement from the road's line to the lane driven, shape (n, 2)."""
    motorway = town.roads.highway[segment] == "motorway"
    lane = np.where(town.roads.oneway[segment] == 0, lane_m, np.where(motorway, _MOTORWAY_LANE_M, 0.0))
    lane = gaussian_filter1d(lane, _CHANGE_LANE_M / STEP_M, mode="nearest")
    along = np.column_stack([gaussian_filter1d(np.gradient(line[:, k]), 3.0 / STEP_M) for k in range(2)])
    return _to_the_right(along, lane)
