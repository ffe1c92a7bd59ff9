"""The heights of a road network from all drives together: one sparse least-squares solution.

Unknowns are heights and grades at the knots of every segment (``fusion.network.curve``), a height at every node, and
what each drive carries along (``fusion.network.unknowns``). The idea is geodesy's network adjustment; here stands the
order of its rounds. Sensors are not known here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fusion.network.blocks import BlockedSystem, Partition, homes
from fusion.network.control import ControlBeliefs, ControlHeights
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.drive_constants import ConstantsInformation, outside_blocks
from fusion.network.equations import EquationSystem
from fusion.network.pass_columns import PassColumns, in_order
from fusion.network.pass_factor import PassFactor
from fusion.network.road_beliefs import RoadBeliefs
from fusion.network.segment_slopes import Adjustment, published
from fusion.network.terrain import Terrain, TerrainBlocks
from fusion.roads.table import RoadTable

ROUNDS = 4
"""Of solving and weighing anew."""


def adjust(
    network: RoadTable,
    drives: Mapping[int, Sequence[PassFactor]],
    terrain: Terrain | None = None,
    control: ControlHeights | None = None,
    *,
    outside: Mapping[int, ConstantsInformation] | None = None,
    blocks: Partition | None = None,
) -> Adjustment:
    """Solve a network; ``PassFactor.segment`` and ``ControlHeights.row`` are its rows, the keys of ``drives`` any
    numbers that differ.

    ``outside`` is what the passes of drives outside the network say about their constants. ``blocks`` are solved
    one by one, with the same result: for networks of any size.
    """
    passes = PassColumns.of(drives)
    road = RoadBeliefs(network, passes)
    beliefs = DriveBeliefs(passes, road.unknowns, in_order(drives)[1])
    driven = np.zeros(len(network), bool)
    driven[passes.segment] = True
    model = None if terrain is None else TerrainBlocks(road.unknowns, terrain, driven)
    surveyed = None if control is None else ControlBeliefs(road.unknowns, control, road.usual)
    constants = outside_blocks(outside or {}, beliefs.unknowns)
    equations = [
        *road.blocks(),
        *beliefs.blocks(),
        *constants,
        *(b for one in (model, surveyed) if one for b in one.blocks()),
    ]
    if blocks is None:
        system: EquationSystem | BlockedSystem = EquationSystem(beliefs.size, equations, beliefs.late)
    else:
        home = homes(blocks.block, road.unknowns, beliefs)
        system = BlockedSystem(beliefs.size, equations, home, blocks.executor)
    for number in range(ROUNDS):
        solution = system.solve()
        if number < ROUNDS - 1:
            road.learn(solution)
            beliefs.learn(solution, number == 0)
            if model:
                model.learn(solution, number == 0)
            if surveyed:
                surveyed.learn(solution)
    return published(road.unknowns, beliefs, model, solution, surveyed)
