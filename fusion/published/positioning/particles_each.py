"""Compiled loops over particles: each is moved, corrected, weighed or drawn, with the measurements of one epoch.

Particles have a mean (N, n) and a covariance (N, n, n); offsets and variances of an epoch's r rows have shape (N, r),
or (1, r) for all particles alike.
"""

from __future__ import annotations

import math

import numpy as np

from fusion.compiled import compiled
from fusion.filters.kalman import correct_scalar
from fusion.gnss.solvers.ekf import correct
from fusion.gnss.solvers.state import Rows, range_row
from fusion.types import Floats


@compiled
def predict_each(means: Floats, covariances: Floats, moves: Floats, noise: Floats) -> None:
    """Move each particle, in place."""
    for i in range(len(means)):
        means[i] = moves @ means[i]
        covariances[i] = moves @ covariances[i] @ moves.T + noise


@compiled
def correct_each(
    rows: Rows,
    epoch: int,
    means: Floats,
    covariances: Floats,
    offset_m: Floats,
    variance_m2: Floats,
    log_weights: Floats,
) -> None:
    """Correct each particle by an epoch's pseudoranges, in place, and weigh it by how well it foretold them.

    Each row's error has the mean ``offset_m`` and ``variance_m2``, (N, r), or (1, r) for all alike. Taken one after
    another, their densities multiply to that of all together.
    """
    begin = rows.first[epoch]
    row = np.zeros(means.shape[1])
    for i in range(len(means)):
        mean, covariance = means[i], covariances[i]
        of = min(i, len(offset_m) - 1)
        for j in range(rows.first[epoch + 1] - begin):
            r = begin + j
            innovation = (
                rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row) - offset_m[of, j]
            )
            variance = variance_m2[of, j]
            if np.isfinite(innovation) and np.isfinite(variance):
                total = row @ (covariance @ row) + variance
                log_weights[i] -= 0.5 * (innovation**2 / total + math.log(total))
                correct_scalar(mean, covariance, innovation, row, variance)


@compiled
def weigh_each(
    rows: Rows, epoch: int, means: Floats, offset_m: Floats, variance_m2: Floats, log_weights: Floats
) -> None:
    """Add log p(z | x) of an epoch's pseudoranges at each particle's mean; arguments as for ``correct_each``."""
    begin = rows.first[epoch]
    row = np.zeros(means.shape[1])
    for i in range(len(means)):
        of = min(i, len(offset_m) - 1)
        for j in range(rows.first[epoch + 1] - begin):
            r = begin + j
            away = (
                rows.range_m[r] - range_row(means[i], rows.place_m[r], rows.group[r], row) - offset_m[of, j]
            )
            variance = variance_m2[of, j]
            if np.isfinite(away) and np.isfinite(variance):
                log_weights[i] -= 0.5 * (away**2 / variance + math.log(variance))


@compiled
def residuals_each(rows: Rows, epoch: int, means: Floats) -> Floats:
    """Measured minus predicted of an epoch's rows for each of (N, n) means, (N, r)."""
    begin, end = rows.first[epoch], rows.first[epoch + 1]
    row = np.zeros(means.shape[1])
    out = np.empty((len(means), end - begin))
    for i in range(len(means)):
        for r in range(begin, end):
            out[i, r - begin] = rows.range_m[r] - range_row(means[i], rows.place_m[r], rows.group[r], row)
    return out


@compiled
def draw_each(means: Floats, covariances: Floats, rng: np.random.Generator) -> None:
    """Draw each particle from its normal, in place; the covariances stay."""
    n = means.shape[1]
    draw = np.empty(n)
    for i in range(len(means)):
        scale = np.sqrt(np.maximum(np.diag(covariances[i]), 1e-12))
        # Scaled to a diagonal of ones, with a hair more: a covariance may be at its rank's edge by rounding.
        root = np.linalg.cholesky(covariances[i] / scale / scale.reshape(-1, 1) + 1e-9 * np.eye(n))
        for a in range(n):
            draw[a] = rng.standard_normal()
        means[i] += scale * (root @ draw)


@compiled
def log_normal_each(places: Floats, means: Floats, covariances: Floats) -> Floats:
    """The logarithm of each normal's density (N,) at places (N, n), but for the constant of 2 pi."""
    out = np.empty(len(places))
    for i in range(len(places)):
        covariance = covariances[min(i, len(covariances) - 1)]
        scale = np.sqrt(np.diag(covariance))
        root = np.linalg.cholesky(covariance / scale / scale.reshape(-1, 1) + 1e-9 * np.eye(len(scale)))
        away = np.linalg.solve(root, (places[i] - means[i]) / scale)
        out[i] = -0.5 * (away @ away) - np.log(np.diag(root)).sum() - np.log(scale).sum()
    return out


@compiled
def follow(
    rows: Rows, epoch: int, mean: Floats, shadow: Floats, moved_by: Floats, variance_m2: Floats
) -> None:
    """Let ``shadow`` (n, n), a covariance beside the particles, and ``moved_by`` (n, s) go through an epoch's rows."""
    row = np.zeros(len(mean))
    unmoved = mean.copy()
    begin = rows.first[epoch]
    for j in range(len(variance_m2)):
        r = begin + j
        range_row(mean, rows.place_m[r], rows.group[r], row)
        if np.isfinite(rows.range_m[r]) and np.isfinite(variance_m2[j]):
            correct(unmoved, shadow, moved_by, 0.0, row, variance_m2[j], rows.satellite[r])
