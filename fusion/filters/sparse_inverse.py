"""Solving large sparse normal equations, with those covariances that a map needs and no others.

``NormalEquations`` is the whole of it for a caller; ``Elimination`` is what serves all matrices of one pattern. What
the unknowns are, and who wrote the equations, is not known here. (``scipy`` loads its parts when they are first used,
so importing this costs nothing.)

Why this stands here beside CHOLMOD and SuperLU, which factorise as well: a map needs more than a solution.

* Every published sigma needs the covariance among the unknowns of one segment. ``selected_inverse`` gives those entries
  of the inverse in one sweep over the factor; the libraries give columns, one solve for each unknown.
* A large network is solved block by block: ``border`` eliminates the inside of a block onto its edge and hands the rest
  on (``fusion.network.blockwise``). The libraries factorise the whole matrix only.
* The pattern is analysed once for all rounds of weighing, and blocks of equations are added straight into the fronts.
* It is Python compiled like the rest: nothing is to be built or licensed beside numpy, scipy and numba.

``benchmarks/factorisation.py`` compares it with CHOLMOD on the equations of a town; ``benchmarks/adjustment.py`` holds
its time and memory (``update``, ``scratch``, ``blocks``);
``tests/fusion/filters/test_sparse_inverse.py`` compares it with dense inverses.
"""

from __future__ import annotations

from typing import Self

import numpy as np
import scipy

from fusion.filters.front_tree import (
    Tree,
    column_counts,
    elimination_tree,
    front_columns,
    front_rows,
    gather_blocks,
    postorder,
    relative_rows,
    slots_of,
    stack_sizes,
    triangle,
)
from fusion.filters.fronts import factorise, selected_inverse, solve_backward, solve_forward
from fusion.filters.minimum_degree import minimum_degree
from fusion.types import Floats, Ints


class Elimination:
    """How matrices of a symmetric pattern (n, n) are eliminated in about the order ``order`` (n,).

    The last ``border`` unknowns of ``order`` stay: the rest is eliminated onto them, and each pair of them counts as
    part of the pattern. ``place`` (n,) is where each unknown stands in the order of elimination.
    """

    def __init__(self, pattern: scipy.sparse.csc_matrix, order: Ints, border: int = 0) -> None:
        n, interior = len(order), len(order) - border
        start, index = pattern.indptr.astype(np.int64), pattern.indices.astype(np.int64)
        parent = elimination_tree(*triangle(start, index, order, _inverse_of(order), True), interior)
        order = np.concatenate([order[postorder(parent, interior)], order[interior:]])
        self.place = _inverse_of(order)
        upper = triangle(start, index, order, self.place, True)
        parent = elimination_tree(*upper, interior)
        count = column_counts(*upper, parent, interior)
        first = front_columns(parent[:interior], count)
        if border:
            first = np.append(first, n)
        lower = triangle(start, index, order, self.place, False)
        row_start, rows, above = front_rows(first, count, *lower)
        relative = relative_rows(first, row_start, rows, above)
        k = np.diff(first)
        panel_start = np.concatenate([[0], np.cumsum(k * (k + np.diff(row_start)))]).astype(np.int64)
        sizes = stack_sizes(first, row_start, above)
        self.tree = Tree(first, row_start, rows, above, relative, panel_start, sizes)
        self.front_of = np.repeat(np.arange(len(k)), k)
        self.order, self.border = order, border
        self.open_fronts = int(border > 0)
        self._kept: dict[int, tuple[Ints, Ints]] = {}

    def slots(self, rows: Ints, keep: bool = False) -> Ints:
        """Where blocks over unknowns ``rows`` (m, k) are added: slots of their lower triangles (m, k (k + 1) / 2).

        ``keep`` them for covariances that will be asked for of the very same array, which must stay as it is.
        """
        slots = np.asarray(slots_of(self.place[rows], self.tree, self.front_of))
        if keep:
            self._kept[id(rows)] = rows, slots
        return slots

    def kept_slots(self, rows: Ints) -> Ints | None:
        """Those that were kept of this very array, None where none were."""
        known, slots = self._kept.get(id(rows), (None, None))
        return slots if known is rows else None

    def zeros(self) -> Floats:
        """A matrix to add blocks to, in the layout of the factor."""
        return np.zeros(int(self.tree.panel_start[-1]))

    def diagonal(self) -> Ints:
        """The slots of the diagonal (n,), in the order of elimination."""
        place = np.arange(len(self.order))[:, None]
        return np.asarray(slots_of(place, self.tree, self.front_of))[:, 0]


class NormalEquations:
    """Factorised normal equations ``matrix @ x = vector``, symmetric positive definite, shape (n, n).

    ``panels`` is the matrix as ``how`` lays it out; it becomes the factor. Covariances are those of the inverse inside
    the factor's pattern: every pair of unknowns that share an equation, and no dense inverse ever exists. Raises
    ``ValueError`` where the matrix is not positive definite.
    """

    def __init__(self, how: Elimination, panels: Floats) -> None:
        self.how, self.panels = how, panels
        if not factorise(how.tree, how.open_fronts, panels):
            raise ValueError("the normal equations are not positive definite: some unknown is not determined")
        self._inverse: Floats | None = None

    @classmethod
    def of_factor(cls, how: Elimination, panels: Floats, inverse: Floats | None = None) -> Self:
        """Of the ``panels`` that are the factor already, and of the inverse where it was made."""
        out = cls.__new__(cls)
        out.how, out.panels, out._inverse = how, panels, inverse
        return out

    @classmethod
    def of(cls, matrix: scipy.sparse.csc_matrix, how: Elimination | None = None) -> NormalEquations:
        """Of one matrix on its own, or of another of the pattern that ``how`` was made for."""
        how = how or Elimination(matrix, fill_reducing_order(matrix))
        lower = scipy.sparse.tril(matrix).tocoo()
        slots = how.slots(np.column_stack([lower.row, lower.col]).astype(np.int64))[:, 1]
        panels = how.zeros()
        np.add.at(panels, slots, lower.data)
        return cls(how, panels)

    def solve(self, vector: Floats) -> Floats:
        """The solution, shape (n,)."""
        x = self.reduced(vector)
        return self.solve_inside(x, x[len(x) :])

    def reduced(self, vector: Floats) -> Floats:
        """The right-hand side after elimination, in its order (n,): the last of it is the border's."""
        x = np.asarray(vector, float)[self.how.order]
        solve_forward(self.how.tree, self.how.open_fronts, self.panels, x)
        return x

    def border_matrix(self) -> Floats:
        """What the eliminated unknowns leave to the border, (border, border)."""
        size = self.how.border
        lower = np.tril(self.panels[len(self.panels) - size**2 :].reshape(size, size))
        return np.asarray(lower + np.tril(lower, -1).T)

    def solve_inside(self, reduced: Floats, border: Floats) -> Floats:
        """The solution (n,) from the ``reduced`` right-hand side and the border's solution."""
        x = reduced.copy()
        x[len(x) - self.how.border :] = border
        solve_backward(self.how.tree, self.how.open_fronts, self.panels, x)
        return np.asarray(x[self.how.place])

    def set_border_covariance(self, covariance: Floats) -> Floats:
        """Give the covariance of the border (border, border); returns panels of the inverse, which follow from it."""
        inverse = np.empty(len(self.panels))
        inverse[len(inverse) - covariance.size :] = covariance.ravel()
        selected_inverse(self.how.tree, self.how.open_fronts, self.panels, inverse)
        self._inverse = inverse
        return inverse

    def covariance(self, rows: Ints) -> Floats:
        """Covariances (m, k, k) among unknowns ``rows`` (m, k); pairs outside the pattern come out as NaN."""
        inverse = self.set_border_covariance(np.empty((0, 0))) if self._inverse is None else self._inverse
        slots = self.how.kept_slots(rows)
        if slots is not None:
            return covariance_at(slots, rows.shape[1], inverse)
        where = self.how.place[np.asarray(rows, np.int64)]
        out = np.empty((*where.shape, where.shape[1]))
        gather_blocks(where, self.how.tree, self.how.front_of, inverse, out)
        return out


def covariance_at(slots: Ints, size: int, inverse: Floats) -> Floats:
    """Covariances (m, size, size) of what ``Elimination.slots`` were asked of, from the panels of the inverse."""
    return np.asarray(inverse[slots][:, _both_triangles(size)])


def fill_reducing_order(pattern: scipy.sparse.csc_matrix) -> Ints:
    """An elimination order (n,) with little fill for a symmetric pattern (n, n)."""
    return np.asarray(minimum_degree(pattern.indptr.astype(np.int64), pattern.indices.astype(np.int64)))


def _both_triangles(size: int) -> Ints:
    """Which number of a lower triangle, row by row, stands where in the matrix (size, size)."""
    row, column = np.indices((size, size))
    high, low = np.maximum(row, column), np.minimum(row, column)
    return np.asarray(high * (high + 1) // 2 + low)


def _inverse_of(order: Ints) -> Ints:
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place
