"""What surrounds the grid: the motorway with its ramps and end roundabouts, lanes, dead ends, a loop."""

from __future__ import annotations

import numpy as np

from fusion.simulate.scene.grid import ROWS_M, Grid
from fusion.simulate.scene.plan import BRIDGE, GROUND, Kind, Plan, bezier, ring
from fusion.types import Floats

_HALF_MEDIAN_M = 13.0
_RAMP_M = 115.0
_BRIDGE_CLEARANCE_M = 7.0
_WEST_HALF_M = (-740.0, -660.0, -580.0, -500.0, -415.0, -330.0, -245.0, -160.0, -75.0)
_EAST_HALF_M = (25.0, 110.0, 190.0, 260.0, 330.0, 405.0, 480.0, 555.0, 630.0, 690.0, 740.0)
_MOTORWAY_X_M = _WEST_HALF_M + _EAST_HALF_M
_UNDER_PRIMARY = 9
"""The node of either carriageway next to the primary's bridge."""
_VALLEY_BRIDGE = (14, 17)
"""First and last node of the motorway's bridge over the valley (405 to 630 m east)."""


def _motorway_y(x_m: Floats, phase: float) -> Floats:
    """The middle of the motorway, metres north; 640 m where the primary crosses it."""
    fade = np.exp(-((np.asarray(x_m, float) / 700.0) ** 4))
    return np.asarray(640.0 + 24.0 * (np.sin(np.asarray(x_m) / 230.0 + phase) - np.sin(phase)) * fade)


def draw_outskirts(grid: Grid) -> None:
    """Add everything outside the grid to its plan."""
    plan = grid.plan
    phase = float(plan.rng.uniform(0, 2 * np.pi))
    x = np.array(_MOTORWAY_X_M)
    east = [plan.node(u, v - _HALF_MEDIAN_M) for u, v in zip(x, _motorway_y(x, phase), strict=True)]
    west = [plan.node(u, v + _HALF_MEDIAN_M) for u, v in zip(x, _motorway_y(x, phase), strict=True)]
    for nodes in (east, west[::-1]):
        ordered = _VALLEY_BRIDGE if nodes is east else tuple(len(x) - 1 - k for k in _VALLEY_BRIDGE[::-1])
        kinds = [
            Kind("motorway", BRIDGE if ordered[0] <= k < ordered[1] else GROUND, 1) for k in range(len(x) - 1)
        ]
        plan.street("A 77", nodes, kinds)
    _draw_ends(grid, east, west)
    south, north = _draw_crossing(grid, east, west)
    _draw_ramps(plan, east, west, south, north)
    _draw_north(plan, grid, north)
    _draw_lanes(grid)
    _draw_dead_ends(grid)


def _link(plan: Plan, start: int, lead: Floats, trail: Floats, end: int, shares: Floats) -> None:
    curve = bezier(plan.xy(start), lead, trail, plan.xy(end), shares)
    inner = [plan.node(px, py) for px, py in curve]
    plan.street(None, [start, *inner, end], Kind("motorway_link", GROUND, 1))


def _draw_ends(grid: Grid, east: list[int], west: list[int]) -> None:
    """Either end of the motorway is a roundabout, where the ring roads meet it."""
    plan = grid.plan
    for sign, column, name in ((-1, 0, "Westring"), (1, 6, "Ostring")):
        circle = ring(plan, sign * 890.0, 640.0)
        plan.street(f"{name} Circle", [*circle, circle[0]], Kind("tertiary", GROUND, 1, "roundabout"))
        node, board = grid.crossings[column, len(ROWS_M) - 1]
        ring_end = (sign * 890.0, 610.0)
        inner, kinds = grid.stretch(board, ring_end, Kind("tertiary"))
        plan.street(name, [node, *inner, circle[6]], kinds)
        level = np.array([40.0, 0.0])
        first = 0 if sign < 0 else -1
        links = (
            ((circle[7], east[first]), (west[first], circle[1]))
            if sign < 0
            else ((east[first], circle[5]), (circle[3], west[first]))
        )
        for a, b in links:
            toward = np.sign(plan.x_m[b] - plan.x_m[a]) * level
            _link(plan, a, plan.xy(a) + toward, plan.xy(b) - toward, b, np.array([0.5]))


def _draw_crossing(grid: Grid, east: list[int], west: list[int]) -> tuple[int, int]:
    """The primary crosses the motorway on a bridge; returns its junctions with the ramps, south and north."""
    plan = grid.plan
    node, board = grid.crossings[3, len(ROWS_M) - 1]
    under = [line[_UNDER_PRIMARY] for line in (east, west)]
    stops = [640.0 - _RAMP_M, 640.0 - 75.0, 602.0, 640.0, 678.0, 640.0 + 75.0, 640.0 + _RAMP_M]
    inner, kinds = grid.stretch(board, (0.0, stops[0]), Kind("primary"))
    line = [plan.node(0.0, y) for y in stops]
    kinds = [*kinds, *(Kind("primary", BRIDGE if k in (2, 3) else GROUND) for k in range(len(stops) - 1))]
    plan.street("High Street", [node, *inner, *line], kinds)
    plan.embanked.update(line[1:6])
    plan.clearances.append((line[3], under, _BRIDGE_CLEARANCE_M))
    return line[0], line[-1]


def _draw_ramps(plan: Plan, east: list[int], west: list[int], south: int, north: int) -> None:
    """The diamond's four ramps, each one-way, between the carriageways and the primary."""
    shares = np.array([0.2, 0.38, 0.56, 0.76])
    west_column, east_column = _MOTORWAY_X_M.index(-330.0), _MOTORWAY_X_M.index(330.0)
    inward = np.array([110.0, 0.0])
    for a, b in ((east[west_column], south), (west[east_column], north)):
        line, k = (east, west_column + 1) if b == south else (west, east_column - 1)
        lead = 1.8 * (plan.xy(line[k]) - plan.xy(a))
        _link(plan, a, plan.xy(a) + lead, plan.xy(b) - inward * np.sign(lead[0]), b, shares)
    for a, b in ((south, east[east_column]), (north, west[west_column])):
        line, k = (east, east_column - 1) if a == south else (west, west_column + 1)
        lead = 1.8 * (plan.xy(line[k]) - plan.xy(b))
        _link(plan, a, plan.xy(a) - inward * np.sign(lead[0]), plan.xy(b) + lead, b, 1 - shares[::-1])


def _draw_north(plan: Plan, grid: Grid, north: int) -> None:
    """A quarter beyond the motorway: a through street with a dead end in the west, a loop in the east."""
    top = plan.node(0.0, 890.0)
    inner, kinds = grid.stretch((0.0, 640.0 + _RAMP_M), (0.0, 890.0), Kind("unclassified"))
    plan.street("North Hill", [north, *inner, top], kinds)
    bend = float(plan.rng.uniform(15.0, 35.0))
    arms = []
    for end in (-480.0, 330.0):
        shares = np.append(plan.pieces(abs(end)), 1.0)
        arms.append([plan.node(u * end, 890.0 + bend * np.sin(2.2 * u)) for u in shares])
    plan.street("Vineyard Way", [*arms[0][::-1], top, *arms[1]], Kind("residential"))
    gate = arms[1][-1]
    turn = np.linspace(0, 2 * np.pi, 9)[1:-1] + np.pi
    centre = plan.xy(gate) + np.array([62.0, 0.0])
    loop = [plan.node(centre[0] + 62.0 * np.cos(a), centre[1] + 48.0 * np.sin(a)) for a in turn]
    plan.street("Vineyard Loop", [gate, *loop, gate], Kind("living_street"))


def _draw_lanes(grid: Grid) -> None:
    """Lanes through blocks, between the middles of two parallel streets."""
    plan = grid.plan
    blocks = [(i, j) for i in (0, 1, 3, 4, 5) for j in (0, 1, 4)]
    drawn = 0
    for k in plan.rng.permutation(len(blocks)):
        i, j = blocks[k]
        low, high = grid.inner.get((i, j, i + 1, j)), grid.inner.get((i, j + 1, i + 1, j + 1))
        if drawn < 5 and low and high:
            a, b = low[len(low) // 2], high[len(high) // 2]
            pa, pb = plan.xy(a), plan.xy(b)
            shares = plan.pieces(float(np.hypot(*(pb - pa))))
            inner = [plan.node(*(pa + u * (pb - pa))) for u in shares]
            highway, name = (("living_street", f"Lane {drawn + 1}"), ("service", None))[drawn % 2]
            plan.street(name, [a, *inner, b], Kind(highway))
            drawn += 1


def _draw_dead_ends(grid: Grid) -> None:
    """Stubs that leave the grid outwards."""
    plan = grid.plan
    for place, step, highway in (
        ((0, 1), (-1, 0), "service"),
        ((6, 2), (1, 0), "track"),
        ((4, 0), (0, -1), "residential"),
    ):
        node, _ = grid.crossings[place]
        length = float(plan.rng.uniform(90.0, 140.0))
        start, way = plan.xy(node), np.array(step, float)
        shares = np.append(plan.pieces(length), 1.0)
        ends = [plan.node(*(start + u * length * way + 8.0 * np.sin(3 * u) * way[::-1])) for u in shares]
        plan.street(None, [node, *ends], Kind(highway))
