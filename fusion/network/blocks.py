"""A network's equations in blocks, after Helmert: interiors are eliminated onto their borders, borders solved together.

Each block eliminates the unknowns that occur in its equations alone; what is left speaks of its border, and all
borders make up one smaller system. From its solution and covariances those inside of each block follow, exactly as if
all had been solved at once. The work on a block is a pure function of arguments that can be sent to another process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.filters.sparse_inverse import Elimination, NormalEquations, fill_reducing_order
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.equations import Blocks, EquationSystem, Solution, factorised, pattern_of, right_hand_side
from fusion.network.pass_factor import CONSTANTS
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Partition:
    """The number of the block of each segment (n,), and who does the work on them (``None``: one after another)."""

    block: Ints
    executor: Executor | None = None


def bisected(network: RoadTable, most: int, executor: Executor | None = None) -> Partition:
    """Blocks of at most ``most`` segments: the network is halved across its longer side as often as it takes."""
    north = 0.5 * (network.lat0_deg + network.lat1_deg)
    east = 0.5 * (network.lon0_deg + network.lon1_deg) * np.cos(np.radians(north.sum() / max(len(north), 1)))
    block = np.zeros(len(network), np.int64)
    waiting, count = [np.arange(len(network))], 0
    while waiting:
        rows = waiting.pop()
        if len(rows) <= max(most, 1):
            block[rows] = count
            count += 1
            continue
        along = max((east[rows], north[rows]), key=lambda side: float(np.ptp(side)))
        order = rows[np.argsort(along, kind="stable")]
        waiting += [order[: len(rows) // 2], order[len(rows) // 2 :]]
    return Partition(block, executor)


def homes(block: Ints, road: RoadUnknowns, drives: DriveBeliefs) -> Ints:
    """The block of each unknown: that of its segment; -1 for nodes and what a drive has but once."""
    home = np.full(drives.size, -1, np.int64)
    home[road.nodes : road.size] = np.repeat(block, road.count)
    own = drives.of_pass[:, len(CONSTANTS) :]
    home[own[own >= 0]] = np.broadcast_to(block[drives.passes.segment][:, None], own.shape)[own >= 0]
    return home


@dataclass(frozen=True, eq=False)
class _Block:
    """Equations of one block: for each kind which of them, over which of ``unknowns``, added to which slots.

    The last ``border`` of ``unknowns`` are the border.
    """

    unknowns: Ints
    border: int
    how: Elimination
    rows: list[Ints]
    variables: list[Ints]
    slots: list[Ints]


def eliminate(how: Elimination, equations: list[Blocks], slots: list[Ints]) -> tuple[NormalEquations, Floats]:
    """A block's equations with its interior eliminated, and its right-hand side."""
    normal = factorised(how, equations, slots)
    return normal, normal.reduced(right_hand_side(len(how.order), equations))


def finish(
    normal: NormalEquations, reduced: Floats, solution: Floats, covariance: Floats
) -> tuple[NormalEquations, Floats]:
    """A block's solution from its border's: with covariances, and its unknowns (n,)."""
    normal.set_border_covariance(covariance)
    return normal, normal.solve_inside(reduced, solution)


class BlockedSystem:
    """As ``EquationSystem``, solved block by block; ``home`` (size,) is the block of each unknown, -1 for none."""

    def __init__(self, size: int, blocks: list[Blocks], home: Ints, executor: Executor | None) -> None:
        self.size, self.executor = size, executor
        self.blocks = [b for b in blocks if len(b.variables)]
        owner, border = _owners(size, [b.variables for b in self.blocks], home)
        self.parts = [self._part(owner, border, k) for k in range(int(home.max(initial=-1)) + 1)]
        self.inside = np.full(size, -1, np.int64)
        for k, part in enumerate(self.parts):
            self.inside[part.unknowns[: len(part.unknowns) - part.border]] = k
        # Borders, and equations that belong to no block, in numbers of their own.
        self.border = np.flatnonzero(border)
        self._number = np.full(size, -1, np.int64)
        self._number[self.border] = np.arange(len(self.border))
        self._left = [np.flatnonzero(o < 0) for o in owner]
        self._top = self._top_system() if len(self.border) else None

    def _part(self, owner: list[Ints], border: Bools, k: int) -> _Block:
        rows = [np.flatnonzero(o == k) for o in owner]
        variables = [b.variables[r] for b, r in zip(self.blocks, rows, strict=True)]
        used = np.unique(np.concatenate([np.empty(0, np.int64), *(v.ravel() for v in variables)]))
        unknowns = np.concatenate([used[~border[used]], used[border[used]]])
        count = int(border[used].sum())
        local = np.argsort(unknowns)
        variables = [local[np.searchsorted(used, v)] for v in variables]
        pattern = pattern_of(len(unknowns), variables)
        interior = len(unknowns) - count
        order = fill_reducing_order(pattern[:interior][:, :interior])
        how = Elimination(pattern, np.concatenate([order, np.arange(interior, len(unknowns))]), count)
        return _Block(unknowns, count, how, rows, variables, [how.slots(v) for v in variables])

    def _top_system(self) -> EquationSystem:
        self._messages = []
        for part in self.parts:
            mine = self._number[part.unknowns[len(part.unknowns) - part.border :]][None]
            count = part.border
            self._messages.append(Blocks(mine, np.zeros((1, count, count)), np.zeros((1, count)), np.ones(1)))
        self._loose = [
            Blocks(self._number[b.variables[r]], b.information[r], b.vector[r], b.weight[r])
            for b, r in zip(self.blocks, self._left, strict=True)
        ]
        used = [m for m in self._messages if m.variables.size]
        return EquationSystem(len(self.border), [*used, *self._loose], np.empty(0, np.int64))

    def solve(self) -> Solution:
        """The solution at the present weights. Raises ``ValueError`` where some unknown is not determined."""
        jobs = [(part.how, self._equations(part), part.slots) for part in self.parts]
        eliminated = list(self._map(eliminate, jobs))
        x = np.zeros(self.size)
        top = None
        if self._top:
            for one, part, (normal, reduced) in zip(self._messages, self.parts, eliminated, strict=True):
                one.information[0] = normal.border_matrix()
                one.vector[0] = reduced[len(reduced) - part.border :]
            for loose, b, r in zip(self._loose, self.blocks, self._left, strict=True):
                loose.weight = b.weight[r]
            top = self._top.solve()
            x[self.border] = top.x
        work = [
            (normal, reduced, x[part.unknowns[len(part.unknowns) - part.border :]], self._covariance(top, k))
            for k, (part, (normal, reduced)) in enumerate(zip(self.parts, eliminated, strict=True))
        ]
        finished = list(self._map(finish, work))
        for part, (_, solution) in zip(self.parts, finished, strict=True):
            interior = len(solution) - part.border
            x[part.unknowns[:interior]] = solution[:interior]
        return Solution(x, _BlockedCovariances(self, [normal for normal, _ in finished], top))

    def _map(self, work: Callable[..., Any], jobs: list[tuple[Any, ...]]) -> Iterable[Any]:
        if self.executor is None:
            return (work(*job) for job in jobs)
        return self.executor.map(work, *zip(*jobs, strict=True))

    def _equations(self, part: _Block) -> list[Blocks]:
        return [
            Blocks(v, b.information[r], b.vector[r], b.weight[r])
            for b, r, v in zip(self.blocks, part.rows, part.variables, strict=True)
        ]

    def _covariance(self, top: Solution | None, k: int) -> Floats:
        """Of the border of block ``k``."""
        if top is None or not self.parts[k].border:
            return np.zeros((0, 0))
        return np.asarray(top.equations.covariance(self._messages[k].variables)[0])

    def local(self, k: int, variables: Ints) -> tuple[Ints, Bools]:
        """Where unknowns stand among those of block ``k``, and whether they are there."""
        unknowns = self.parts[k].unknowns
        order = np.argsort(unknowns)
        at = order[np.minimum(np.searchsorted(unknowns, variables, sorter=order), len(order) - 1)]
        return at, unknowns[at] == variables

    def on_border(self, variables: Ints) -> Ints:
        """The numbers of border unknowns in the system of borders."""
        return np.asarray(self._number[variables])


class _BlockedCovariances:
    """Covariances of unknowns that share an equation, from the block that has it."""

    def __init__(self, system: BlockedSystem, normals: list[NormalEquations], top: Solution | None) -> None:
        self._system, self._normals, self._top = system, normals, top

    def covariance(self, rows: Ints) -> Floats:
        """Covariances (m, k, k) among unknowns ``rows`` (m, k); NaN for pairs that no block knows together."""
        rows = np.asarray(rows, np.int64)
        out = np.full((*rows.shape, rows.shape[1]), np.nan)
        block = self._system.inside[rows].max(axis=1, initial=-1)
        for k in np.unique(block).tolist():
            mine = np.flatnonzero(block == k)
            if k < 0:
                if self._top:
                    out[mine] = self._top.equations.covariance(self._system.on_border(rows[mine]))
                continue
            at, there = self._system.local(k, rows[mine])
            covariance = self._normals[k].covariance(at)
            out[mine] = np.where(there[:, :, None] & there[:, None, :], covariance, np.nan)
        return out


def _owners(size: int, variables: list[Ints], home: Ints) -> tuple[list[Ints], Bools]:
    """The block of every equation (-1: of none, but of the borders), and which unknowns are border."""
    low, high = np.full(size, np.iinfo(np.int64).max), np.full(size, -1, np.int64)
    owner = []
    for v in variables:
        mine = home[v]
        one = mine[np.arange(len(v)), np.argmax(mine >= 0, axis=1)]
        owner.append(one)
        for column in v[one >= 0].T:
            np.minimum.at(low, column, one[one >= 0])
            np.maximum.at(high, column, one[one >= 0])
    border = low < high
    border |= high < 0
    # What names no segment goes where all its unknowns are, or to the borders.
    for v, one in zip(variables, owner, strict=True):
        loose = np.flatnonzero(one < 0)
        same = np.all(~border[v[loose]] & (high[v[loose]] == high[v[loose][:, :1]]), axis=1)
        one[loose[same]] = high[v[loose[same], 0]]
        border[v[loose[~same]].ravel()] = True
    return owner, border
