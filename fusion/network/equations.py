"""Sparse normal equations as sums of small dense blocks, whose weights change from round to round.

Knows where things stand, not what is believed or measured of them (``adjust``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fusion.filters.sparse_inverse import NormalEquations, fill_reducing_order
from fusion.types import Floats, Ints

RIDGE = 1e-10
"""Share of the diagonal that is added where rounding has left the equations not quite positive definite."""


@dataclass(eq=False)
class Blocks:
    """m blocks over k unknowns each: ``variables`` (m, k), ``information`` (m, k, k), ``vector`` (m, k).

    ``weight`` (m,) multiplies both; whoever changes it asks for the next solution.
    """

    variables: Ints
    information: Floats
    vector: Floats
    weight: Floats

    @classmethod
    def of_rows(
        cls, variables: Ints, design: Floats, value: Floats | float, variance: Floats | float
    ) -> Blocks:
        """Observations design (m, k) @ x = value with these variances."""
        variables, design = np.atleast_2d(variables), np.asarray(design, float)
        m = len(variables)
        design = np.broadcast_to(design, variables.shape)
        precision = np.broadcast_to(1.0 / np.asarray(variance, float), (m,))
        scaled = precision[:, None] * design
        value = np.broadcast_to(np.asarray(value, float), (m,))
        return cls(variables, scaled[:, :, None] * design[:, None, :], scaled * value[:, None], np.ones(m))

    def squares(self, x: Floats) -> Floats:
        """x' information x of each block at a solution, (m,)."""
        here = x[self.variables]
        return np.asarray(np.einsum("mi,mij,mj->m", here, self.information, here))

    def expected_squares(self, solution: Solution) -> Floats:
        """The same expected under the solution's covariance."""
        spread = np.einsum("mij,mji->m", self.information, solution.equations.covariance(self.variables))
        return np.asarray(self.squares(solution.x) + np.maximum(spread, 0.0))


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution (size,) and the factorised equations, which know its covariances."""

    x: Floats
    equations: NormalEquations


class EquationSystem:
    """The sum of ``Blocks`` over ``size`` unknowns; ``last`` are unknowns that are eliminated last."""

    def __init__(self, size: int, blocks: list[Blocks], last: Ints) -> None:
        self.size = size
        self.blocks = [b for b in blocks if len(b.variables)]
        rows, columns = [], []
        for one in self.blocks:
            k = one.variables.shape[1]
            rows.append(np.repeat(one.variables, k, axis=1).ravel())
            columns.append(np.tile(one.variables, (1, k)).ravel())
        key = np.concatenate(columns) * size + np.concatenate(rows)
        found, self._slot = np.unique(key, return_inverse=True)
        self._indices, column = found % size, found // size
        self._starts = np.searchsorted(column, np.arange(size + 1))
        self._order = self._elimination_order(last)

    def _elimination_order(self, last: Ints) -> Ints:
        matrix = self._matrix(
            np.where(self._indices == np.repeat(np.arange(self.size), np.diff(self._starts)), 1e3, 1.0)
        )
        early = np.setdiff1d(np.arange(self.size), last)
        order = fill_reducing_order(matrix[early][:, early])
        return np.concatenate([early[order], last]).astype(np.int64)

    def _matrix(self, values: Floats) -> scipy.sparse.csc_matrix:
        return scipy.sparse.csc_matrix((values, self._indices, self._starts), shape=(self.size, self.size))

    def solve(self) -> Solution:
        """The solution at the present weights. Raises ``ValueError`` where some unknown is not determined."""
        parts = [(b.weight[:, None, None] * b.information).ravel() for b in self.blocks]
        values = np.asarray(
            np.bincount(self._slot, weights=np.concatenate(parts), minlength=len(self._indices)), np.float64
        )
        vector = np.zeros(self.size)
        for one in self.blocks:
            vector += np.bincount(
                one.variables.ravel(), weights=(one.weight[:, None] * one.vector).ravel(), minlength=self.size
            )
        matrix = self._matrix(values)
        try:
            equations = NormalEquations(matrix, self._order)
        except ValueError:
            matrix.setdiag((1 + RIDGE) * matrix.diagonal())
            equations = NormalEquations(matrix, self._order)
        return Solution(equations.solve(vector), equations)
