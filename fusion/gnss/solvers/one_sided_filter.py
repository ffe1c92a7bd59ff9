"""The forward pass of the one-sided solver: an extended Kalman filter whose weights follow the one-sided law.

Each epoch is solved three times over, each time with the normal laws that pull as the one-sided law does at the newest
estimate (iterated reweighting about the mode); or once, about a track that is given: the smoother's, so that filter
and smoother in turn come to the most probable track of the whole drive.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.error_models.likelihood import Errors, reflected, variance_at
from fusion.gnss.solvers import one_sided_motion as motions
from fusion.gnss.solvers import state
from fusion.gnss.solvers.one_sided_motion import Motion
from fusion.gnss.solvers.smoother import Pass
from fusion.gnss.solvers.state import CLOCK, DRIFT, Rows
from fusion.types import LONGEST_BRIDGED_OUTAGE_S, Floats

ITERATIONS = 3
ENOUGH_SATELLITES = 4

_STEP_WIDER = 3.0
_LEAST_DIRECT = 0.02
_EARLIEST_SIGMAS = 10.0  # the law has no such errors; a receiver's slips and a filter gone astray do
_SCALE_SIGMA, _SCALE_KNOWN = 0.03, 0.05
_SCALE_TAU_S = 60.0  # an odometer's scale wanders with tyres and turns
_JUMP_M, _JUMP_SPREAD_M = 200.0, 150.0
_FREE_CLOCK_M, _FREE_DRIFT_MPS = 1e5, 300.0
_LOST_M = 1000.0


class Problem(NamedTuple):
    """All that a pass looks at: rows of satellites and what their errors are like, the motion, heights, and limits.

    ``inflation`` (m,) multiplies variances of pseudoranges and heights, ``rate_inflation`` (m,) those of range rates:
    errors of neighbouring epochs are alike. ``rate_wider`` multiplies ``rate_sigma_mps`` while a track is searched.
    ``rate_sigma_mps`` (n,) is NaN where the rate is not used. ``height_m`` (m,) is above the ellipsoid at the height of
    the frame's origin, which falls away from the frame's plane by ``bent_per_m`` (to north, to east) times the square
    of the way.
    """

    rows: Rows
    errors: Errors
    motion: Motion
    rate_sigma_mps: Floats
    height_m: Floats
    height_sigma_m: Floats
    bent_per_m: Floats
    inflation: Floats
    rate_inflation: Floats
    rate_wider: float


@compiled
def forward(problem: Problem, about: Floats, out: Pass) -> None:
    """Fill ``out``. ``about`` (m, n) is the track to linearise at, where it is finite; else the filter's own."""
    epochs, n = out.mean.shape
    mean, covariance = np.zeros(n), np.zeros((n, n))
    running = False
    waited = 0.0
    noise = np.zeros((n, n))
    for k in range(epochs):
        count = problem.rows.first[k + 1] - problem.rows.first[k]
        waited = waited + problem.motion.dt_s[k] if count < ENOUGH_SATELLITES else problem.motion.dt_s[k]
        out.known[k] = out.begins[k] = False
        if not running or waited > LONGEST_BRIDGED_OUTAGE_S:
            running = state.start(problem.rows, k, mean, covariance)
            if not running:
                continue
            motions.begin(problem.motion, k, mean, covariance)
            out.begins[k] = True
        else:
            moves = out.moves[k]
            around = about[k - 1] if np.isfinite(about[k - 1, 0]) else mean
            motions.step(problem.motion, k, around, moves, noise)
            bias = 0.0 if problem.motion.gyro < 0 else around[problem.motion.gyro]
            mean = moves @ mean
            _without_bias(problem.motion.gyro, bias, moves, mean)
            covariance = moves @ covariance @ moves.T + noise
            if _lost(problem, k, mean, covariance):
                other, spread = np.zeros(n), np.zeros((n, n))
                if state.start(problem.rows, k, other, spread):
                    mean, covariance = other, spread
                    motions.begin(problem.motion, k, mean, covariance)
                    out.begins[k] = True
        out.ahead[k], out.ahead_covariance[k] = mean, covariance
        mean, covariance = _correct(problem, k, about[k], mean, covariance)
        out.mean[k], out.covariance[k] = mean, covariance
        out.known[k] = True


@compiled
def _without_bias(gyro: int, bias: float, moves: Floats, mean: Floats) -> None:
    """The transition is taken at a bias already: only what differs from it turns further."""
    if gyro >= 0:
        for i in range(len(mean)):
            if i != gyro:
                mean[i] -= moves[i, gyro] * bias


@compiled
def _lost(problem: Problem, epoch: int, mean: Floats, covariance: Floats) -> bool:
    """Whether the satellites contradict the place by kilometres, so that only a new start helps.

    Where they all agree that only the clock is another, as after a restart of the receiver, it is let free.
    """
    rows = problem.rows
    low, high = rows.first[epoch], rows.first[epoch + 1]
    if high - low <= ENOUGH_SATELLITES:
        return False
    row = np.empty(len(mean))
    off = np.empty(high - low)
    for r in range(low, high):
        off[r - low] = rows.range_m[r] - state.range_row(mean, rows.place_m[r], rows.group[r], row)
    common = np.median(off)
    spread = np.median(np.abs(off - common))
    sigma = np.sqrt(covariance[CLOCK, CLOCK] + covariance[0, 0] + covariance[1, 1] + covariance[2, 2])
    if abs(common) > _JUMP_M + 5 * sigma and spread < _JUMP_SPREAD_M + 3 * sigma:
        mean[CLOCK] += common
        for i in (CLOCK, DRIFT):
            covariance[i, :] = 0.0
            covariance[:, i] = 0.0
        covariance[CLOCK, CLOCK], covariance[DRIFT, DRIFT] = _FREE_CLOCK_M**2, _FREE_DRIFT_MPS**2
        return False
    return bool(spread > _LOST_M + 5 * sigma)


@compiled
def _correct(
    problem: Problem, epoch: int, around: Floats, mean: Floats, covariance: Floats
) -> tuple[Floats, Floats]:
    """The estimate after an epoch's measurements, about ``given`` (n,) or, where that is NaN, about itself."""
    fixed = np.isfinite(around[0])
    at = around.copy() if fixed else mean.copy()
    after, spread = mean, covariance
    wider = problem.rate_wider if fixed else problem.rate_wider * _STEP_WIDER ** (ITERATIONS - 1)
    for _ in range(1 if fixed else ITERATIONS):
        after, spread = mean.copy(), covariance.copy()
        _ranges(problem, epoch, at, after, spread)
        _rates(problem, epoch, at, wider, after, spread)
        _height(problem, epoch, at, after, spread)
        _scale(problem, epoch, at, after, spread)
        at = after.copy()
        wider /= _STEP_WIDER
    return after, spread


@compiled
def _ranges(problem: Problem, epoch: int, at: Floats, mean: Floats, covariance: Floats) -> None:
    """Pseudoranges under the one-sided law. What is early beyond belief is no measurement, and counts for less."""
    rows, errors = problem.rows, problem.errors
    row, gain = np.empty(len(mean)), np.empty(len(mean))
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        error = rows.range_m[r] - state.range_row(at, rows.place_m[r], rows.group[r], row)
        variance = variance_at(error, errors, r) * problem.inflation[epoch]
        if error < 0:
            believed = _EARLIEST_SIGMAS**2 * (errors.variance_m2[r] + np.sum(row * (covariance @ row)))
            variance *= max(1.0, error * error / believed)
        _add(row, error - errors.mode_m[r], variance, at, mean, covariance, gain)


@compiled
def _rates(problem: Problem, epoch: int, at: Floats, wider: float, mean: Floats, covariance: Floats) -> None:
    """Range rates under Cauchy's law, ``wider`` at first: a turn may not look as if all satellites were wrong.

    Those of reflected signals are wrong too, to either side: they count as far as the pseudorange looks direct.
    """
    rows, errors, speed = problem.rows, problem.errors, problem.motion.speed_mps[epoch]
    row, gain = np.empty(len(mean)), np.empty(len(mean))
    moving = at.copy()
    moving[3:6] *= speed
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        sigma = wider * problem.rate_sigma_mps[r]
        if not np.isfinite(sigma):
            continue
        late = rows.range_m[r] - state.range_row(at, rows.place_m[r], rows.group[r], row)
        direct = 1 - reflected(late, errors.share[r], errors.variance_m2[r], errors.delay_m[r])
        error = rows.rate_mps[r] - state.rate_row(moving, rows.place_m[r], rows.speed_mps[r], row)
        row[3:6] *= speed
        variance = 0.5 * (sigma * sigma + error * error) * problem.rate_inflation[epoch]
        variance /= max(direct, _LEAST_DIRECT)
        _add(row, error, variance, at, mean, covariance, gain)


@compiled
def _height(problem: Problem, epoch: int, at: Floats, mean: Floats, covariance: Floats) -> None:
    """A height from outside, under Cauchy's law: the road may be the one above or below."""
    sigma = problem.height_sigma_m[epoch]
    if not (np.isfinite(problem.height_m[epoch]) and sigma > 0):
        return
    row, gain = np.zeros(len(mean)), np.empty(len(mean))
    row[2] = 1.0
    fall = problem.bent_per_m[0] * at[1] ** 2 + problem.bent_per_m[1] * at[0] ** 2
    error = problem.height_m[epoch] - fall - at[2]
    variance = (sigma * sigma + 0.5 * error * error) * problem.inflation[epoch]
    _add(row, error, variance, at, mean, covariance, gain)


@compiled
def _scale(problem: Problem, epoch: int, at: Floats, mean: Floats, covariance: Floats) -> None:
    """The direction's length, the odometer's scale, is about 1: said once a minute, and once it has a direction."""
    if not problem.motion.led[epoch] or covariance[3, 3] + covariance[4, 4] > _SCALE_KNOWN:
        return
    length = np.hypot(at[3], at[4])
    if length < 0.5:
        return
    row, gain = np.zeros(len(mean)), np.empty(len(mean))
    row[3], row[4] = at[3] / length, at[4] / length
    rate = max(1.0, _SCALE_TAU_S / max(problem.motion.dt_s[epoch], 1e-3))
    _add(row, 1.0 - length, _SCALE_SIGMA**2 * rate, at, mean, covariance, gain)


@compiled
def _add(
    row: Floats, error: float, variance: float, at: Floats, mean: Floats, covariance: Floats, gain: Floats
) -> None:
    """One measurement, in place: ``error`` is measured minus predicted at ``at``, ``row`` its derivative there."""
    n = len(mean)
    expected = variance
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += covariance[i, j] * row[j]
        gain[i] = total
        expected += row[i] * total
        error -= row[i] * (mean[i] - at[i])
    step = error / expected
    for i in range(n):
        mean[i] += gain[i] * step
        for j in range(i + 1):
            covariance[i, j] -= gain[i] * gain[j] / expected
            covariance[j, i] = covariance[i, j]
