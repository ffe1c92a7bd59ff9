"""Rauch, Tung and Striebel's smoother over a stored forward pass of a Kalman filter (1965), compiled.

Runs of epochs that begin anew are smoothed each for itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.solvers.state import invert
from fusion.types import Bools, Floats


class Pass(NamedTuple):
    """A forward pass, (m,) epochs of n numbers: what was predicted, what was estimated, and how it moved there.

    ``moves`` (m, n, n) leads from the epoch before. ``begins`` marks epochs where a run begins; ``known`` those that
    have an estimate.
    """

    ahead: Floats
    ahead_covariance: Floats
    mean: Floats
    covariance: Floats
    moves: Floats
    begins: Bools
    known: Bools


def empty_pass(epochs: int, n: int) -> Pass:
    """Nothing known yet."""
    table, square = np.full((epochs, n), np.nan), np.full((epochs, n, n), np.nan)
    no = np.zeros(epochs, bool)
    return Pass(table, square, table.copy(), square.copy(), np.zeros((epochs, n, n)), no, no.copy())


@compiled
def smooth(forward: Pass) -> tuple[Floats, Floats]:
    """Means (m, n) and covariances (m, n, n) of estimates from the whole run, NaN where none is known.

    Where a predicted covariance has no inverse, the filter's own estimate stays.
    """
    epochs, n = forward.mean.shape
    mean, covariance = forward.mean.copy(), forward.covariance.copy()
    inverse = np.empty((n, n))
    for k in range(epochs - 2, -1, -1):
        after = k + 1
        if not forward.known[k] or not forward.known[after] or forward.begins[after]:
            continue
        if not invert(forward.ahead_covariance[after], inverse):
            continue
        gain = forward.covariance[k] @ forward.moves[after].T @ inverse
        mean[k] += gain @ (mean[after] - forward.ahead[after])
        change = covariance[after] - forward.ahead_covariance[after]
        covariance[k] += gain @ change @ gain.T
        for i in range(n):
            for j in range(i):
                even = 0.5 * (covariance[k, i, j] + covariance[k, j, i])
                covariance[k, i, j] = covariance[k, j, i] = even
    return mean, covariance
