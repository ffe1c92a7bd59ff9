"""What a log itself tells of its errors, for the one-sided solver: how large, how alike in time, and how common.

Nothing here knows the truth: it looks at the receiver's best C/N0 and at residuals.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.error_models.likelihood import Errors, Law, pull, reflected, variance_at
from fusion.gnss.measurements import Measurements
from fusion.gnss.solvers import state
from fusion.gnss.solvers.one_sided_filter import Problem
from fusion.gnss.solvers.smoother import Pass
from fusion.gnss.solvers.state import BIASES, CLOCK, Rows
from fusion.types import Floats

_BEST_DBHZ = 49.7
"""Of a satellite in the zenith under open sky (Viandier 2011, Table 3.2); the law of notes 6 belongs to it."""
_LOWEST_SHIFT_DB, _HIGHEST_SHIFT_DB = -12.0, 3.0
_CLEAR_SHARE = 0.15  # rows of less are taken for direct signals
_MOST_NOISE = 3.0
_ENOUGH_ROWS = 200
_UNCORRELATED = 0.1
_LONGEST_LAG_S = 30.0
COMMON_M = 4.15
"""Error of a satellite that stays for the drive: clock 1.0, ephemeris 0.45, ionosphere 4.0 and troposphere 0.2 m
(Viandier 2011, Table 3.3: standard deviations after correction, one frequency)."""
_COMMON_MEMORY_S = 15.0
_WIDE_M = 100.0


def receiver_law(measured: Measurements) -> Law:
    """The law for this receiver: C/N0 is counted from its best signals, as antennas and scales differ by decibels."""
    cn0 = measured.cn0_dbhz[np.isfinite(measured.cn0_dbhz)]
    if len(cn0) < _ENOUGH_ROWS:
        return Law()
    shift = float(np.clip(np.percentile(cn0, 95.0) - _BEST_DBHZ, _LOWEST_SHIFT_DB, _HIGHEST_SHIFT_DB))
    return Law(midpoint_dbhz=Law().midpoint_dbhz + shift)


def noise_level(errors: Errors, residual_m: Floats) -> float:
    """How much larger than the law's the noise of direct signals is, 1 to 3: by the middle half of their residuals.

    Never below 1: a fit takes part of the noise into itself.
    """
    clear = (errors.share < _CLEAR_SHARE) & np.isfinite(residual_m)
    if clear.sum() < _ENOUGH_ROWS:
        return 1.0
    scaled = (residual_m - errors.mode_m)[clear] / np.sqrt(errors.variance_m2[clear])
    low, high = np.percentile(scaled, [25, 75])
    return float(np.clip((high - low) / 1.349, 1.0, _MOST_NOISE))


def correlation_s(rows: Rows, errors: Errors, time_s: Floats, residual_m: Floats, least_s: float) -> float:
    """How long errors of a satellite stay alike, s: the integral of the correlation of their pulls, over both sides.

    So many seconds of measurements weigh as one; never below ``least_s``.
    """
    step_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    if not np.isfinite(residual_m).any() or step_s <= 0:
        return least_s
    table = np.full((len(time_s), int(rows.satellite.max()) + 1), np.nan)
    table[np.repeat(np.arange(len(time_s)), np.diff(rows.first)), rows.satellite] = scaled_pulls(
        errors, residual_m
    )
    total = 1.0
    for lag in range(1, min(int(_LONGEST_LAG_S / step_s) + 1, len(table) - 1)):
        both = table[:-lag], table[lag:]
        has_both = np.isfinite(both[0] * both[1])
        size = np.sqrt(np.sum(both[0][has_both] ** 2) * np.sum(both[1][has_both] ** 2))
        alike = np.sum((both[0] * both[1])[has_both]) / size if size > 0 else 0.0
        if alike < _UNCORRELATED:
            break
        total += 2 * alike
    return float(max(least_s, total * step_s))


@compiled
def scaled_pulls(errors: Errors, residual_m: Floats) -> Floats:
    """What each row pulls with, times its noise's sigma, (n,)."""
    pulls = np.full(len(residual_m), np.nan)
    for i in range(len(residual_m)):
        if np.isfinite(residual_m[i]):
            slope = pull(residual_m[i], errors.share[i], errors.variance_m2[i], errors.delay_m[i])
            pulls[i] = slope * np.sqrt(errors.variance_m2[i])
    return pulls


@compiled
def posterior(errors: Errors, residual_m: Floats) -> Floats:
    """Each row's probability of having been reflected, (n,); NaN where it has no residual."""
    late = np.full(len(residual_m), np.nan)
    for i in range(len(residual_m)):
        if np.isfinite(residual_m[i]):
            late[i] = reflected(residual_m[i], errors.share[i], errors.variance_m2[i], errors.delay_m[i])
    return late


@compiled
def residuals(rows: Rows, mean: Floats) -> Floats:
    """Measured minus predicted pseudoranges (n,) on a track (m, n)."""
    off = np.full(len(rows.range_m), np.nan)
    row = np.empty(mean.shape[1])
    for k in range(len(mean)):
        if np.isfinite(mean[k, 0]):
            for r in range(rows.first[k], rows.first[k + 1]):
                off[r] = rows.range_m[r] - state.range_row(mean[k], rows.place_m[r], rows.group[r], row)
    return off


@compiled
def common_errors(problem: Problem, track: Pass, mean: Floats, satellites: int) -> Floats:
    """Covariance (m, 3, 3) of the place by errors that stay with a satellite for the drive, ``COMMON_M`` each.

    No average takes them away. Weighed least squares over the last quarter of a minute spread them to the place as the
    filter does ("consider" states); directions that its satellites do not settle stay bounded.
    """
    rows, errors = problem.rows, problem.errors
    epochs, n = mean.shape
    unknowns = CLOCK - 2 + (n - BIASES)
    spread = np.zeros((epochs, 3, 3))
    pulls, normal, inverse = (
        np.zeros((satellites, unknowns)),
        np.zeros((unknowns, unknowns)),
        np.zeros((unknowns, unknowns)),
    )
    state_row, row = np.empty(n), np.empty(unknowns)
    for k in range(epochs):
        if not track.known[k]:
            continue
        decay = np.exp(-problem.motion.dt_s[k] / _COMMON_MEMORY_S)
        pulls *= decay
        normal *= decay
        for r in range(rows.first[k], rows.first[k + 1]):
            error = rows.range_m[r] - state.range_row(mean[k], rows.place_m[r], rows.group[r], state_row)
            row[:3] = state_row[:3]
            row[3:] = 0.0
            row[3] = 1.0
            if rows.group[r] > 0:
                row[3 + rows.group[r]] = 1.0
            weight = 1 / variance_at(error, errors, r)
            pulls[rows.satellite[r]] += weight * row
            for i in range(unknowns):
                normal[i] += weight * row[i] * row
        prior = normal.copy()
        for i in range(unknowns):
            prior[i, i] += 1 / _WIDE_M**2
        if state.invert(prior, inverse):
            gains = pulls @ inverse
            spread[k] = COMMON_M**2 * (gains.T @ gains)[:3, :3]
    return spread
