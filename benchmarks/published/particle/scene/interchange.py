"""The plan of two motorways that meet outside a town: carriageways, ramps, loops, overpasses, roundabouts.

Drawn on a board of about 3 x 2.4 km (x east, y north, metres). The A 16 runs east and west in a wide bend, the A 216
comes from the north and ends on it: a right turn and a loop for either direction. In the west a road on a bridge takes
the A 16's second junction, with a roundabout on either side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fusion.types import Floats
from published.particle.scene.alignment import arc, beside, eased, rounded
from published.particle.scene.board import MOTORWAY, RAMP, ROAD, Board, Point

END_X_M = 1400.0
LANE_X_M = -330.0
"""Where a lane crosses the A 16 on a bridge."""
NORTH_RING_Y_M = 1070.0
UNDERPASS_Y_M = 650.0
"""Where the A 216 crosses an ordinary road."""

_HALF_MEDIAN_M = 9.0
_ASIDE_M = 9.0
"""How far a ramp runs beside its carriageway before they part."""
_LOOP_LANE_M = 55.0
_TURN_LANE_M = 400.0
_BEFORE_TURN_M = 380.0
_WEST_RAMP_M = 310.0
"""Way along the A 16 from the western junction's middle to where its ramps leave and enter."""
_WEST_RING_M = 215.0


@dataclass(frozen=True)
class Layout:
    """What differs from scene to scene; metres on the board.

    ``loop_m`` are the radii of the loops up to the A 216 and down from it, ``turn_m`` those of the right turns down and
    up.
    """

    x216_m: float
    y16_m: float
    bend16_m: float
    sway216_m: float
    x_west_m: float
    loop_m: tuple[float, float]
    turn_m: tuple[float, float]

    @classmethod
    def random(cls, rng: np.random.Generator) -> Layout:
        """Draw a layout: loops of 60 to 80 m, right turns of 85 to 125 m."""
        return cls(
            x216_m=float(rng.uniform(540.0, 620.0)),
            y16_m=float(rng.uniform(-790.0, -730.0)),
            bend16_m=float(rng.uniform(6000.0, 9000.0)),
            sway216_m=float(rng.choice([-1, 1]) * rng.uniform(60.0, 120.0)),
            x_west_m=float(rng.uniform(-1010.0, -950.0)),
            loop_m=(float(rng.uniform(60.0, 80.0)), float(rng.uniform(60.0, 80.0))),
            turn_m=(float(rng.uniform(85.0, 125.0)), float(rng.uniform(85.0, 125.0))),
        )

    def axis16(self, x_m: Floats) -> Floats:
        """The middle of the A 16, metres north."""
        return self.y16_m + (x_m - self.x216_m) ** 2 / (2 * self.bend16_m)

    def axis216(self, y_m: Floats) -> Floats:
        """The middle of the A 216, metres east: straight at the junction, then swaying to one side."""
        share = np.clip((y_m - self.y16_m - 450.0) / 900.0, 0.0, 1.0)
        return np.asarray(self.x216_m + self.sway216_m * (1 - np.cos(np.pi * share)) / 2)

    def on16(self, x_m: float) -> Point:
        """The point of the A 16's middle at metres east."""
        return x_m, float(self.axis16(np.array(x_m)))

    def on216(self, y_m: float) -> Point:
        """The point of the A 216's middle at metres north."""
        return float(self.axis216(np.array(y_m))), y_m

    def west(self, along_m: float, across_m: float) -> Point:
        """A place at the western junction: metres along the A 16 (east) and across it (north) from its middle."""
        x, y = self.on16(self.x_west_m)
        slope = (self.x_west_m - self.x216_m) / self.bend16_m
        u = np.array([1.0, slope]) / np.hypot(1.0, slope)
        return float(x + along_m * u[0] - across_m * u[1]), float(y + along_m * u[1] + across_m * u[0])


def draw_motorways(board: Board, layout: Layout) -> Mapping[str, list[int]]:
    """Draw both motorways with their junctions; returns the nodes of the roundabouts by name."""
    rings = {
        "north": board.roundabout("Rond-point du Nord", layout.on216(NORTH_RING_Y_M)),
        "east": board.roundabout("Rond-point de l'Est", layout.on16(END_X_M)),
        "west": board.roundabout("Rond-point de l'Ouest", layout.on16(-END_X_M)),
        "port": board.roundabout("Rond-point du Port", layout.west(0.0, _WEST_RING_M), banked=True),
        "canal": board.roundabout("Rond-point du Canal", layout.west(0.0, -_WEST_RING_M), banked=True),
    }
    _draw_a16(board, layout, rings)
    _draw_a216(board, layout, rings["north"])
    _draw_loops(board, layout)
    _draw_right_turns(board, layout)
    _draw_overpass(board, layout, rings)
    for side, key, ring in ((1.0, "W", rings["port"]), (-1.0, "E", rings["canal"])):
        _draw_western_ramps(board, layout, side, key, ring)
    return rings


def _draw_a16(board: Board, layout: Layout, rings: Mapping[str, list[int]]) -> None:
    """The carriageways E and W, between the roundabouts at the scene's edges; they stay on the ground."""
    x = np.arange(75.0 - END_X_M, END_X_M - 74.0)
    axis = np.column_stack([x, layout.axis16(x)])
    x0, (up, down) = layout.x216_m, layout.loop_m
    turns = [layout.on16(x0 + u) for u in (-_TURN_LANE_M, 0.0, _TURN_LANE_M)]
    ramps = [layout.west(u, 0.0) for u in (-_WEST_RAMP_M, 0.0, _WEST_RAMP_M)]
    loops = [
        layout.on16(x0 - _HALF_MEDIAN_M - down + _LOOP_LANE_M),
        layout.on16(x0 + _HALF_MEDIAN_M + up - _LOOP_LANE_M),
    ]
    for key, line, first, last in (
        ("E", axis, rings["west"][7], rings["east"][5]),
        ("W", axis[::-1], rings["east"][3], rings["west"][1]),
    ):
        carriageway = np.vstack([board.xy(first), beside(line, _HALF_MEDIAN_M), board.xy(last)])
        joins = [*turns, *ramps, layout.on16(LANE_X_M), *(loops if key == "E" else ())]
        laid = board.lay(
            key, eased(carriageway, 12.0), MOTORWAY, name="A 16", ends=(first, last), joins=joins
        )
        board.plan.level.update(laid.nodes)


def _draw_a216(board: Board, layout: Layout, ring: list[int]) -> None:
    """The carriageways N and S, from the loops over the A 16 and over an ordinary road to the northern roundabout."""
    foot = layout.y16_m - _HALF_MEDIAN_M - _ASIDE_M
    for key, radius, gate in (("N", layout.loop_m[0], ring[7]), ("S", layout.loop_m[1], ring[5])):
        y = np.arange(foot - radius, NORTH_RING_Y_M - 75.0)
        axis = np.column_stack([layout.axis216(y), y])
        northward = key == "N"
        line = beside(axis if northward else axis[::-1], _HALF_MEDIAN_M)
        line = np.vstack([line, board.xy(gate)] if northward else [board.xy(gate), line])
        board.lay(
            key,
            eased(line, 12.0),
            MOTORWAY,
            name="A 216",
            ends=(None, gate) if northward else (gate, None),
            joins=[layout.on216(layout.y16_m + _BEFORE_TURN_M)],
            bridges=[layout.on216(layout.y16_m), layout.on216(UNDERPASS_Y_M)],
            banked=True,
        )
        board.over(key, ("E", "W"), layout.on216(layout.y16_m))


def _draw_loops(board: Board, layout: Layout) -> None:
    """Three quarters of a circle each: from the A 16 eastwards up to N, and from S down to the A 16 eastwards."""
    plan, east = board.plan, board.drawn["E"]
    north, south = board.drawn["N"].nodes, board.drawn["S"].nodes
    (x, y), radius = board.xy(north[0]), layout.loop_m[0]
    gate = east.node_near((x + radius - _LOOP_LANE_M, y + radius))
    bend = arc(np.array([x + radius, y]), radius, np.pi / 2, -3 * np.pi / 2)
    line = eased(np.vstack([board.xy(gate), bend]), 8.0)
    up = board.lay("loop up", line, RAMP, ends=(gate, north[0]), banked=True)
    (x, y), radius = board.xy(south[-1]), layout.loop_m[1]
    gate = east.node_near((x - radius + _LOOP_LANE_M, y + radius))
    bend = arc(np.array([x - radius, y]), radius, 0.0, -3 * np.pi / 2)
    line = eased(np.vstack([bend, board.xy(gate)]), 8.0)
    down = board.lay("loop down", line, RAMP, ends=(south[-1], gate), banked=True)
    plan.merges.append((up.nodes[-2], north[0], north[1]))
    plan.merges.append((south[-2], south[-1], down.nodes[1]))
    board.leave("loop up", "E")
    board.enter("loop down", "E")


def _draw_right_turns(board: Board, layout: Layout) -> None:
    """From S down to the A 16 westwards, and from there up to N."""
    x0, y0, aside = layout.x216_m, layout.y16_m, _HALF_MEDIAN_M + _ASIDE_M
    for key, side, upper_key, radius in (
        ("turn down", -1.0, "S", layout.turn_m[0]),
        ("turn up", 1.0, "N", layout.turn_m[1]),
    ):
        upper = board.drawn[upper_key].node_near((x0, y0 + _BEFORE_TURN_M))
        lower = board.drawn["W"].node_near(layout.on16(x0 + side * _TURN_LANE_M))
        far_x, far_y = layout.on16(x0 + side * (_TURN_LANE_M - 100.0))
        corners = [
            board.xy(upper),
            (x0 + side * aside, y0 + _BEFORE_TURN_M - 80.0),
            (x0 + side * aside, y0 + aside),
            (far_x, far_y + aside),
            board.xy(lower),
        ]
        line, ends = rounded(corners, [300.0, radius, 300.0]), (upper, lower)
        down = side < 0
        board.lay(key, line if down else line[::-1], RAMP, ends=ends if down else ends[::-1], banked=True)
    board.leave("turn down", "S")
    board.enter("turn down", "W")
    board.leave("turn up", "W")
    board.enter("turn up", "N")


def _draw_overpass(board: Board, layout: Layout, rings: Mapping[str, list[int]]) -> None:
    """The road of the western junction, over the A 16 between two roundabouts."""
    first, last, middle = rings["port"][6], rings["canal"][2], layout.west(0.0, 0.0)
    line = eased(np.array([board.xy(first), middle, board.xy(last)]), 6.0)
    board.lay("overpass", line, ROAD, name="Route du Port", ends=(first, last), bridges=[middle], banked=True)
    board.over("overpass", ("E", "W"), middle)


def _draw_western_ramps(board: Board, layout: Layout, side: float, key: str, ring: list[int]) -> None:
    """A carriageway's exit up to a roundabout and its entry down from there; ``side`` is 1 north, -1 south."""
    road = board.drawn[key]
    off, on = (road.node_near(layout.west(side * u, 0.0)) for u in (_WEST_RAMP_M, -_WEST_RAMP_M))
    come, go = (ring[0], ring[4]) if side > 0 else (ring[4], ring[0])
    low, high = (layout.west(side * 230.0, side * 22.0), layout.west(side * 115.0, side * 195.0))
    exit_line = rounded([board.xy(off), low, high, board.xy(come)], [110.0, 60.0])
    low, high = (layout.west(-side * 230.0, side * 22.0), layout.west(-side * 115.0, side * 195.0))
    entry_line = rounded([board.xy(go), high, low, board.xy(on)], [60.0, 110.0])
    board.lay(f"exit {key}", exit_line, RAMP, ends=(off, come), banked=True)
    board.lay(f"entry {key}", entry_line, RAMP, ends=(go, on), banked=True)
    board.leave(f"exit {key}", key)
    board.enter(f"entry {key}", key)
