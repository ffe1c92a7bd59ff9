"""A scene and a drive of the shape of Al Assaad's experiment (thesis of 2020, sections 2.4.1 and 3.5).

The scene is a town of ``fusion.simulate``, so that drives through it and files of it are made as for any other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from fusion.frames import LocalProjection
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import Arcs, Route
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.scene.plan import Plan
from fusion.simulate.scene.town import Terrain, Town, tabulated
from fusion.types import Ints
from published.particle.scene.board import Board
from published.particle.scene.interchange import Layout, draw_motorways
from published.particle.scene.interchange_roads import draw_roads

CENTRE_LON_DEG, CENTRE_LAT_DEG = 1.88, 50.94
"""Outside Calais, so that the UTM zone and the DEM's posting are those of the thesis; the roads are fictional."""
DURATION_S = 549.0
_FLATTENED = 0.2
"""Share of the town's hills that this coast has: grades of the ground of 0.6 % (root mean square)."""
_BASE_M = 6.0
_HOME_M = (-60.0, 1010.0)
"""Where the circuit begins and ends, on the board: on the road that leads west from the northern roundabout."""
_LARGEST_TURN_RAD = np.radians(6.0)
_DRIVER = Driver(top_speed_mps=25.0, stop_chance=0.0)
"""In the thesis's traffic: at most 90 km/h, its mean is 60 km/h; yielding at roundabouts is in the bends' speeds."""


@dataclass(frozen=True, kw_only=True)
class Interchange(Town):
    """Two motorways that meet, with ramps, loops and bridges on embankments, in nearly flat country.

    ``circuit`` is the route of the thesis: from an ordinary road up to the A 216, down a bend of 90 degrees to the
    A 16, off it by a ramp that climbs to a roundabout, over the A 16, back along it, up a loop to the A 216, home.
    """

    circuit: Route


def make_interchange(seed: int = 1) -> Interchange:
    """Make the scene of a seed: about 3 x 2.4 km, some 420 segments in some 75 ways."""
    rough = Terrain.random(np.random.default_rng([seed, 40]))
    terrain = replace(
        rough,
        base_m=_BASE_M,
        tilt=rough.tilt * _FLATTENED / 2,
        amplitude_m=rough.amplitude_m * _FLATTENED,
        hill_m=0.0,
        valley_m=0.0,
    )
    board = Board(Plan(np.random.default_rng([seed, 41])))
    layout = Layout.random(board.plan.rng)
    draw_roads(board, layout, draw_motorways(board, layout))
    stops = _stops(board)
    _turn(board.plan, float(board.plan.rng.uniform(-_LARGEST_TURN_RAD, _LARGEST_TURN_RAD)))
    projection = LocalProjection(CENTRE_LON_DEG, CENTRE_LAT_DEG)
    columns = tabulated(seed, board.plan, terrain, projection)
    return Interchange(**columns, curved=True, circuit=_shortest(Town(**columns), stops))


def calais_drive(scene: Interchange, seed: int, *, receiver: str = "m8") -> SimulatedDrive:
    """Drive the circuit of a scene: 549 s at 1 Hz at about 60 km/h on average, the antenna 1.55 m above the road."""
    return simulate_drive(
        scene, seed, DURATION_S, receiver=receiver, route=scene.circuit, driver=_DRIVER, antenna_m=1.55
    )


def _turn(plan: Plan, angle_rad: float) -> None:
    """Turn the whole board: roads that run exactly north and south would be a special case."""
    x, y = np.array(plan.x_m), np.array(plan.y_m)
    plan.x_m = (np.cos(angle_rad) * x - np.sin(angle_rad) * y).tolist()
    plan.y_m = (np.sin(angle_rad) * x + np.cos(angle_rad) * y).tolist()


def _stops(board: Board) -> list[int]:
    """Nodes that the circuit passes, in order."""
    drawn = board.drawn
    home = drawn["coast"].node_near(_HOME_M)
    through = ("S", "turn down", "exit W", "overpass", "entry E", "loop up", "N")
    return [home, *(drawn[key].middle for key in through), home, drawn["coast"].nodes[-1]]


def _shortest(town: Town, stops: list[int]) -> Route:
    """The quickest legal route through nodes, in order."""
    arcs = Arcs.of(town)
    graph = arcs.graph(arcs.seconds)
    starts = np.flatnonzero(arcs.tail == stops[0])
    legs = [_leg(arcs, graph, starts, stops[1])]
    for stop in stops[2:]:
        legs.append(_leg(arcs, graph, np.array(legs[-1][-1:]), stop)[1:])
    path = np.concatenate(legs)
    return Route(arcs.segment[path], arcs.forward[path])


def _leg(arcs: Arcs, graph: csr_array, starts: Ints, node: int) -> list[int]:
    """The arcs from the best of ``starts``, that one included, to the first that ends at a node."""
    far, before, _ = dijkstra(graph, indices=starts, return_predecessors=True, min_only=True)
    goal = np.where(arcs.head == node, far, np.inf)
    arc = int(np.argmin(goal))
    if not np.isfinite(goal[arc]):
        raise AssertionError("the circuit's roads do not hang together")
    path = [arc]
    while path[-1] not in starts:
        path.append(int(before[path[-1]]))
    return path[::-1]
