"""Which block has which equation, and at which node of the tree each unknown is eliminated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fusion.network.blockwise.partition import BlockTree
from fusion.network.equations import Blocks
from fusion.types import Ints


class Owners:
    """An equation belongs to the block of the first of its unknowns that has one; else to the first block that has
    any of its unknowns. An unknown is eliminated at the lowest node below which all of its equations are.

    ``home`` (size,) is the block of each unknown, -1 for none. ``of_equations``: the block of each equation, kind by
    kind. ``node`` (size,): where each unknown is eliminated. Raises ``ValueError`` where an unknown has no equation.
    """

    def __init__(self, size: int, variables: Sequence[Ints], home: Ints, tree: BlockTree) -> None:
        self.size, self.tree = size, tree
        self._order = np.array(tree.order, np.int64)
        self._home = np.where(home < 0, -1, tree.rank[home])
        low, high = np.full(size, len(self._order)), np.full(size, -1, np.int64)
        ranks = [self._by_home(v) for v in variables]
        for v, rank in zip(variables, ranks, strict=True):
            _widen(low, high, v[rank >= 0], rank[rank >= 0])
        self._first = np.where(high < 0, -1, low)
        for v, rank in zip(variables, ranks, strict=True):
            loose = np.flatnonzero(rank < 0)
            rank[loose] = self._by_first(v[loose])
            _widen(low, high, v[loose], rank[loose])
        if np.any(high < 0):
            raise ValueError("some unknown has no equation")
        self.of_equations = [self._order[rank] for rank in ranks]
        self.node = self._order[low]
        shared = np.flatnonzero(low < high)
        self.node[shared] = tree.lowest_above(self.node[shared], self._order[high[shared]])

    def of(self, variables: Ints) -> Ints:
        """The block that would have equations over unknowns (m, k)."""
        rank = self._by_home(variables)
        loose = np.flatnonzero(rank < 0)
        rank[loose] = self._by_first(variables[loose])
        return np.asarray(self._order[rank])

    def borders(self, kinds: Sequence[Blocks]) -> dict[int, Ints]:
        """The unknowns of each block that are eliminated above it, ascending; blocks without any left out."""
        inner = np.array([len(below) > 0 for below in self.tree.children])
        shared = inner[self.node]
        pairs = [np.empty(0, np.int64)]
        for one, owner in zip(kinds, self.of_equations, strict=True):
            row, column = np.nonzero(shared[one.variables])
            pairs.append(np.unique(owner[row] * self.size + one.variables[row, column]))
        block, unknown = np.divmod(np.unique(np.concatenate(pairs)), self.size)
        return {number: unknown[rows] for number, rows in grouped(block)}

    def _by_home(self, variables: Ints) -> Ints:
        mine = self._home[variables]
        return np.asarray(mine[np.arange(len(mine)), np.argmax(mine >= 0, axis=1)])

    def _by_first(self, variables: Ints) -> Ints:
        return np.asarray(np.maximum(self._first[variables].max(axis=1, initial=-1), 0))


def grouped(values: Ints) -> Iterator[tuple[int, Ints]]:
    """Each value that occurs, ascending, and where it does."""
    order = np.argsort(values, kind="stable")
    begin = np.flatnonzero(np.diff(values[order], prepend=-1))
    for rows in np.split(order, begin[1:]) if len(order) else []:
        yield int(values[rows[0]]), rows


def _widen(low: Ints, high: Ints, variables: Ints, rank: Ints) -> None:
    """Stretch the ranges of unknowns (m, k) to where their equations (m,) are."""
    for column in variables.T:
        np.minimum.at(low, column, rank)
        np.maximum.at(high, column, rank)
