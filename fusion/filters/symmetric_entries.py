"""Symmetric matrices of which most is 0, as their other entries: what adds up, and gives dense parts of itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from fusion.types import Floats, Ints

DENSE_UP_TO = 1500
"""So many unknowns are integrated out by a dense solution at most."""
_COLUMNS_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class SymmetricEntries:
    """The entries of n rows that are not 0, row by row with ascending columns, those of both triangles.

    Row k has ``column[start[k]:start[k + 1]]``, and values there; ``start`` is (n + 1,).
    """

    start: Ints
    column: Ints
    value: Floats

    @classmethod
    def of(cls, size: int, row: Ints, column: Ints, value: Floats) -> Self:
        """Of triples, which are added up; both triangles are among them."""
        place, which = np.unique(row * size + column, return_inverse=True)
        total = np.bincount(which.ravel(), value, len(place))
        told = total != 0.0
        at, total = place[told], total[told]
        start = np.searchsorted(at, size * np.arange(size + 1))
        return cls(start, at % max(size, 1), total)

    @classmethod
    def of_dense(cls, matrix: Floats) -> Self:
        """Of a symmetric matrix."""
        row, column = np.nonzero(matrix)
        return cls.of(len(matrix), row, column, matrix[row, column])

    def __len__(self) -> int:
        return len(self.start) - 1

    @property
    def row(self) -> Ints:
        """The row of each entry."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    def times(self, factor: float) -> SymmetricEntries:
        """All entries so many times as large."""
        return SymmetricEntries(self.start, self.column, factor * self.value)

    def diagonal(self) -> Floats:
        """The diagonal (n,)."""
        out, on = np.zeros(len(self)), self.row == self.column
        out[self.column[on]] = self.value[on]
        return out

    def within(self, rows: Ints) -> SymmetricEntries:
        """The part at these rows, ascending, and the same columns."""
        place = np.full(len(self), -1)
        place[rows] = np.arange(len(rows))
        row, column = place[self.row], place[self.column]
        inside = (row >= 0) & (column >= 0)
        return SymmetricEntries.of(len(rows), row[inside], column[inside], self.value[inside])

    def dense(self, rows: Ints, columns: Ints) -> Floats:
        """The part at these rows and columns, each of them once, in any order."""
        out, order = np.zeros((len(rows), len(columns))), np.argsort(columns)
        count = self.start[rows + 1] - self.start[rows]
        row = np.repeat(np.arange(len(rows)), count)
        entry = np.arange(len(row)) + np.repeat(self.start[rows] - (np.cumsum(count) - count), count)
        if len(columns):
            sought = columns[order]
            at = np.minimum(np.searchsorted(sought, self.column[entry]), len(columns) - 1)
            here = sought[at] == self.column[entry]
            out[row[here], order[at[here]]] = self.value[entry[here]]
        return out

    def integrated(self, gone: Ints, prior: Floats, kept: Ints, vector: Floats) -> tuple[Floats, Floats]:
        """What goes of the part at ``kept`` (k, k), and of its vector (k,), when the unknowns ``gone`` are integrated
        out, with precisions ``prior`` of their own; ``vector`` (n,)."""
        if len(gone) <= DENSE_UP_TO:
            across = self.dense(gone, kept)
            inside = self.dense(gone, gone) + np.diag(prior)
            solved = np.linalg.solve(inside, np.column_stack([across, vector[gone]]))
            return across.T @ solved[:, :-1], across.T @ solved[:, -1]
        return self._integrated_sparsely(gone, prior, kept, vector)

    def _integrated_sparsely(
        self, gone: Ints, prior: Floats, kept: Ints, vector: Floats
    ) -> tuple[Floats, Floats]:
        """... which are many: of those kept most have nothing to do with them."""
        rows = scipy.sparse.csr_array((self.value, self.column, self.start), (len(self),) * 2)[gone]
        inside = (rows[:, gone] + scipy.sparse.diags_array(prior)).tocsc()
        solve = scipy.sparse.linalg.splu(inside, options={"SymmetricMode": True}).solve
        across = rows[:, kept].tocsc()
        told = np.flatnonzero(np.diff(across.indptr))
        information, lost = np.zeros((len(kept), len(kept))), np.zeros(len(kept))
        lost[told] = across[:, told].T @ solve(vector[gone])
        for some in np.split(told, range(_COLUMNS_AT_ONCE, len(told), _COLUMNS_AT_ONCE)):
            solved = solve(across[:, some].toarray())
            information[np.ix_(told, some)] = across[:, told].T @ solved
        return information, lost
