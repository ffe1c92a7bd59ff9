"""Solving large sparse normal equations, with those covariances that a map needs and no others."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fusion.compiled import compiled
from fusion.types import Floats, Ints


class NormalEquations:
    """Factorised normal equations ``matrix @ x = vector``, symmetric positive definite, shape (n, n).

    The factor is L D L' in a fill-reducing order. Covariances are those of the inverse inside the factor's pattern
    (Takahashi's recursion): every pair of unknowns that share an equation, and no dense inverse ever exists.
    Raises ``ValueError`` where the matrix is not positive definite.
    """

    def __init__(self, matrix: sparse.csc_matrix) -> None:
        try:
            factor = splu(
                matrix.tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True, "Equil": False},
            )
        except RuntimeError as error:
            raise ValueError("the normal equations are singular: some unknown is in no equation") from error
        self._factor = factor
        self._diagonal = factor.U.diagonal()
        if not (np.array_equal(factor.perm_r, factor.perm_c) and np.all(self._diagonal > 0)):
            raise ValueError("the normal equations are not positive definite")
        self._place = np.asarray(factor.perm_c, np.int64)
        self._lower: tuple[Ints, Ints, Floats] | None = None
        self._inverse: tuple[Floats, Floats] | None = None

    def solve(self, vector: Floats) -> Floats:
        """The solution, shape (n,)."""
        return np.asarray(self._factor.solve(np.asarray(vector, float)))

    def covariance(self, rows: Ints) -> Floats:
        """Covariances (m, k, k) among unknowns ``rows`` (m, k); pairs outside the pattern come out as 0."""
        diagonal, off = self._selected()
        start, index, _ = self._columns()
        where = self._place[np.asarray(rows, np.int64)]
        out = np.empty((*where.shape, where.shape[1]))
        gather_blocks(where, start, index, diagonal, off, out)
        return out

    def _columns(self) -> tuple[Ints, Ints, Floats]:
        if self._lower is None:
            lower = sparse.tril(self._factor.L, -1).tocsc()
            lower.sort_indices()
            self._lower = (lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data)
        return self._lower

    def _selected(self) -> tuple[Floats, Floats]:
        if self._inverse is None:
            start, index, value = self._columns()
            diagonal, off = np.empty(len(self._diagonal)), np.empty(len(value))
            selected_inverse(start, index, value, self._diagonal, diagonal, off)
            self._inverse = (diagonal, off)
        return self._inverse


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
                out[m, a, b] = off[low] if found else 0.0
                out[m, b, a] = out[m, a, b]
