"""The heights of a road network from all drives together: one sparse least-squares solution.

Unknowns are heights and grades at the knots of every segment (``fusion.network.curve``), a height at every node, and
what each drive carries along (``fusion.network.unknowns``). The idea is geodesy's network adjustment; here stands the
order of its rounds. Sensors are not known here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fusion.network.blockwise.owners import grouped
from fusion.network.blockwise.partition import Partition, PassSource, homes
from fusion.network.blockwise.system import BlockedSystem, store_of, summaries
from fusion.network.control import ControlBeliefs, ControlHeights
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.drive_constants import ConstantsInformation, outside_blocks
from fusion.network.equations import Blocks, EquationSystem, Solution
from fusion.network.pass_columns import PassColumns, in_order
from fusion.network.pass_factor import PassFactor
from fusion.network.road_beliefs import RoadBeliefs
from fusion.network.segment_slopes import Adjustment, published
from fusion.network.terrain import Terrain, TerrainBlocks
from fusion.roads.table import RoadTable

ROUNDS = 4
"""Of solving and weighing anew."""


def tasks_of(blocks: Partition) -> int:
    """About how many tasks a solution in so many blocks is."""
    tree = blocks.tree()
    bundle = tree.bundles(blocks.hands)
    leaves = [node for node, children in enumerate(tree.children) if not children]
    of_leaves, of_all = len(np.unique(bundle[leaves])), len(np.unique(bundle))
    # Leaves are summed, prepared and asked for covariances: thrice in the first round. Each round goes up the tree and
    # down.
    return len(leaves) + (ROUNDS + 3) * of_leaves + 2 * ROUNDS * of_all


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
    beliefs = _Beliefs(network, PassColumns.of(drives), terrain, control, in_order(drives)[1])
    equations = [*beliefs.blocks(), *outside_blocks(outside or {}, beliefs.drives.unknowns)]
    size, late = beliefs.drives.size, beliefs.drives.late
    if blocks is None:
        return beliefs.adjustment(EquationSystem(size, equations, late))
    home = homes(blocks.block, beliefs.road.unknowns, beliefs.drives)
    return beliefs.adjustment(BlockedSystem(size, equations, home, blocks, late))


def adjust_from(
    source: PassSource,
    network: RoadTable,
    blocks: Partition,
    terrain: Terrain | None = None,
    control: ControlHeights | None = None,
) -> Adjustment:
    """As ``adjust``, in blocks, with passes that whoever works on a block reads there: never are all in one place."""
    store = store_of(blocks)
    passes = PassColumns.together(summaries(source, blocks, store))
    beliefs = _Beliefs(network, passes, terrain, control)
    home = homes(blocks.block, beliefs.road.unknowns, beliefs.drives)
    of_block = blocks.block[passes.segment]
    place = np.empty(len(passes), np.int64)
    for _, mine in grouped(of_block):
        place[mine] = np.arange(len(mine))
    equations = beliefs.blocks()
    size, late = beliefs.drives.size, beliefs.drives.late
    system = BlockedSystem(size, equations, home, blocks, late, store, place)
    system.release()
    return beliefs.adjustment(system)


class _Beliefs:
    """All that is believed and measured; without ``factors`` what passes say is read elsewhere."""

    def __init__(
        self,
        network: RoadTable,
        passes: PassColumns,
        terrain: Terrain | None,
        control: ControlHeights | None,
        factors: Sequence[PassFactor] | None = None,
    ) -> None:
        self.road = RoadBeliefs(network, passes)
        self.drives = DriveBeliefs(passes, self.road.unknowns, factors)
        driven = np.zeros(len(network), bool)
        driven[passes.segment] = True
        self.model = None if terrain is None else TerrainBlocks(self.road.unknowns, terrain, driven)
        self.surveyed = None
        if control is not None:
            self.surveyed = ControlBeliefs(self.road.unknowns, control, self.road.usual)

    def blocks(self) -> list[Blocks]:
        """All equations."""
        others = [b for one in (self.model, self.surveyed) if one for b in one.blocks()]
        return [*self.road.blocks(), *self.drives.blocks(), *others]

    def adjustment(self, system: EquationSystem | BlockedSystem) -> Adjustment:
        """Solve and weigh anew, in rounds."""
        for number in range(ROUNDS):
            last = number == ROUNDS - 1
            # What others than equations ask of covariances is asked at the end, and of these.
            solution = system.solve(covariances=last or bool(self.model or self.surveyed))
            if not last:
                self._learn(solution, number == 0)
        return published(self.road.unknowns, self.drives, self.model, solution, self.surveyed)

    def _learn(self, solution: Solution, first: bool) -> None:
        self.road.learn(solution)
        self.drives.learn(solution, first)
        if self.model:
            self.model.learn(solution, first)
        if self.surveyed:
            self.surveyed.learn(solution)
