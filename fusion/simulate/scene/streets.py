"""The town's streets: a bent grid around a roundabout with a tunnel road and a bridge road, and what surrounds it.

Around the grid lie the motorway with its ramps and end roundabouts, lanes, dead ends, a loop.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fusion.simulate.scene.plan import BRIDGE, GROUND, TUNNEL, Kind, Plan, Street, bezier, ring, warp
from fusion.types import Floats

COLUMNS_M = tuple(-750.0 + 250.0 * i for i in range(7))
ROWS_M = tuple(-850.0 + 230.0 * j for j in range(6))
"""Where columns and rows lie on the drawing board, metres east and north of the town's centre."""
MIDDLE = (3, 3)
"""Column and row of the roundabout."""
_ROW_NAMES = ("Südring", "Ash Lane", "Fir & Larch Walk", "Tunnel Road", "Quarry Street", "Upper Terrace")
_COLUMN_NAMES = (
    "Westring",
    "Hill Street",
    "Mühlgasse",
    "High Street",
    "Baker Street",
    "Valley Road",
    "Ostring",
)

Board = tuple[float, float]
Anchor = tuple[int, Board]
"""A node and where it lies on the drawing board before bending."""


@dataclass
class Grid:
    """The plan while its grid is drawn: crossings by (column, row), inner nodes by an edge's crossings."""

    plan: Plan
    phase: Floats
    crossings: dict[tuple[int, int], Anchor] = field(default_factory=dict)
    inner: dict[tuple[int, int, int, int], list[int]] = field(default_factory=dict)
    circle: list[int] = field(default_factory=list)
    dropped: set[tuple[int, int, int, int]] = field(default_factory=set)

    def bent_node(self, board: Board) -> int:
        """Add a node at a place of the drawing board."""
        x, y = warp(np.array(board[0]), np.array(board[1]), self.phase)
        return self.plan.node(float(x), float(y))

    def stretch(self, a: Board, b: Board, kind: Kind) -> tuple[list[int], list[Kind]]:
        """Add the inner nodes between two places, and the kinds of the segments around them."""
        length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        if kind.structure == GROUND:
            shares, kinds = self.plan.pieces(length), None
        else:
            shares, kinds = _structure_shares(kind)
        nodes = [self.bent_node((a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1]))) for u in shares]
        return nodes, kinds or [kind] * (len(nodes) + 1)


def _structure_shares(kind: Kind) -> tuple[Floats, list[Kind]]:
    """A 500 m stretch: 110 m of approach in two segments at either end, the structure in four."""
    shares = np.array([0.11, 0.22, 0.36, 0.5, 0.64, 0.78, 0.89])
    ground = kind._replace(structure=GROUND)
    return shares, [ground] * 2 + [kind] * 4 + [ground] * 2


def draw_grid(plan: Plan) -> Grid:
    """Add the grid's crossings, its roundabout, rows and columns to the plan."""
    grid = Grid(plan, plan.rng.uniform(0, 2 * np.pi, 4))
    _add_crossings(grid)
    grid.dropped = _choose_dropped(plan.rng)
    for j in range(len(ROWS_M)):
        _draw_line(grid, _ROW_NAMES[j], [(i, j) for i in range(len(COLUMNS_M))])
    for i in range(len(COLUMNS_M)):
        _draw_line(grid, _COLUMN_NAMES[i], [(i, j) for j in range(len(ROWS_M))])
    return grid


def _add_crossings(grid: Grid) -> None:
    for i, x in enumerate(COLUMNS_M):
        for j, y in enumerate(ROWS_M):
            if (i, j) == MIDDLE:
                cx, cy = warp(np.array(x), np.array(y), grid.phase)
                grid.circle = ring(grid.plan, float(cx), float(cy))
            elif (i, j) not in ((1, 3), (5, 3)):  # the tunnel and the bridge pass these without a junction
                grid.crossings[i, j] = grid.bent_node((x, y)), (x, y)
    grid.plan.street(
        "Market Circle", [*grid.circle, grid.circle[0]], Kind("primary", GROUND, 1, "roundabout")
    )


def _choose_dropped(rng: np.random.Generator) -> set[tuple[int, int, int, int]]:
    """Seven residential edges that become footways; no two share a crossing: the grid stays in one piece."""
    edges = [(i, j, i + 1, j) for i in range(6) for j in (1, 2, 4)]
    edges += [(i, j, i, j + 1) for i in (1, 5) for j in (0, 1, 4)]
    dropped: set[tuple[int, int, int, int]] = set()
    used: set[tuple[int, int]] = set()
    for k in rng.permutation(len(edges)):
        edge = edges[k]
        ends = {edge[:2], edge[2:]}
        if len(dropped) < 7 and not ends & used and _kind_of(edge).oneway == 0:
            dropped.add(edge)
            used |= ends
    return dropped


def _kind_of(edge: tuple[int, int, int, int]) -> Kind:
    """What the grid's edge between two crossings is."""
    i, j, k, m = edge
    if j == m:
        if j == 3:
            return Kind("secondary", {0: TUNNEL, 4: BRIDGE}.get(i, GROUND) if k - i == 2 else GROUND)
        if j == 0:
            return Kind("tertiary")
        return Kind("residential", GROUND, int(j == 2 and i in (3, 4)))
    if i == 3:
        return Kind("primary")
    if i in (0, 6):
        return Kind("tertiary")
    one_way = {2: 1, 4: -1}.get(i, 0) if 1 <= j < 4 else 0
    return Kind("residential", GROUND, one_way)


def _anchor(grid: Grid, here: tuple[int, int], other: tuple[int, int]) -> Anchor:
    """The node at which the street from ``other`` reaches ``here``; at the roundabout, the arm there."""
    if here != MIDDLE:
        return grid.crossings[here]
    side = {(1, 0): 0, (0, 1): 2, (-1, 0): 4, (0, -1): 6}
    step = (int(np.sign(other[0] - here[0])), int(np.sign(other[1] - here[1])))
    board = (COLUMNS_M[here[0]] + 30.0 * step[0], ROWS_M[here[1]] + 30.0 * step[1])
    return grid.circle[side[step]], board


def _draw_line(grid: Grid, name: str, places: list[tuple[int, int]]) -> None:
    """Draw one row or column; it is interrupted by the roundabout and by dropped edges."""
    places = [p for p in places if p == MIDDLE or p in grid.crossings]
    run: Street | None = None
    for here, there in pairwise(places):
        edge = (*here, *there)
        a, b = _anchor(grid, here, there), _anchor(grid, there, here)
        if edge in grid.dropped:
            grid.plan.footways.append((a[0], b[0]))
            run = None
            continue
        inner, kinds = grid.stretch(a[1], b[1], _kind_of(edge))
        grid.inner[edge] = inner
        if run is None or run.nodes[-1] != a[0]:
            run = Street(name, [a[0]])
            grid.plan.streets.append(run)
        run.nodes += [*inner, b[0]]
        run.kinds += kinds


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
