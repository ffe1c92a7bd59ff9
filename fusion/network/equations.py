"""The unknowns of a network of roads and their normal equations, block by block.

Knows where things stand, not what is believed or measured of them (``adjust``).
"""

from __future__ import annotations

import numpy as np
import scipy

from fusion.network.curve import interval_count, knot_length
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints


class Unknowns:
    """Which unknown is what: a height at each node first, then the knot variables of each of the n segments.

    Columns of shape (n,): ``length_m`` is what the knots assume, ``intervals`` how many they span; ``structure``: a
    bridge or tunnel; ``start_node`` and ``end_node`` are the unknowns at the segment's nodes, ``first`` is its first
    own one and ``count`` how many it has. ``nodes`` and ``size`` are the numbers of nodes and of all unknowns.
    """

    def __init__(self, network: RoadTable) -> None:
        self.length_m = knot_length(network.length_m)
        self.structure = network.bridge | network.tunnel
        self.intervals = interval_count(self.length_m)
        ends = np.concatenate([network.from_node, network.to_node])
        _, node = np.unique(ends, return_inverse=True)
        self.start_node, self.end_node = node[: len(network)], node[len(network) :]
        self.nodes = int(node.max()) + 1
        self.count = 2 * (self.intervals + 1)
        self.first = self.nodes + np.concatenate([[0], np.cumsum(self.count)[:-1]])
        self.size = self.nodes + int(self.count.sum())

    def rows_with(self, intervals: int) -> Ints:
        """Segments with so many intervals."""
        return np.flatnonzero(self.intervals == intervals)

    def variables(self, rows: Ints) -> Ints:
        """Unknowns (m, 2 * intervals + 2) of segments with equal numbers of intervals, in the order of the knots."""
        return np.asarray(self.first[rows][:, None] + np.arange(int(self.count[rows[0]])))

    def end(self, rows: Ints, at_end: Bools) -> Ints:
        """The unknown that is the height at the start or the end of each row; its grade is the next."""
        return np.where(at_end, self.first[rows] + self.count[rows] - 2, self.first[rows])


class EquationSystem:
    """Normal equations of ``size`` unknowns under construction: sums of small dense blocks."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.vector = np.zeros(size)
        self._parts: list[tuple[Ints, Ints, Floats]] = []

    def add(self, variables: Ints, blocks: Floats, vectors: Floats | None = None) -> None:
        """Add blocks (m, k, k) over unknowns (m, k), and right-hand sides (m, k)."""
        k = variables.shape[1]
        self._parts.append(
            (np.repeat(variables, k, axis=1).ravel(), np.tile(variables, (1, k)).ravel(), blocks.ravel())
        )
        if vectors is not None:
            np.add.at(self.vector, variables, vectors)

    def copy(self) -> EquationSystem:
        """Another system that begins with the same equations."""
        other = EquationSystem(self.size)
        other.vector, other._parts = self.vector.copy(), list(self._parts)
        return other

    def matrix(self) -> scipy.sparse.csc_matrix:
        """The sum, with a weak hold on the level of each connected part, which no difference of heights fixes."""
        rows, columns, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        matrix = scipy.sparse.csc_matrix((values, (rows, columns)), shape=(self.size, self.size))
        _, part = scipy.sparse.csgraph.connected_components(matrix, directed=False)
        _, first = np.unique(part, return_index=True)
        # In place: a sum of sparse matrices would drop entries that happen to be 0, and their covariances with them.
        diagonal = matrix.diagonal()
        diagonal[first] += 1.0
        matrix.setdiag(diagonal)
        return matrix
