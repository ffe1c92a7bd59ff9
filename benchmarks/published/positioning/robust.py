"""Robust estimators from the literature, on the same measurements with the same motion as ``one-sided``.

Only the model of errors differs: each turns residuals into weights (and offsets), and the same Kalman filter or
smoother is run about the track before, ten times, thrice of them with Huber's weights. A filter's weights come from its
own estimates, a smoother's from the whole drive.
Nominal variances are those of notes 6 for WLS, EKF and Huber, inflated by the same correlation in time.

Huber 1964; Cauchy and Geman-McClure as in Zhang 1997 (c for 95 % efficiency; 1); dynamic covariance scaling: Agarwal et
al. 2013 (phi 1); max-mixture: Olson & Agarwal 2012 (a tenth of the weight on ten times the sigma); self-tuning
mixture: Pfeifer & Protzel 2019 (three Gaussians by EM over a sliding minute).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fusion.gnss.error_models.likelihood import Errors
from fusion.gnss.measurements import Aids, Measurements
from fusion.gnss.solvers import state
from fusion.gnss.solvers.one_sided import OneSidedOptions, problem_of
from fusion.gnss.solvers.one_sided_filter import forward
from fusion.gnss.solvers.one_sided_learning import residuals
from fusion.gnss.solvers.smoother import empty_pass, smooth
from fusion.types import Floats

ROUNDS, BEGUN = 10, 3
WINDOW_S, RENEWED_S = 60.0, 5.0
_COMPONENTS, _EM_ROUNDS = 3, 15

Weights = Callable[[Floats], Floats]
"""From residuals in sigmas (n,) to weights (n,)."""


def _max_mixture(u: Floats) -> Floats:
    """Of the two components, the one that is denser there."""
    wide = 10.0
    narrow = np.log(0.9) - 0.5 * u**2
    return np.where(narrow >= np.log(0.1 / wide) - 0.5 * (u / wide) ** 2, 1.0, wide**-2)


ESTIMATORS: dict[str, Weights | None] = {
    "gaussian": np.ones_like,
    "huber": lambda u: np.minimum(1.0, 1.345 / np.maximum(np.abs(u), 1e-9)),
    "cauchy": lambda u: 1 / (1 + (u / 2.3849) ** 2),
    "geman-mcclure": lambda u: 1 / (1 + u**2) ** 2,
    "dcs": lambda u: np.minimum(1.0, 2 / (1 + u**2)) ** 2,
    "max-mixture": _max_mixture,
    "self-tuning": None,
}


def track(
    measured: Measurements, aids: Aids, name: str, smoothed: bool, odometer: bool
) -> tuple[Floats, Floats]:
    """ECEF places (m, 3) and their covariances (m, 3, 3) by the estimator of a name."""
    frame = state.Frame.around(measured)
    options = OneSidedOptions(odometer=odometer, smooth=smoothed)
    problem, n = problem_of(frame, measured, aids, options)
    variance = state.cn0_variance(measured.cn0_dbhz, measured.elevation_rad)
    ranges = problem.rows.range_m
    out = empty_pass(len(measured), n)
    mean, covariance = np.full_like(out.mean, np.nan), np.full_like(out.covariance, np.nan)
    weights, offset = np.ones(len(ranges)), np.zeros(len(ranges))
    for turn in range(ROUNDS):
        rows = problem.rows._replace(range_m=ranges - offset)
        forward(problem._replace(rows=rows, errors=_normal(variance / weights)), mean, out)
        mean, covariance = smooth(out) if smoothed else (out.mean.copy(), out.covariance.copy())
        off = residuals(problem.rows, mean)
        # Laws with several optima begin from Huber's, which has one.
        weigh = ESTIMATORS["huber" if name not in ("gaussian", "huber") and turn < BEGUN else name]
        if weigh is None:
            weights, offset = _self_tuned(measured, off, variance, smoothed)
        else:
            weights = np.maximum(weigh(np.nan_to_num(off) / np.sqrt(variance)), 1e-6)
    position, _, spread = frame.to_ecef(mean, covariance)
    return position, spread[:, :3, :3]


def single_points(measured: Measurements) -> Floats:
    """ECEF places (m, 3): each epoch by itself, with the weights that RTKLIB gives to codes of one frequency.

    Its variance grows as 1 + 1 / sin2(elevation), the same for all C/N0 (``varerr`` in pntpos). The measurements are
    corrected already, so that RTKLIB's own program, which wants ephemerides, cannot be fed with them.
    """
    frame = state.Frame.around(measured)
    sine = np.sin(np.clip(measured.elevation_rad, np.radians(5.0), np.pi / 2))
    rows = frame.rows(measured, 1 + 1 / sine**2)
    n = state.states(measured)
    places = np.full((len(measured), 3), np.nan)
    for k in range(len(measured)):
        low, high = rows.first[k], rows.first[k + 1]
        mean = np.zeros(n)
        table, off = np.zeros((high - low, n)), np.zeros(high - low)
        for _ in range(8):
            for i, r in enumerate(range(low, high)):
                off[i] = rows.range_m[r] - state.range_row(mean, rows.place_m[r], rows.group[r], table[i])
            root = 1 / np.sqrt(rows.variance_m2[low:high])
            used = np.flatnonzero(np.abs(table).sum(axis=0) > 0)
            if high - low < len(used) or not len(used):
                break
            mean[used] += np.linalg.lstsq(table[:, used] * root[:, None], off * root, rcond=None)[0]
        else:
            places[k] = mean[:3]
    return np.asarray(frame.origin_m + places @ frame.axes)


def _normal(variance_m2: Floats) -> Errors:
    """Normal laws as the one-sided one has them: nothing is reflected."""
    nothing = np.zeros(len(variance_m2))
    return Errors(nothing, np.ascontiguousarray(variance_m2), np.full(len(variance_m2), 30.0), nothing)


def _self_tuned(
    measured: Measurements, off: Floats, variance: Floats, smoothed: bool
) -> tuple[Floats, Floats]:
    """Weights and offsets of a mixture that is fitted to the last minute, or for a smoother to that around."""
    time_s = measured.time_s[measured.epoch]
    weights, offset = np.ones(len(off)), np.zeros(len(off))
    for begin in np.arange(time_s[0], time_s[-1] + RENEWED_S, RENEWED_S):
        now = (time_s >= begin) & (time_s < begin + RENEWED_S)
        middle = begin + RENEWED_S / 2
        low, high = (
            (middle - WINDOW_S / 2, middle + WINDOW_S / 2)
            if smoothed
            else (begin + RENEWED_S - WINDOW_S, begin + RENEWED_S)
        )
        residuals = off[(time_s >= low) & (time_s < high) & np.isfinite(off)]
        if now.any() and len(residuals) >= 30:
            weights[now], offset[now] = _mixture(residuals, np.nan_to_num(off[now]))
            weights[now] *= variance[now]  # as a share of the nominal information
    return np.maximum(weights, 1e-6), offset


def _mixture(residuals: Floats, at: Floats) -> tuple[Floats, Floats]:
    """EM on residuals; information (1/m2) and offset (m) at others. The first Gaussian keeps the mean 0."""
    share = np.full(_COMPONENTS, 1 / _COMPONENTS)
    mean, sigma = np.array([0.0, 10.0, 40.0]), np.array([3.0, 15.0, 40.0])

    def belong(values: Floats) -> Floats:
        log = np.log(share) - np.log(sigma) - 0.5 * ((values[:, None] - mean) / sigma) ** 2
        dense = np.exp(log - log.max(axis=1, keepdims=True))
        return np.asarray(dense / dense.sum(axis=1, keepdims=True))

    for _ in range(_EM_ROUNDS):
        part = belong(residuals)
        count = part.sum(axis=0) + 1.0
        share = count / count.sum()
        mean = np.where(np.arange(_COMPONENTS) > 0, (part * residuals[:, None]).sum(axis=0) / count, 0.0)
        total = (part * (residuals[:, None] - mean) ** 2).sum(axis=0)
        sigma = np.sqrt((total + 4.0) / count)
        sigma = np.maximum(sigma, 1.0)
    part = belong(at) / sigma**2
    information = part.sum(axis=1)
    return information, (part * mean).sum(axis=1) / information
