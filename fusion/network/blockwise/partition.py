"""Which block each segment and each unknown is of, and the tree over the blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from fusion.network.blockwise.work import EACH_WAITING
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.pass_factor import CONSTANTS, PassFactor
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Ints

MOST_BUNDLED = 4
"""Blocks of one task."""


class PassSource(Protocol):
    """Who can be sent to another process and reads there what drives say of the segments of a block."""

    def passes(self, block: int) -> Mapping[int, Sequence[PassFactor]]:
        """Passes by drives; ``PassFactor.segment`` is a row of the whole network."""
        ...


@dataclass(frozen=True, eq=False)
class Partition:
    """The number of the block of each segment (n,), and who does the work on them (``None``: one after another).

    ``parent`` is the tree: the node above each node, -1 above the root. Its first nodes are the blocks. Without it
    numbers are halved. ``folder`` is where the work leaves what later work needs, for all hands to reach; without it
    this process's memory serves, for hands in this process. Who names it removes it, after the last covariance.
    ``hands``: how many tasks the executor works on at once.
    """

    block: Ints
    executor: Executor | None = None
    parent: Ints | None = None
    folder: Path | None = None
    hands: int = 2

    def tree(self) -> BlockTree:
        """The tree over the blocks."""
        return BlockTree(halved(int(self.block.max(initial=0)) + 1) if self.parent is None else self.parent)


class BlockTree:
    """``parent`` (nodes,) as ``Partition`` has it; ``order``: children before parents, each subtree in one run."""

    def __init__(self, parent: Ints) -> None:
        self.parent = np.asarray(parent, np.int64)
        self.children: list[list[int]] = [[] for _ in self.parent]
        for node, above in enumerate(self.parent.tolist()):
            if above >= 0:
                self.children[above].append(node)
        (self.root,) = np.flatnonzero(self.parent < 0).tolist()
        down, waiting = [], [self.root]
        while waiting:
            down.append(waiting.pop())
            waiting += self.children[down[-1]]
        self.order = down[::-1]
        self.depth = np.zeros(len(self.parent), np.int64)
        for node in down[1:]:
            self.depth[node] = self.depth[self.parent[node]] + 1
        self.rank = np.empty(len(self.parent), np.int64)
        """Where each node stands in ``order``"""
        self.rank[self.order] = np.arange(len(self.order))

    def bundles(self, hands: int) -> Ints:
        """For each node the root of the small subtree with which it is one task: few enough blocks that so many
        ``hands`` have enough of them."""
        blocks = np.array([not children for children in self.children], np.int64)
        for node in self.order:
            if self.parent[node] >= 0:
                blocks[self.parent[node]] += blocks[node]
        most = min(MOST_BUNDLED, blocks[self.root] // (EACH_WAITING * hands))
        root = np.arange(len(self.parent))
        for node in self.order[::-1]:
            above = self.parent[node]
            if above >= 0 and blocks[above] <= most:
                root[node] = root[above]
        return root

    def lowest_above(self, left: Ints, right: Ints) -> Ints:
        """The lowest node that is above, or is, both of two nodes, (m,)."""
        left, right = left.copy(), right.copy()
        while (apart := left != right).any():
            deeper = apart & (self.depth[left] >= self.depth[right])
            other = apart & (self.depth[right] >= self.depth[left])
            left[deeper], right[other] = self.parent[left[deeper]], self.parent[right[other]]
        return left


def halved(count: int) -> Ints:
    """A tree over so many blocks, by halves of their numbers."""
    parent, waiting = [-1] * count, [(0, count, -1)]
    while waiting:
        first, end, above = waiting.pop()
        if end - first == 1:
            parent[first] = above
            continue
        parent.append(above)
        middle = (first + end) // 2
        waiting += [(first, middle, len(parent) - 1), (middle, end, len(parent) - 1)]
    return np.array(parent, np.int64)


def bisected(network: RoadTable, most: int, folder: Path | None = None) -> Partition:
    """Blocks of at most ``most`` segments: the network is halved across its longer side as often as it takes."""
    north = 0.5 * (network.lat0_deg + network.lat1_deg)
    east = 0.5 * (network.lon0_deg + network.lon1_deg) * np.cos(np.radians(north.sum() / max(len(north), 1)))
    above, waiting = [-1], [(0, np.arange(len(network)))]
    leaves: list[tuple[int, Ints]] = []
    while waiting:
        node, rows = waiting.pop()
        if len(rows) <= max(most, 1):
            leaves.append((node, rows))
            continue
        along = max((east[rows], north[rows]), key=lambda side: float(np.ptp(side)))
        order = rows[np.argsort(along, kind="stable")]
        waiting += [
            (len(above), order[: len(rows) // 2]),
            (len(above) + 1, order[len(rows) // 2 :]),
        ]
        above += [node, node]
    block = np.zeros(len(network), np.int64)
    for number, (_, rows) in enumerate(leaves):
        block[rows] = number
    first = np.array([node for node, _ in leaves])
    named = np.concatenate([first, np.setdiff1d(np.arange(len(above)), first)])
    number_of = np.append(np.argsort(named), -1)
    return Partition(block, None, number_of[np.array(above)[named]], folder)


def homes(block: Ints, road: RoadUnknowns, drives: DriveBeliefs) -> Ints:
    """The block of each unknown: that of its segment; -1 for nodes and what a drive has but once."""
    home = np.full(drives.size, -1, np.int64)
    home[road.nodes : road.size] = np.repeat(block, road.count)
    own = drives.of_pass[:, len(CONSTANTS) :]
    home[own[own >= 0]] = np.broadcast_to(block[drives.passes.segment][:, None], own.shape)[own >= 0]
    return home
