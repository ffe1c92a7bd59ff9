"""The state that recursive solvers carry, in a local frame: how it moves, what it predicts, how it begins and ends.

State of n = 8 + (groups - 1) numbers: east, north, up (m, from ``Measurements.rough_m``); their velocities (m/s); clock
of the reference group (m) and its drift (m/s); one bias (m) for each further group. The frame is ECEF shifted and
turned, so ranges in it are exact; its axes are those at the rough place. All but ``Frame`` runs inside compiled loops.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.frames import local_axes
from fusion.gnss.measurements import Measurements
from fusion.types import Floats, Ints

VELOCITY, CLOCK, DRIFT, BIASES = 3, 6, 7, 8
"""Where the parts of the state begin; the place begins at 0."""

HORIZONTAL_M2PS3, VERTICAL_M2PS3 = 1.0, 0.02
CLOCK_M2PS, DRIFT_M2PS3, BIAS_M2PS = 0.1, 1.0, 1e-4
"""Spectral densities of the noises that move velocity, clock, drift and biases: notes 6, fixed beforehand."""

_START_VELOCITY_MPS = np.array([15.0, 15.0, 1.0])  # a car in a town
_START_DRIFT_MPS = 300.0  # of an uncompensated crystal: 1 ppm
_START_BIAS_M = 1000.0  # between systems: hardware delays and scales of time stay below 3 us
_START_WIDER_M = 10.0  # a first epoch's errors may agree with one another
_WIDEST_START_M = 300.0  # geometry that leaves more is no place to begin at
_SENSELESS = 500.0  # mean square, in sigmas: a place that its satellites deny by a hundred metres and more
_START_STEPS, _LINEAR_STEPS = 15, 6
_LEAST_PIVOT = 1e-13
"""Of a matrix scaled to a diagonal of ones: below, what is there and rounding cannot be told apart."""


class Rows(NamedTuple):
    """Measurements as compiled loops take them: in the local frame, with a variance for each pseudorange."""

    first: Ints
    satellite: Ints
    group: Ints
    range_m: Floats
    rate_mps: Floats
    variance_m2: Floats
    place_m: Floats
    speed_mps: Floats
    """Of the satellites, (n, 3)."""


@dataclass(frozen=True)
class Frame:
    """East, north and up about a place: ``origin_m`` (3,) in ECEF, rows of ``axes`` (3, 3) the three directions."""

    origin_m: Floats
    axes: Floats

    @classmethod
    def around(cls, measured: Measurements) -> Frame:
        """The frame of a drive."""
        return cls(np.asarray(measured.rough_m, float), local_axes(measured.rough_m[None])[0])

    def rows(self, measured: Measurements, variance_m2: Floats) -> Rows:
        """The measurements in this frame; ``variance_m2`` (n,) as ``cn0_variance`` has it, or any other."""
        # Copies: views and arrays that may not be written to would be compiled for once more.
        return Rows(
            np.array(measured.first, np.int64),
            np.array(measured.satellite, np.int64),
            np.array(measured.group, np.int64),
            np.array(measured.pseudorange_m, float),
            np.array(measured.range_rate_mps, float),
            np.array(variance_m2, float),
            np.array((measured.satellite_m - self.origin_m) @ self.axes.T, order="C"),
            np.array(measured.satellite_mps @ self.axes.T, order="C"),
        )

    def to_ecef(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats, Floats]:
        """ECEF place (m, 3), velocity (m, 3) and covariance (m, 6, 6) of local means (m, >= 6), (m, >= 6, >= 6)."""
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = self.axes
        return (
            self.origin_m + mean[:, :3] @ self.axes,
            mean[:, 3:6] @ self.axes,
            np.asarray(turn.T @ covariance[:, :6, :6] @ turn),
        )


def states(measured: Measurements) -> int:
    """How many numbers the state has."""
    return BIASES + max(len(measured.groups) - 1, 0)


def cn0_variance(cn0_dbhz: Floats, elevation_rad: Floats) -> Floats:
    """Variance of a pseudorange (n,), m2, for solvers that know one law of errors only (notes 6: WLS, EKF, Huber).

    Unknown C/N0 counts as 35 dB-Hz, unknown elevation as 30 degrees; below 5 degrees the sine grows no smaller.
    """
    cn0 = np.where(np.isfinite(cn0_dbhz), cn0_dbhz, 35.0)
    elevation = np.where(np.isfinite(elevation_rad), elevation_rad, np.radians(30.0))
    sine = np.sin(np.clip(elevation, np.radians(5.0), np.pi / 2))
    return np.asarray((2.0**2 + 3.0**2 * 10 ** ((45.0 - cn0) / 10)) / sine)


@compiled
def transition(dt_s: float, n: int) -> Floats:
    """How the state moves in a time when nothing disturbs it, (n, n)."""
    moves = np.eye(n)
    for axis in range(3):
        moves[axis, VELOCITY + axis] = dt_s
    moves[CLOCK, DRIFT] = dt_s
    return moves


@compiled
def process_noise(dt_s: float, n: int) -> Floats:
    """Covariance (n, n) of what disturbs the state in a time: white accelerations, a clock of two noises, drifting
    biases."""
    noise = np.zeros((n, n))
    third, half = dt_s**3 / 3, dt_s**2 / 2
    for axis in range(3):
        density = HORIZONTAL_M2PS3 if axis < 2 else VERTICAL_M2PS3
        velocity = VELOCITY + axis
        noise[axis, axis] = density * third
        noise[axis, velocity] = noise[velocity, axis] = density * half
        noise[velocity, velocity] = density * dt_s
    noise[CLOCK, CLOCK] = CLOCK_M2PS * dt_s + DRIFT_M2PS3 * third
    noise[CLOCK, DRIFT] = noise[DRIFT, CLOCK] = DRIFT_M2PS3 * half
    noise[DRIFT, DRIFT] = DRIFT_M2PS3 * dt_s
    for bias in range(BIASES, n):
        noise[bias, bias] = BIAS_M2PS * dt_s
    return noise


@compiled
def range_row(mean: Floats, place_m: Floats, group: int, row: Floats) -> float:
    """Predicted pseudorange (m) of a satellite at ``place_m`` (3,); ``row`` (n,) becomes its derivative."""
    east, north, up = place_m[0] - mean[0], place_m[1] - mean[1], place_m[2] - mean[2]
    distance = np.sqrt(east * east + north * north + up * up)
    row[:] = 0.0
    row[0], row[1], row[2] = -east / distance, -north / distance, -up / distance
    row[CLOCK] = 1.0
    predicted = distance + mean[CLOCK]
    if group > 0:
        row[BIASES + group - 1] = 1.0
        predicted += mean[BIASES + group - 1]
    return float(predicted)


@compiled
def rate_row(mean: Floats, place_m: Floats, speed_mps: Floats, row: Floats) -> float:
    """Predicted range rate (m/s) and, in ``row`` (n,), its derivative by velocity and drift.

    That by the place is left out: a hundred metres turn the sight by so little that the rate changes by 2 cm/s.
    """
    east, north, up = place_m[0] - mean[0], place_m[1] - mean[1], place_m[2] - mean[2]
    distance = np.sqrt(east * east + north * north + up * up)
    row[:] = 0.0
    row[3], row[4], row[5] = -east / distance, -north / distance, -up / distance
    row[DRIFT] = 1.0
    predicted = mean[DRIFT]
    for axis in range(3):
        predicted -= row[VELOCITY + axis] * (speed_mps[axis] - mean[VELOCITY + axis])
    return float(predicted)


@compiled
def start(rows: Rows, epoch: int, mean: Floats, covariance: Floats) -> bool:
    """Begin at an epoch, by least squares with Huber's weights; ``mean`` (n,) and ``covariance`` (n, n) are filled.

    False, and nothing is known, where satellites or geometry do not suffice, or no place fits them. The covariance
    grows with the misfit of the epoch. Velocity and drift come from range rates where there are any, else from what a
    car may do.
    """
    n = len(mean)
    mean[:] = 0.0
    prior = np.zeros(n)
    prior[BIASES:] = _START_BIAS_M**-2
    if not _solve(rows, epoch, False, prior, mean, covariance):
        return False
    if _misfit(rows, epoch, mean, 1e4) > _SENSELESS:
        return False
    misfit = _misfit(rows, epoch, mean, 1e2)
    covariance *= max(1.0, misfit)
    for axis in range(3):
        covariance[axis, axis] += _START_WIDER_M**2
    speeds = mean.copy()
    spread = np.zeros((n, n))
    prior[:] = 0.0
    prior[VELOCITY:CLOCK] = _START_VELOCITY_MPS**-2
    prior[DRIFT] = _START_DRIFT_MPS**-2
    if not _solve(rows, epoch, True, prior, speeds, spread):
        return False
    mean[VELOCITY:CLOCK], mean[DRIFT] = speeds[VELOCITY:CLOCK], speeds[DRIFT]
    for i in (3, 4, 5, 7):
        for j in (3, 4, 5, 7):
            covariance[i, j] = spread[i, j]
    return bool(np.isfinite(mean).all())


@compiled
def _solve(rows: Rows, epoch: int, of_rates: bool, prior: Floats, mean: Floats, covariance: Floats) -> bool:
    """Robust least squares for place, clock and biases, or for velocity and drift; information ``prior`` (n,)."""
    n = len(mean)
    states = np.array([i for i in range(n) if (i in (3, 4, 5, 7)) == of_rates])
    centre = mean.copy()
    inverse = np.zeros((len(states), len(states)))
    for step in range(_START_STEPS):
        normal, right = np.diag(prior), prior * (centre - mean)
        # Linear first: from a rough place all residuals are large.
        _add_rows(rows, epoch, of_rates, step >= _LINEAR_STEPS, mean, normal, right)
        part, aim = np.empty((len(states), len(states))), np.empty(len(states))
        for a in range(len(states)):
            aim[a] = right[states[a]]
            for b in range(len(states)):
                part[a, b] = normal[states[a], states[b]]
        if not invert(part, inverse):
            return False
        for a in range(len(states)):
            mean[states[a]] += np.sum(inverse[a] * aim)
    covariance[:, :] = 0.0
    for a in range(len(states)):
        for b in range(len(states)):
            covariance[states[a], states[b]] = inverse[a, b]
    return bool(max(covariance[0, 0], covariance[1, 1], covariance[2, 2]) <= _WIDEST_START_M**2)


@compiled
def _add_rows(
    rows: Rows, epoch: int, of_rates: bool, robust: bool, mean: Floats, normal: Floats, right: Floats
) -> None:
    """Add an epoch's rows to the normal equations ``normal`` (n, n), ``right`` (n,), about ``mean``."""
    row = np.zeros(len(mean))
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        variance = rows.variance_m2[r]
        if of_rates:
            residual = rows.rate_mps[r] - rate_row(mean, rows.place_m[r], rows.speed_mps[r], row)
            variance *= 0.1**2  # m2/s2 to m2: rough, and needed for the start only
        else:
            residual = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
        if not np.isfinite(residual) or not np.isfinite(variance):
            continue
        weight = 1 / variance
        if robust:  # Huber's, which has one optimum only
            weight /= max(1.0, abs(residual) / np.sqrt(variance))
        right += weight * residual * row
        for i in range(len(row)):
            if row[i] != 0.0:
                for j in range(len(row)):
                    normal[i, j] += weight * row[i] * row[j]


@compiled
def invert(matrix: Floats, inverse: Floats) -> bool:
    """Fill ``inverse`` (k, k) of a symmetric positive matrix, by way of a diagonal of ones and Cholesky's factor.

    False where it has none but for rounding.
    """
    k = len(matrix)
    scale, lower = np.empty(k), np.zeros((k, k))
    if not _factor(matrix, scale, lower):
        return False
    for column in range(k):  # the factor's own inverse, in its place
        lower[column, column] = 1 / lower[column, column]
        for i in range(column + 1, k):
            total = 0.0
            for c in range(column, i):
                total -= lower[i, c] * lower[c, column]
            lower[i, column] = total / lower[i, i]
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            for c in range(i, k):
                total += lower[c, i] * lower[c, j]
            inverse[i, j] = inverse[j, i] = total * scale[i] * scale[j]
    return True


@compiled
def _factor(matrix: Floats, scale: Floats, lower: Floats) -> bool:
    """Cholesky's factor ``lower`` (k, k) of a matrix scaled by ``scale`` (k,) to a diagonal of ones."""
    k = len(matrix)
    for i in range(k):
        if not matrix[i, i] > 0.0 or not np.isfinite(matrix[i, i]):
            return False
        scale[i] = 1 / np.sqrt(matrix[i, i])
    for j in range(k):
        for i in range(j, k):
            total = matrix[i, j] * scale[i] * scale[j]
            for c in range(j):
                total -= lower[i, c] * lower[j, c]
            if i > j:
                lower[i, j] = total / lower[j, j]
            elif total > _LEAST_PIVOT:
                lower[j, j] = np.sqrt(total)
            else:
                return False
    return True


@compiled
def _misfit(rows: Rows, epoch: int, mean: Floats, most: float) -> float:
    """Mean square of the normalised residuals, per redundant row; each counts for at most ``most``."""
    row = np.zeros(len(mean))
    total, count = 0.0, 0
    for r in range(rows.first[epoch], rows.first[epoch + 1]):
        residual = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
        if np.isfinite(residual):
            total += min(residual * residual / rows.variance_m2[r], most)
            count += 1
    return total / max(count - 4, 1)
