"""The driven line where roads bend between the map's nodes: through the nodes in smooth curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from fusion.simulate.routes import Route
from fusion.types import Floats, Ints

if TYPE_CHECKING:
    from fusion.simulate.town import Town

_STEP_M = 1.0
_SHARPEST_RAD = np.radians(50.0)
"""What turns by more between two segments is a corner, not a bend; a roundabout's nodes turn by 45 degrees."""
_MOTORWAY_LANE_M = 1.75
"""The right lane's distance from the middle of a carriageway of two lanes, which is what a map draws."""
_CHANGE_LANE_M = 25.0


def curved_points(town: Town, route: Route, lane_m: float) -> tuple[Floats, Ints]:
    """Points about every metre, shape (n, 3), with corners still sharp, and the route position of each.

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
    count = np.maximum(2, np.ceil(chord / _STEP_M).astype(np.int64))
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
    lane = gaussian_filter1d(lane, _CHANGE_LANE_M / _STEP_M, mode="nearest")
    along = np.column_stack([gaussian_filter1d(np.gradient(line[:, k]), 3.0 / _STEP_M) for k in range(2)])
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return np.asarray(lane[:, None] * np.column_stack([along[:, 1], -along[:, 0]]))
