"""Sparse normal equations as sums of small dense blocks, whose weights change from round to round.

Knows where things stand, not what is believed or measured of them (``adjust``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
import scipy

from fusion.filters.front_tree import add_blocks
from fusion.filters.sparse_inverse import Elimination, NormalEquations, fill_reducing_order
from fusion.types import Floats, Ints

RIDGE = 1e-10
"""Share of the diagonal that is added where rounding has left the equations not quite positive definite."""


class Asked(Enum):
    """What is asked of every solution about some equations."""

    NOTHING = 0
    EXPECTED = 1
    """``Solution.expected_squares``"""
    MISFIT = 2
    """``Solution.squares`` and ``Solution.products``"""


@dataclass(eq=False)
class Blocks:
    """m blocks over k unknowns each: ``variables`` (m, k), ``information`` (m, k, k), ``vector`` (m, k).

    ``weight`` (m,) multiplies both; whoever gives another one, or another vector, asks for the next solution. What is
    not here, but with who works on the equations, has ``numbers`` (m,) there instead of information and vector.
    """

    variables: Ints
    information: Floats
    vector: Floats
    weight: Floats
    asked: Asked = Asked.NOTHING
    numbers: Ints | None = None

    @classmethod
    def elsewhere(cls, variables: Ints, numbers: Ints) -> Blocks:
        """Blocks whose information and vector are not here."""
        m, k = variables.shape
        return cls(variables, np.empty((0, k, k)), np.empty((0, k)), np.ones(m), numbers=numbers)

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

    def products(self, x: Floats) -> Floats:
        """x' vector of each block at a solution, (m,)."""
        return np.asarray(np.sum(self.vector * x[self.variables], axis=1))

    def expected_squares(self, x: Floats, covariance: Floats) -> Floats:
        """Their squares expected under covariances (m, k, k)."""
        spread = np.einsum("mij,mji->m", self.information, covariance)
        return np.asarray(self.squares(x) + np.maximum(spread, 0.0))


class Covariances(Protocol):
    """Whoever knows covariances (m, k, k) among unknowns (m, k) that share an equation."""

    def covariance(self, rows: Ints) -> Floats: ...


@dataclass(frozen=True, eq=False)
class Solution:
    """The solution (size,) and the factorised equations, which know its covariances."""

    x: Floats
    equations: Covariances

    def squares(self, blocks: Blocks) -> Floats:
        """x' information x of each block, (m,)."""
        return blocks.squares(self.x)

    def products(self, blocks: Blocks) -> Floats:
        """x' vector of each block, (m,)."""
        return blocks.products(self.x)

    def expected_squares(self, blocks: Blocks) -> Floats:
        """The squares expected under the covariance, (m,)."""
        return blocks.expected_squares(self.x, self.equations.covariance(blocks.variables))

    def variances(self, forms: Sequence[Forms]) -> list[Floats]:
        """Of linear forms: weights (m, q, k) over unknowns (m, k) that share an equation; (m, q) for each."""
        return [form_variances(self.equations.covariance(rows), weights) for rows, weights in forms]


Forms = tuple[Ints, Floats]
"""Unknowns (m, k) and weights (m, q, k) of q linear forms over each row of them."""


def form_variances(covariance: Floats, weights: Floats) -> Floats:
    """Variances (m, q) of linear forms (m, q, k) under covariances (m, k, k)."""
    every = [np.einsum("mi,mij,mj->m", w, covariance, w) for w in weights.transpose(1, 0, 2)]
    return np.column_stack(every)


class EquationSystem:
    """The sum of ``Blocks`` over ``size`` unknowns; each of ``late`` is eliminated after all that it occurs with."""

    def __init__(self, size: int, blocks: list[Blocks], late: Ints) -> None:
        self.size = size
        self.blocks = [b for b in blocks if len(b.variables)]
        pattern = pattern_of(size, [b.variables for b in self.blocks])
        self.how = Elimination(pattern, order_with_late(pattern, late))
        self._slots = [self.how.slots(b.variables, keep=True) for b in self.blocks]

    def solve(self, covariances: bool = True) -> Solution:
        """The solution at the present weights. Raises ``ValueError`` where some unknown is not determined."""
        vector = right_hand_side(self.size, self.blocks)
        equations = factorised(self.how, self.blocks, self._slots)
        return Solution(equations.solve(vector), equations)


def order_with_late(pattern: scipy.sparse.csc_matrix, late: Ints) -> Ints:
    """An order of elimination (size,): the ``late`` stay out of the search for little fill, which they would mislead,
    for they join what lies far apart; each then follows the last one that it occurs with."""
    size = pattern.shape[0]
    early = np.setdiff1d(np.arange(size), late)
    rank = np.full(size, -1.0)
    rank[early[fill_reducing_order(pattern[early][:, early])]] = np.arange(len(early))
    if len(late):
        mine = pattern[:, late]
        latest = np.maximum.reduceat(rank[mine.indices], mine.indptr[:-1])
        rank[late] = np.where(latest >= 0, latest + 0.5, size)
    return np.argsort(rank, kind="stable")


def pattern_of(size: int, variables: list[Ints]) -> scipy.sparse.csc_matrix:
    """Which of ``size`` unknowns occur in blocks together, from the variables (m, k) of blocks of every kind."""
    length = np.concatenate([np.full(len(v), v.shape[1]) for v in variables])
    start = np.concatenate([[0], np.cumsum(length)])
    index = np.concatenate([v.ravel() for v in variables])
    incidence = scipy.sparse.csr_matrix((np.ones(len(index), np.float32), index, start), (len(length), size))
    return (incidence.T @ incidence).tocsc()


def right_hand_side(size: int, blocks: list[Blocks]) -> Floats:
    """The sum (size,) of the blocks' vectors."""
    vector = np.zeros(size)
    for one in blocks:
        weighed = (one.weight[:, None] * one.vector).ravel()
        vector += np.bincount(one.variables.ravel(), weights=weighed, minlength=size)
    return vector


def factorised(how: Elimination, blocks: list[Blocks], slots: list[Ints]) -> NormalEquations:
    """The sum of the blocks, factorised; with a ridge where rounding asks for one."""
    for ridge in (0.0, RIDGE):
        panels = how.zeros()
        for one, where in zip(blocks, slots, strict=True):
            add_blocks(panels, where, np.ascontiguousarray(one.information), one.weight)
        if ridge:
            panels[how.diagonal()] *= 1 + ridge
        try:
            return NormalEquations(how, panels)
        except ValueError:
            if ridge:
                raise
    raise AssertionError
