"""Whole numbers instead of the solution of a least-squares problem, so that the misfit stays small.

To round each post by itself would err by 0.3 m, wherever a road is. But a place on a road rests on four posts, of which
one more or less makes up for what another one lost. So from the rounded posts on, the four of each cell that a road
passes are moved together by one or nothing each, as the misfit is least, until no cell can be bettered.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy import sparse

from fusion.compiled import compiled
from fusion.types import Floats, Ints

MOST_ROUNDS = 20
FARTHEST_M = 2.0
"""No post is moved farther from its rounded height: who takes the nearest one would see it."""
_EQUAL = 1e-9
_MOVES = np.array([move for move in product((-1.0, 0.0, 1.0), repeat=4) if any(move)])


def whole_metres(
    matrix: sparse.csr_matrix, right: Floats, found_m: Floats, base_m: Floats, cells: Ints
) -> Floats:
    """Corrections (n,) near ``found_m`` with which ``base_m`` is whole.

    ``matrix`` (n, n) and ``right``: the normal equations, symmetric. ``cells`` (m, 4): unknowns moved together.
    """
    out = np.floor(base_m + found_m + 0.5) - base_m
    order = np.unique(cells, axis=0)
    i, j = np.repeat(order, 4, axis=1).ravel(), np.tile(order, 4).ravel()
    between = np.asarray(matrix[i, j]).reshape(-1, 4, 4)
    rows = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data
    return np.asarray(out + _move(*rows, between, order, matrix @ out - right, _MOVES))


@compiled
def _best_move(moves: Floats, slope: Floats, between: Floats, moved: Floats) -> int:
    """Which move lowers the misfit most; -1: none. ``slope`` and ``moved`` (4,), ``between`` (4, 4) of the four."""
    best, chosen = -_EQUAL, -1
    for m in range(len(moves)):
        gain, farthest = 0.0, 0.0
        for i in range(4):
            gain += 2.0 * moves[m, i] * slope[i]
            farthest = max(farthest, abs(moved[i] + moves[m, i]))
            for j in range(4):
                gain += moves[m, i] * moves[m, j] * between[i, j]
        if gain < best and farthest <= FARTHEST_M:
            best, chosen = gain, m
    return chosen


@compiled
def _move(
    first: Ints, column: Ints, value: Floats, between: Floats, cells: Ints, gradient: Floats, moves: Floats
) -> Floats:
    """How far each unknown is moved. The matrix is given by its rows; ``gradient`` is that of the misfit, halved."""
    moved, slope, mine = np.zeros(len(gradient)), np.empty(4), np.empty(4)
    changed, rounds = True, 0
    while changed and rounds < MOST_ROUNDS:
        changed, rounds = False, rounds + 1
        for cell in range(len(cells)):
            for i in range(4):
                slope[i], mine[i] = gradient[cells[cell, i]], moved[cells[cell, i]]
            chosen = _best_move(moves, slope, between[cell], mine)
            for i in range(4 if chosen >= 0 else 0):
                changed, row, step = True, cells[cell, i], moves[chosen, i]
                moved[row] += step
                for k in range(first[row], first[row + 1]):
                    gradient[column[k]] += step * value[k]
    return moved
