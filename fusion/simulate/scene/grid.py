"""The town's middle: a bent grid of streets around a roundabout, with a tunnel road and a bridge road."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fusion.simulate.scene.plan import BRIDGE, GROUND, TUNNEL, Kind, Plan, Street, ring, warp
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


def _choose_dropped(rng: np.random.Generator, count: int = 7) -> set[tuple[int, int, int, int]]:
    """Residential edges that become footways; no two share a crossing: the grid stays in one piece."""
    edges = [(i, j, i + 1, j) for i in range(6) for j in (1, 2, 4)]
    edges += [(i, j, i, j + 1) for i in (1, 5) for j in (0, 1, 4)]
    dropped: set[tuple[int, int, int, int]] = set()
    used: set[tuple[int, int]] = set()
    for k in rng.permutation(len(edges)):
        edge = edges[k]
        ends = {edge[:2], edge[2:]}
        if len(dropped) < count and not ends & used and _kind_of(edge).oneway == 0:
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
