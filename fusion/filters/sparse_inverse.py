"""Solving large sparse normal equations, with those covariances that a map needs and no others.

``NormalEquations`` is the whole of it for a caller; the compiled functions below are its steps. What the unknowns are,
and who wrote the equations, is not known here. (``scipy`` loads its parts when they are first used, so importing this
costs nothing.)
"""

from __future__ import annotations

import numpy as np
import scipy

from fusion.compiled import compiled
from fusion.types import Floats, Ints


class NormalEquations:
    """Factorised normal equations ``matrix @ x = vector``, symmetric positive definite, shape (n, n).

    The factor is L D L' in a fill-reducing order, ``order`` (n,), which serves matrices of the same pattern as well.
    Covariances are those of the inverse inside the factor's pattern (Takahashi's recursion): every pair of unknowns
    that share an equation, and no dense inverse ever exists. Raises ``ValueError`` where the matrix is not positive
    definite.
    """

    def __init__(self, matrix: scipy.sparse.csc_matrix, order: Ints | None = None) -> None:
        matrix = matrix.tocsc()
        self.order = fill_reducing_order(matrix) if order is None else order
        self._place = np.empty_like(self.order)
        self._place[self.order] = np.arange(len(self.order))
        upper = scipy.sparse.triu(matrix[self.order][:, self.order], format="csc")
        upper.sort_indices()
        columns = (upper.indptr.astype(np.int64), upper.indices.astype(np.int64), upper.data)
        # The pattern is found without looking at values: an entry that happens to be 0 belongs to it.
        parent, self._start = factor_pattern(*columns[:2])
        count = int(self._start[-1])
        self._index, self._value = np.empty(count, np.int64), np.empty(count)
        self._diagonal = np.empty(len(self.order))
        if not factorise(*columns, parent, self._start, self._index, self._value, self._diagonal):
            raise ValueError("the normal equations are not positive definite: some unknown is not determined")
        self._inverse: tuple[Floats, Floats] | None = None

    def solve(self, vector: Floats) -> Floats:
        """The solution, shape (n,)."""
        x = np.asarray(vector, float)[self.order]
        solve_in_place(self._start, self._index, self._value, self._diagonal, x)
        return np.asarray(x[self._place])

    def covariance(self, rows: Ints) -> Floats:
        """Covariances (m, k, k) among unknowns ``rows`` (m, k); pairs outside the pattern come out as NaN."""
        diagonal, off = self._selected()
        where = self._place[np.asarray(rows, np.int64)]
        out = np.empty((*where.shape, where.shape[1]))
        gather_blocks(where, self._start, self._index, diagonal, off, out)
        return out

    def _selected(self) -> tuple[Floats, Floats]:
        if self._inverse is None:
            diagonal, off = np.empty(len(self._diagonal)), np.empty(len(self._value))
            selected_inverse(self._start, self._index, self._value, self._diagonal, diagonal, off)
            self._inverse = (diagonal, off)
        return self._inverse


def fill_reducing_order(matrix: scipy.sparse.csc_matrix) -> Ints:
    """An elimination order (n,) with little fill: minimum degree, as SuperLU finds it."""
    try:
        factor = scipy.sparse.linalg.splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )
    except RuntimeError as error:
        raise ValueError("the normal equations are singular: some unknown is in no equation") from error
    return np.argsort(factor.perm_c).astype(np.int64)


@compiled
def factor_pattern(start: Ints, index: Ints) -> tuple[Ints, Ints]:
    """Elimination tree (n,) and column starts (n + 1,) of L, from the upper triangle by columns (Liu 1990)."""
    n = len(start) - 1
    parent, seen = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    count = np.zeros(n + 1, np.int64)
    for k in range(n):
        seen[k] = k
        for p in range(start[k], start[k + 1]):
            i = index[p]
            while i < k and seen[i] != k:
                if parent[i] < 0:
                    parent[i] = k
                count[i + 1] += 1
                seen[i] = k
                i = parent[i]
    return parent, np.cumsum(count)


@compiled
def factorise(
    start: Ints,
    index: Ints,
    value: Floats,
    parent: Ints,
    lower_start: Ints,
    lower_index: Ints,
    lower_value: Floats,
    diagonal: Floats,
) -> bool:
    """Fill L and D row by row (Davis 2006, chapter 4); False where a pivot is not positive."""
    n = len(parent)
    row, stack, path = np.zeros(n), np.empty(n, np.int64), np.empty(n, np.int64)
    seen, filled = np.full(n, -1, np.int64), np.zeros(n, np.int64)
    for k in range(n):
        top = n
        seen[k] = k
        pivot = 0.0
        for p in range(start[k], start[k + 1]):
            i = index[p]
            if i == k:
                pivot = value[p]
                continue
            row[i] = value[p]
            length = 0
            while seen[i] != k:
                path[length] = i
                length += 1
                seen[i] = k
                i = parent[i]
            while length > 0:
                top -= 1
                length -= 1
                stack[top] = path[length]
        for q in range(top, n):
            i = stack[q]
            y = row[i]
            row[i] = 0.0
            last = lower_start[i] + filled[i]
            for p in range(lower_start[i], last):
                row[lower_index[p]] -= lower_value[p] * y
            share = y / diagonal[i]
            pivot -= share * y
            lower_index[last], lower_value[last] = k, share
            filled[i] += 1
        if not pivot > 0.0:
            return False
        diagonal[k] = pivot
    return True


@compiled
def solve_in_place(start: Ints, index: Ints, value: Floats, diagonal: Floats, x: Floats) -> None:
    """Turn a right-hand side into the solution of L D L' x = b."""
    n = len(diagonal)
    for j in range(n):
        for p in range(start[j], start[j + 1]):
            x[index[p]] -= value[p] * x[j]
    for j in range(n):
        x[j] /= diagonal[j]
    for j in range(n - 1, -1, -1):
        for p in range(start[j], start[j + 1]):
            x[j] -= value[p] * x[index[p]]


@compiled
def selected_inverse(
    start: Ints, index: Ints, value: Floats, pivot: Floats, diagonal: Floats, off: Floats
) -> None:
    """Fill the inverse of L D L' on the pattern of L, last column first (Takahashi, Fagan, Chin 1973).

    ``start``, ``index``, ``value`` are the strictly lower triangle of L by columns, ``pivot`` is D.
    """
    n = len(pivot)
    at = np.full(n, -1, np.int64)
    total = np.zeros(n)
    for j in range(n - 1, -1, -1):
        first, last = start[j], start[j + 1]
        for p in range(first, last):
            at[index[p]] = p
            total[p - first] = 0.0
        for p in range(first, last):
            k, weight = index[p], value[p]
            total[p - first] += diagonal[k] * weight
            for r in range(start[k], start[k + 1]):
                q = at[index[r]]
                if q >= 0:
                    total[q - first] += off[r] * weight
                    total[p - first] += off[r] * value[q]
        variance = 1.0 / pivot[j]
        for p in range(first, last):
            off[p] = -total[p - first]
            variance -= value[p] * off[p]
            at[index[p]] = -1
        diagonal[j] = variance


@compiled
def gather_blocks(where: Ints, start: Ints, index: Ints, diagonal: Floats, off: Floats, out: Floats) -> None:
    """Collect blocks of the selected inverse for rows of places ``where`` (m, k) into ``out`` (m, k, k)."""
    for m in range(where.shape[0]):
        for a in range(where.shape[1]):
            out[m, a, a] = diagonal[where[m, a]]
            for b in range(a):
                column, row = min(where[m, a], where[m, b]), max(where[m, a], where[m, b])
                low, high = start[column], start[column + 1]
                while low < high:
                    middle = (low + high) // 2
                    if index[middle] < row:
                        low = middle + 1
                    else:
                        high = middle
                found = low < start[column + 1] and index[low] == row
                out[m, a, b] = off[low] if found else np.nan
                out[m, b, a] = out[m, a, b]
