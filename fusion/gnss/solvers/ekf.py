"""The extended Kalman filter over pseudoranges, range rates and odometer (Viandier 2011, 2.2.2, (4.12)).

Errors of pseudoranges stay for seconds where a street reflects: taken as new at each epoch they would be averaged away
on paper only. Their variance is multiplied by the time that they last over the time between epochs.

What the filter states is not its own covariance alone. It carries how far each satellite's error, had it stayed since
it came, would have moved the state, and adds that for errors as large as the one-sided law expects at their C/N0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from fusion.compiled import compiled
from fusion.filters.kalman import correct_scalar
from fusion.gnss.error_models.one_sided import OneSidedModel
from fusion.gnss.measurements import Aids, Measurements, Solution, SolverOptions
from fusion.gnss.solvers.state import (
    CLOCK,
    VELOCITY,
    Frame,
    Rows,
    cn0_variance,
    process_noise,
    range_row,
    rate_row,
    start,
    states,
    transition,
)
from fusion.types import LONGEST_BRIDGED_OUTAGE_S, Bools, Floats, Progress

FEWEST = 4
"""Satellites that an epoch needs to be taken; below, it is predicted."""
LOST_M = 300.0
"""A horizontal sigma from which on the next good epoch begins the filter anew."""
SURPRISE = 3.0
"""Normalised innovations from which on a pseudorange is taken for less exact than stated, so that it reaches just so
far: beyond three sigmas a normal law says next to nothing (0.3 %)."""
RATE_SIGMA_MPS = 0.2
"""Of a range rate at 45 dB-Hz (notes 6)."""
STANDING_MPS = 0.5
"""Below, an odometer's speed has no direction: both components are near zero."""


class EkfOptions(SolverOptions):
    """What the filter takes, and for how long errors stay."""

    tau_s: float = Field(
        2.0, gt=0, le=60, description="How long the error of a pseudorange lasts, s (notes 6: 2 to 5)."
    )
    doppler: bool = Field(True, description="Take range rates where they are measured.")
    odometer: bool = Field(False, description="Take speed and yaw rate of the vehicle where they are known.")


class VehicleReadings(NamedTuple):
    """What compiled filters run over beside ``Rows``, (m,) each: time, and what the vehicle says of itself."""

    time_s: Floats
    speed_mps: Floats
    speed_sigma_mps: Floats
    yaw_rate_radps: Floats

    @classmethod
    def of(cls, measured: Measurements, aids: Aids, odometer: bool) -> VehicleReadings:
        """With what the vehicle says, or without."""
        unknown = np.full(len(measured), np.nan)
        own = [aids.speed_mps, aids.speed_sigma_mps, aids.yaw_rate_radps] if odometer else [unknown] * 3
        return cls(
            np.ascontiguousarray(measured.time_s, float), *(np.ascontiguousarray(c, float) for c in own)
        )


class Ekf:
    """One normal law of errors, weighted by C/N0 and elevation."""

    name = "ekf"
    source = "Viandier 2011, 2.2.2, Algorithm 3, (4.12); weights and noises: notes 6"
    description = "An extended Kalman filter that takes every error for white noise, by C/N0 and elevation."
    options_model = EkfOptions

    def solve(
        self, measured: Measurements, aids: Aids, options: EkfOptions, seed: int, progress: Progress
    ) -> Solution:
        """Positions of all epochs from the first that can be solved; the seed is not needed."""
        frame = Frame.around(measured)
        rows = frame.rows(measured, cn0_variance(measured.cn0_dbhz, measured.elevation_rad))
        vehicle = VehicleReadings.of(measured, aids, options.odometer)
        unseen = OneSidedModel().second_moment_m2(measured.cn0_dbhz)
        means, covariances, residual, predicted = _run(
            rows, vehicle, unseen, states(measured), len(measured.names), options.tau_s, options.doppler
        )
        progress("positioning", 1.0)
        position, velocity, covariance = frame.to_ecef(means, covariances)
        return Solution(
            position_m=position,
            velocity_mps=velocity,
            covariance=covariance,
            clock_m=means[:, CLOCK],
            nlos=np.full(len(residual), np.nan),
            residual_m=residual,
            predicted=predicted,
        )


@compiled
def _run(
    rows: Rows,
    vehicle: VehicleReadings,
    unseen_m2: Floats,
    n: int,
    satellites: int,
    tau_s: float,
    doppler: bool,
) -> tuple[Floats, Floats, Floats, Bools]:
    """Means (m, n), covariances (m, n, n), residuals of the rows, and which epochs are predicted; NaN where unknown."""
    epochs = len(vehicle.time_s)
    means, covariances = np.full((epochs, n), np.nan), np.full((epochs, n, n), np.nan)
    residuals = np.full(len(rows.range_m), np.nan)
    predicted = np.zeros(epochs, np.bool_)
    mean, covariance = np.zeros(n), np.zeros((n, n))
    moved_by, unseen = np.zeros((n, satellites)), np.zeros(satellites)
    running = False
    for k in range(epochs):
        dt_s = vehicle.time_s[k] - vehicle.time_s[max(k - 1, 0)]
        enough = count_satellites(rows, k) >= FEWEST
        lost = dt_s > LONGEST_BRIDGED_OUTAGE_S or covariance[0, 0] + covariance[1, 1] > LOST_M**2
        if (not running or lost) and enough and start(rows, k, mean, covariance):
            running = True
            moved_by[:] = 0.0
        elif running:
            moves = motion(n, dt_s, vehicle.yaw_rate_radps[k])
            mean, moved_by = moves @ mean, moves @ moved_by
            covariance = moves @ covariance @ moves.T + process_noise(dt_s, n)
            predicted[k] = not enough
            if enough:
                remember(rows, k, unseen_m2, unseen)
                correct_ranges(rows, k, mean, covariance, moved_by, max(tau_s / dt_s, 1.0))
                if doppler:
                    correct_rates(rows, k, mean, covariance, moved_by)
            correct_speed(mean, covariance, moved_by, vehicle.speed_mps[k], vehicle.speed_sigma_mps[k])
        if running:
            means[k], covariances[k] = mean, covariance + (moved_by * unseen) @ moved_by.T
            fill_residuals(rows, k, mean, residuals)
    return means, covariances, residuals, predicted


@compiled
def count_satellites(rows: Rows, epoch: int) -> int:
    """How many pseudoranges an epoch has."""
    return int(np.isfinite(rows.range_m[rows.first[epoch] : rows.first[epoch + 1]]).sum())


@compiled
def motion(n: int, dt_s: float, yaw_rate_radps: float) -> Floats:
    """How the state moves in a time (n, n), its velocity turning clockwise where a yaw rate is known."""
    moves = transition(dt_s, n)
    if np.isfinite(yaw_rate_radps):
        angle = yaw_rate_radps * dt_s
        turn = np.eye(n)
        turn[3, 3] = turn[4, 4] = math.cos(angle)
        turn[3, 4], turn[4, 3] = math.sin(angle), -math.sin(angle)
        moves = turn @ moves
    return moves


@compiled
def remember(rows: Rows, epoch: int, unseen_m2: Floats, unseen: Floats) -> None:
    """Set for the satellites (s,) of an epoch the mean square that their rows' errors are expected to have."""
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        unseen[rows.satellite[r]] = unseen_m2[r]


@compiled
def correct(
    mean: Floats,
    covariance: Floats,
    moved_by: Floats,
    innovation: float,
    row: Floats,
    variance: float,
    by: int,
) -> None:
    """A scalar correction, in place; ``moved_by`` (n, s) follows, with the measurement's own error in column ``by``.

    -1 is for a measurement that no satellite's error is in.
    """
    gain = covariance @ row
    gain /= row @ gain + variance
    along = row @ moved_by
    for a in range(len(mean)):
        for s in range(len(along)):
            moved_by[a, s] -= gain[a] * along[s]
        if by >= 0:
            moved_by[a, by] += gain[a]
    correct_scalar(mean, covariance, innovation, row, variance)


@compiled
def correct_ranges(
    rows: Rows, epoch: int, mean: Floats, covariance: Floats, moved_by: Floats, repeats: float
) -> None:
    """Take an epoch's pseudoranges, in place; each counts as one of ``repeats`` with the same error.

    One that contradicts the prediction is widened. Where half of them do, the prediction is wrong: it is widened.
    """
    begin = rows.first[epoch]
    row = np.zeros(len(mean))
    variance, usual = surprises(rows, epoch, mean, covariance, repeats)
    if usual > SURPRISE**2:
        covariance *= usual
        variance, usual = surprises(rows, epoch, mean, covariance, repeats)
    for j in range(len(variance)):
        r = begin + j
        innovation = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
        if np.isfinite(innovation) and np.isfinite(variance[j]):
            correct(mean, covariance, moved_by, innovation, row, variance[j], rows.satellite[r])


@compiled
def surprises(
    rows: Rows, epoch: int, mean: Floats, covariance: Floats, repeats: float
) -> tuple[Floats, float]:
    """Variances (r,) of an epoch's rows, wider where one contradicts, and the median squared normalised innovation."""
    begin, end = rows.first[epoch], rows.first[epoch + 1]
    row = np.zeros(len(mean))
    variance, square = np.empty(end - begin), np.empty(end - begin)
    for j in range(end - begin):
        r = begin + j
        innovation = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
        variance[j] = rows.variance_m2[r] * repeats
        reach = row @ (covariance @ row)
        square[j] = innovation**2 / (reach + variance[j])
        if square[j] > SURPRISE**2:
            variance[j] = max(variance[j], innovation**2 / SURPRISE**2 - reach)
    return variance, float(np.nanmedian(square))


@compiled
def correct_rates(rows: Rows, epoch: int, mean: Floats, covariance: Floats, moved_by: Floats) -> None:
    """Take an epoch's range rates, in place, with the weight that a Cauchy law gives them at the prediction."""
    row = np.zeros(len(mean))
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        innovation = rows.rate_mps[r] - rate_row(mean, rows.place_m[r], rows.speed_mps[r], row)
        # Noise of rates falls with C/N0 as that of ranges, whose stated variance is 25 m2 at the least.
        variance = RATE_SIGMA_MPS**2 * max(rows.variance_m2[r] / 13.0, 1.0)
        if np.isfinite(innovation) and np.isfinite(variance):
            square = innovation**2 / (variance + row @ covariance @ row)
            correct(mean, covariance, moved_by, innovation, row, variance * (1.0 + square), -1)


@compiled
def correct_speed(
    mean: Floats, covariance: Floats, moved_by: Floats, speed_mps: float, sigma_mps: float
) -> None:
    """Take the speed along the ground, in place; NaN is no speed."""
    if not (np.isfinite(speed_mps) and np.isfinite(sigma_mps)):
        return
    row = np.zeros(len(mean))
    going = math.hypot(mean[VELOCITY], mean[VELOCITY + 1])
    if speed_mps < STANDING_MPS:
        for axis in range(2):
            row[:] = 0.0
            row[VELOCITY + axis] = 1.0
            correct(mean, covariance, moved_by, -mean[VELOCITY + axis], row, STANDING_MPS**2, -1)
    elif going > STANDING_MPS:
        row[VELOCITY], row[VELOCITY + 1] = mean[VELOCITY] / going, mean[VELOCITY + 1] / going
        # The direction is known no better than the velocity: what lies across it counts to the second order.
        across = (
            covariance[3, 3] * row[4] ** 2
            + covariance[4, 4] * row[3] ** 2
            - 2 * covariance[3, 4] * row[3] * row[4]
        )
        variance = sigma_mps**2 + (across / (2 * going)) ** 2
        correct(mean, covariance, moved_by, speed_mps - going, row, variance, -1)


@compiled
def fill_residuals(rows: Rows, epoch: int, mean: Floats, residuals: Floats) -> None:
    """Measured minus predicted of an epoch's rows."""
    row = np.zeros(len(mean))
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        residuals[r] = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
