"""Eliminating the first unknowns of a dense symmetric matrix onto the others, by LAPACK.

What borders of large blocks leave to each other is dense; ``sparse_inverse`` eliminates what lies inside of blocks.
Notation: of a matrix ((A, B'), (B, C)) the first part is eliminated, A = L L', Y = B L'^-1; C - Y Y' is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

from fusion.types import Floats


@dataclass(frozen=True, eq=False)
class DenseFront:
    """``count`` unknowns that are eliminated: ``lower`` (count, count) and ``across`` (rest, count), and the
    right-hand side behind the lower triangle (count,)."""

    lower: Floats
    across: Floats
    reduced: Floats

    @classmethod
    def eliminate(cls, matrix: Floats, vector: Floats, count: int) -> tuple[DenseFront, Floats, Floats]:
        """The front, and what is left of the matrix (n, n) and the vector (n,) for the unknowns behind it.

        Raises ``ValueError`` where the matrix is not positive definite.
        """
        if not count:
            return cls(np.zeros((0, 0)), np.zeros((len(vector), 0)), np.zeros(0)), matrix, vector
        try:
            lower = cholesky(matrix[:count, :count], lower=True)
        except np.linalg.LinAlgError:
            raise ValueError("the matrix is not positive definite: some unknown is not determined") from None
        reduced = solve_triangular(lower, vector[:count], lower=True)
        if count == len(vector):
            return cls(lower, np.zeros((0, count)), reduced), np.zeros((0, 0)), np.zeros(0)
        across = solve_triangular(lower, matrix[:count, count:], lower=True).T
        return (
            cls(lower, across, reduced),
            matrix[count:, count:] - across @ across.T,
            vector[count:] - across @ reduced,
        )

    def solve(self, rest: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """The solution (n,) and covariance (n, n) of all, from those of the rest."""
        count = len(self.lower)
        if not count:
            return rest, covariance
        x = solve_triangular(self.lower, self.reduced - self.across.T @ rest, lower=True, trans="T")
        gain = solve_triangular(self.lower, self.across.T, lower=True, trans="T")
        inverse, _ = dpotri(self.lower, lower=True)
        out = np.empty((count + len(rest), count + len(rest)))
        out[count:, count:] = covariance
        out[:count, count:] = -gain @ covariance
        out[count:, :count] = out[:count, count:].T
        own = np.tril(inverse)
        own += np.tril(inverse, -1).T
        out[:count, :count] = own - out[:count, count:] @ gain.T
        return np.concatenate([x, rest]), out
