"""The ordinary roads around an interchange: around the motorways, across them, and close beside one of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from published.particle.scene.alignment import eased, rounded
from published.particle.scene.board import ROAD, STREET, Board, Point
from published.particle.scene.interchange import LANE_X_M, NORTH_RING_Y_M, UNDERPASS_Y_M, Layout

_EAST_X_M = 1255.0
_SPLIT_WEST: Point = (-560.0, 800.0)
_SPLIT_EAST: Point = (_EAST_X_M, 480.0)
_COAST_GATE: Point = (-900.0, 620.0)
_EASTERN_END: Point = (_EAST_X_M, 50.0)
_LANE_TOP: Point = (LANE_X_M, 690.0)
_LANE_FOOT: Point = (LANE_X_M, -1110.0)
_QUARTER: Point = (LANE_X_M, 300.0)
_FORT: Point = (LANE_X_M, -250.0)
_BANK_M = 260.0
_CLOSE_M = 48.0
"""How far a street runs beside the middle of the A 216."""


def draw_roads(board: Board, layout: Layout, rings: Mapping[str, list[int]]) -> None:
    """Draw everything but the motorways; every road leads on to another, nothing is a dead end."""
    _draw_coast(board, rings)
    _draw_east(board, layout, rings)
    _draw_south(board, layout, rings)
    _draw_underpass(board, layout)
    _draw_lane(board, layout)
    _draw_beside(board, layout)
    _draw_edges(board, layout, rings["west"])


def _draw_coast(board: Board, rings: Mapping[str, list[int]]) -> None:
    """From the northern roundabout to the western junction, over a ditch."""
    first, last = rings["north"][4], rings["port"][2]
    corners = [board.xy(first), (150.0, 1075.0), (-420.0, 900.0), (-1000.0, 560.0), board.xy(last)]
    board.lay(
        "coast",
        rounded(corners, [200.0, 250.0, 120.0]),
        ROAD,
        name="Route de la Côte",
        ends=(first, last),
        joins=[_SPLIT_WEST, _COAST_GATE],
        bridges=[(-260.0, 947.0)],
    )


def _draw_east(board: Board, layout: Layout, rings: Mapping[str, list[int]]) -> None:
    """From the northern roundabout around to the A 16's eastern end."""
    first, last = rings["north"][0], rings["east"][2]
    x, _ = layout.on216(NORTH_RING_Y_M)
    corners = [
        board.xy(first),
        (x + 250.0, 1080.0),
        (_EAST_X_M, 900.0),
        (_EAST_X_M, -300.0),
        board.xy(last),
    ]
    board.lay(
        "around",
        rounded(corners, [200.0, 150.0, 250.0]),
        ROAD,
        name="Rue des Salines",
        ends=(first, last),
        joins=[_SPLIT_EAST, _EASTERN_END],
        bridges=[(_EAST_X_M, 270.0)],
    )


def _draw_south(board: Board, layout: Layout, rings: Mapping[str, list[int]]) -> None:
    """From the western junction along a canal to the A 16's eastern end."""
    first, last = rings["canal"][6], rings["east"][6]
    corners = [
        board.xy(first),
        (layout.x_west_m + 60.0, -900.0),
        (-300.0, -1120.0),
        (1000.0, -1130.0),
        (1400.0, -950.0),
        board.xy(last),
    ]
    board.lay(
        "south",
        rounded(corners, [120.0, 200.0, 200.0, 80.0]),
        ROAD,
        name="Chemin du Canal",
        ends=(first, last),
        joins=[_LANE_FOOT],
        bridges=[(350.0, -1125.0)],
    )


def _draw_underpass(board: Board, layout: Layout) -> None:
    """From the coast road to the eastern one, under the A 216."""
    first = board.drawn["coast"].node_near(_SPLIT_WEST)
    last = board.drawn["around"].node_near(_SPLIT_EAST)
    below = layout.on216(UNDERPASS_Y_M)
    corners = [
        board.xy(first),
        _LANE_TOP,
        (below[0] - 150.0, below[1]),
        (below[0] + 150.0, below[1]),
        board.xy(last),
    ]
    joins = [_LANE_TOP, _fort_gate(layout), below, _pines_gate(layout)]
    line = rounded(corners, [200.0, 400.0, 400.0])
    board.lay("under", line, ROAD, name="Rue de Calais", ends=(first, last), joins=joins)
    for key in ("N", "S"):
        board.over(key, ("under",), below)


def _fort_gate(layout: Layout) -> Point:
    """Where the street beside the A 216 begins."""
    x, y = layout.on216(UNDERPASS_Y_M)
    return x - 60.0, y


def _pines_gate(layout: Layout) -> Point:
    """Where the eastern street begins."""
    x, y = layout.on216(UNDERPASS_Y_M)
    return x + 330.0, y - 60.0


def _draw_lane(board: Board, layout: Layout) -> None:
    """A lane from north to south, over the A 16 on a bridge."""
    first = board.drawn["under"].node_near(_LANE_TOP)
    last = board.drawn["south"].node_near(_LANE_FOOT)
    crossing = layout.on16(LANE_X_M)
    lane = board.lay(
        "lane",
        eased(np.array([board.xy(first), _QUARTER, crossing, board.xy(last)]), 20.0),
        STREET,
        name="Chemin des Dunes",
        ends=(first, last),
        joins=[_QUARTER, _FORT],
        bridges=[crossing],
    )
    board.plan.embanked.update(n for n in lane.nodes if abs(board.xy(n)[1] - crossing[1]) < _BANK_M)
    board.over("lane", ("E", "W"), crossing)


def _draw_beside(board: Board, layout: Layout) -> None:
    """A street close beside the A 216, which a matcher may mistake for it, and one across to the lane."""
    first = board.drawn["under"].node_near(_fort_gate(layout))
    last = board.drawn["lane"].node_near(_FORT)
    y = np.arange(UNDERPASS_Y_M - 60.0, layout.y16_m + 640.0, -1.0)
    along = np.column_stack([layout.axis216(y) - _CLOSE_M, y])
    corner = (along[-1, 0] - 140.0, -260.0)
    line = eased(np.vstack([board.xy(first), along, corner, board.xy(last)]), 25.0)
    half = (float(along[0, 0]), 300.0)
    fort = board.lay("beside", line, STREET, name="Rue du Fort", ends=(first, last), joins=[half])
    first, last = fort.node_near(half), board.drawn["lane"].node_near(_QUARTER)
    line = rounded([board.xy(first), (150.0, 260.0), board.xy(last)], [150.0])
    board.lay("quarter", line, STREET, name="Rue du Moulin", ends=(first, last))


def _draw_edges(board: Board, layout: Layout, west: list[int]) -> None:
    """From the A 16's western end to the coast road, and a street in the east."""
    first, last = west[2], board.drawn["coast"].node_near(_COAST_GATE)
    line = rounded([board.xy(first), (-1400.0, 350.0), board.xy(last)], [150.0])
    board.lay("western", line, ROAD, name="Rue de l'Ouest", ends=(first, last))
    first = board.drawn["under"].node_near(_pines_gate(layout))
    last = board.drawn["around"].node_near(_EASTERN_END)
    line = rounded([board.xy(first), (board.xy(first)[0], 60.0), board.xy(last)], [60.0])
    board.lay("eastern", line, STREET, name="Rue des Pins", ends=(first, last))
