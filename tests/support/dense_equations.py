"""Gaussian equations one by one, and the inverse of their sum in more digits than the library's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np


class Equation:
    """Information and vector over some unknowns, times a weight that rounds of learning change."""

    def __init__(self, at: Sequence[int], information: np.ndarray, vector: np.ndarray | None = None) -> None:
        self.at, self.information, self.weight = list(at), information, 1.0
        self.vector = np.zeros(len(self.at)) if vector is None else vector

    def square(self, solution: np.ndarray, covariance: np.ndarray) -> float:
        """Expected x' information x."""
        x = solution[self.at]
        spread = np.trace(self.information @ covariance[np.ix_(self.at, self.at)])
        return float(x @ self.information @ x + spread)


def observed(weights: Mapping[int, float], value: float, sigma: float) -> Equation:
    """weights' x = value +- sigma."""
    w = np.array(list(weights.values()))
    return Equation(list(weights), np.outer(w, w) / sigma**2, w * value / sigma**2)


def inverted(matrix: np.ndarray) -> np.ndarray:
    """The inverse of a positive definite matrix by Gauss and Jordan, in the digits that the matrix comes with."""
    scale = 1 / np.sqrt(np.diagonal(matrix))
    left = matrix * np.outer(scale, scale)
    n = len(left)
    for k in range(n):
        pivot = left[k, k]
        row = left[k] / pivot
        column = left[:, k].copy()
        left -= np.outer(column, row)
        left[k], left[:, k] = row, -column / pivot
        left[k, k] = 1 / pivot
    return np.asarray(0.5 * (left + left.T) * np.outer(scale, scale))
