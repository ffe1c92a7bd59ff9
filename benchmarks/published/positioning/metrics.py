"""Positions against a truth: errors, availability, times up and down, and whether ellipses tell the truth.

Source: Viandier 2011, section 4.5.1. An epoch without a position counts as unavailable, and in no mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from fusion.frames import local_axes
from fusion.gnss.measurements import Solution
from fusion.types import Bools, Floats

THRESHOLDS_M = (3.0, 5.0, 10.0)
UP_M = 5.0
"""3-D error up to which the thesis calls positioning available in MUT, MDT and MTBF."""
ELLIPSE = 0.95
"""Probability of the ellipses whose coverage is counted."""


@dataclass(frozen=True)
class PositionMetrics:
    """What errors come to: metres, seconds, shares 0 to 1; NaN where there is nothing to count.

    ``within_2d`` and ``within_3d`` are shares of all epochs with an error of at most 3, 5 and 10 m. ``mut_s`` is the
    mean length of a run of epochs below 5 m in 3-D, ``mdt_s`` of a run above it or without position, ``mtbf_s`` their
    sum. ``coverage_2d`` and ``coverage_3d`` are the shares of true positions within the 95 % ellipses, of the epochs
    whose covariance is known.
    """

    epochs: int
    solved: int
    mean_2d_m: float
    median_2d_m: float
    p95_2d_m: float
    mean_3d_m: float
    median_3d_m: float
    p95_3d_m: float
    within_2d: tuple[float, float, float]
    within_3d: tuple[float, float, float]
    mut_s: float
    mdt_s: float
    mtbf_s: float
    coverage_2d: float
    coverage_3d: float


def errors_enu_m(position_m: Floats, truth_m: Floats) -> Floats:
    """East, north and up (m, 3) of ECEF places minus the truth's; NaN where one of them is not known."""
    out = np.full(np.shape(truth_m), np.nan)
    known = np.isfinite(position_m).all(axis=1) & np.isfinite(truth_m).all(axis=1)
    if known.any():
        away = position_m[known] - truth_m[known]
        out[known] = np.einsum("nij,nj->ni", local_axes(truth_m[known]), away)
    return out


def position_metrics(time_s: Floats, solution: Solution, truth_m: Floats) -> PositionMetrics:
    """Compare a solution with true ECEF places (m, 3) at ``time_s`` (m,). Epochs without a truth are left out.

    Raises ``ValueError`` where no epoch has a truth.
    """
    judged = np.isfinite(truth_m).all(axis=1)
    if not judged.any():
        raise ValueError("no epoch has a true position: there is nothing to compare with")
    enu = errors_enu_m(solution.position_m, truth_m)[judged]
    flat, space = np.hypot(enu[:, 0], enu[:, 1]), np.linalg.norm(enu, axis=1)
    mut, mdt = up_and_down_s(time_s[judged], space <= UP_M)
    solved = np.isfinite(space)
    horizontal, spatial = coverage(enu, truth_m[judged], solution.covariance[judged])
    return PositionMetrics(
        len(enu),
        int(solved.sum()),
        *_middle(flat[solved]),
        *_middle(space[solved]),
        _within(flat),
        _within(space),
        mut,
        mdt,
        mut + mdt,
        horizontal,
        spatial,
    )


def _middle(error_m: Floats) -> tuple[float, float, float]:
    """Mean, median and 95 % quantile."""
    if not len(error_m):
        return np.nan, np.nan, np.nan
    return float(error_m.mean()), float(np.median(error_m)), float(np.quantile(error_m, 0.95))


def _within(error_m: Floats) -> tuple[float, float, float]:
    three, five, ten = (float(np.mean(error_m <= limit)) for limit in THRESHOLDS_M)
    return three, five, ten


def up_and_down_s(time_s: Floats, up: Bools) -> tuple[float, float]:
    """Mean time up (MUT) and mean time down (MDT) of a series; NaN where it is never so.

    An epoch lasts until the next; the last one as long as is usual.
    """
    step = np.diff(time_s)
    lasts = np.append(step, np.median(step) if len(step) else 1.0)
    begins = np.flatnonzero(np.concatenate([[True], up[1:] != up[:-1]]))
    length, state = np.add.reduceat(lasts, begins), up[begins]
    mut, mdt = (float(length[state == s].mean()) if np.any(state == s) else np.nan for s in (True, False))
    return mut, mdt


def coverage(enu_m: Floats, truth_m: Floats, covariance: Floats) -> tuple[float, float]:
    """Shares of errors (m, 3) within the 95 % ellipse (2-D) and ellipsoid (3-D) of covariances (m, >= 3, >= 3), ECEF.

    A covariance that is not positive counts as a miss; one that is NaN is left out.
    """
    axes = local_axes(truth_m)
    local = axes @ covariance[:, :3, :3] @ np.swapaxes(axes, 1, 2)
    known = np.isfinite(enu_m).all(axis=1) & np.isfinite(local).all(axis=(1, 2))
    if not known.any():
        return np.nan, np.nan
    horizontal, spatial = (_covered(enu_m[known, :d], local[known, :d, :d], d) for d in (2, 3))
    return horizontal, spatial


def _covered(error_m: Floats, covariance: Floats, dimensions: int) -> float:
    sigma2, axes = np.linalg.eigh(covariance)
    sound = sigma2[:, 0] > 0
    along = np.einsum("nji,nj->ni", axes, error_m)
    distance = np.sum(along**2 / np.where(sound[:, None], sigma2, 1.0), axis=1)
    return float(np.mean(sound & (distance <= chi2.ppf(ELLIPSE, dimensions))))
