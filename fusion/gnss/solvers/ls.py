"""Each epoch by itself: least squares over its pseudoranges, all alike or weighted (Viandier 2011, 2.2.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.error_models.one_sided import OneSidedModel
from fusion.gnss.measurements import Aids, Measurements, Solution, SolverOptions
from fusion.gnss.solvers.state import BIASES, CLOCK, Frame, Rows, cn0_variance, invert, range_row, states
from fusion.types import Bools, Floats, Ints, Progress

EVEN_SIGMA_M = 5.0
"""The least that an unweighted pseudorange in a town is off by; what the epoch's misfit says is taken where larger."""

_STEPS = 10
_CLOSE_M = 1e-4
_WIDEST_M = 1000.0  # geometry that leaves more gives no position


class LeastSquaresOptions(SolverOptions):
    """Nothing to choose."""


@dataclass(frozen=True)
class LeastSquares:
    """Least squares, ``weighted`` by C/N0 and elevation or not.

    Unknown are the place and one clock for each system with two satellites or more; a single satellite of a system
    beside others says nothing and is left out. An epoch without satellites or geometry enough is NaN.

    The covariance has two parts. One is that of the weights, times the mean square of the normalised residuals where
    these say more, and at least times the median of that over the log: an epoch with few satellites fits itself too
    well. The other is for what residuals cannot show, since the position gives way to it: reflections, by the law of
    the one-sided model, which knows the C/N0 alone.
    """

    weighted: bool
    source = "Viandier 2011, 2.2.1, (2.5), (2.6); weights: notes 6"
    options_model = LeastSquaresOptions

    @property
    def name(self) -> str:
        """``wls`` or ``ls``."""
        return "wls" if self.weighted else "ls"

    @property
    def description(self) -> str:
        """What a person chooses by."""
        how = "weighted by C/N0 and elevation" if self.weighted else "all satellites alike"
        return f"Each epoch by itself, least squares, {how}."

    def solve(
        self, measured: Measurements, aids: Aids, options: LeastSquaresOptions, seed: int, progress: Progress
    ) -> Solution:
        """Positions without velocities; aids and seed are not needed."""
        frame = Frame.around(measured)
        even = np.full(len(measured.satellite), EVEN_SIGMA_M**2)
        variance = cn0_variance(measured.cn0_dbhz, measured.elevation_rad) if self.weighted else even
        unseen = OneSidedModel().second_moment_m2(measured.cn0_dbhz)
        mean, covariance, delays, misfit, residual = _epochs(
            frame.rows(measured, variance), unseen, states(measured), max(len(measured.groups), 1)
        )
        usual = np.nanmedian(misfit) if np.isfinite(misfit).any() else 1.0
        scale = np.maximum(np.where(np.isnan(misfit), usual, misfit), max(usual, 1.0))
        position, velocity, covariance = frame.to_ecef(mean, covariance * scale[:, None, None] + delays)
        solved = np.isfinite(position).all(axis=1)
        covariance[:, 3:] = covariance[:, :, 3:] = velocity[:] = np.nan
        covariance[~solved] = np.nan
        progress("positioning", 1.0)
        return Solution(
            position_m=position,
            velocity_mps=velocity,
            covariance=covariance,
            clock_m=mean[:, CLOCK],
            nlos=np.full(len(residual), np.nan),
            residual_m=residual,
            predicted=np.zeros(len(measured), bool),
            report={"epochs_without_position": int(np.count_nonzero(~solved)), "usual_misfit": float(usual)},
        )


@compiled
def _epochs(
    rows: Rows, unseen_m2: Floats, n: int, groups: int
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Means (m, n), covariances by weights and by ``unseen_m2`` (m, n, n), misfits (m,), residuals of the rows."""
    epochs = len(rows.first) - 1
    means = np.full((epochs, n), np.nan)
    covariances, delays = np.zeros((epochs, n, n)), np.zeros((epochs, n, n))
    misfits = np.full(epochs, np.nan)
    residuals = np.full(len(rows.range_m), np.nan)
    mean = np.zeros(n)
    for k in range(epochs):
        begin, end = rows.first[k], rows.first[k + 1]
        used, clocks = _usable(rows, begin, end, groups)
        unknowns = 3 + clocks.sum()
        count = used.sum()
        if count < unknowns or not _solve(
            rows, unseen_m2, begin, used, clocks, mean, covariances[k], delays[k]
        ):
            mean[:] = 0.0  # the next one begins at the rough place
            continue
        misfit = _misfit(rows, begin, used, mean, residuals)
        if count > unknowns:
            misfits[k] = misfit / (count - unknowns)
        means[k] = mean
        if not clocks[0]:
            means[k, CLOCK:] = np.nan
    return means, covariances, delays, misfits, residuals


@compiled
def _usable(rows: Rows, begin: int, end: int, groups: int) -> tuple[Bools, Bools]:
    """Which rows count, and which groups have a clock: two satellites, or all that there are."""
    used = np.zeros(end - begin, np.bool_)
    count = np.zeros(groups, np.int64)
    for r in range(begin, end):
        used[r - begin] = np.isfinite(rows.range_m[r]) and np.isfinite(rows.variance_m2[r])
        if used[r - begin]:
            count[rows.group[r]] += 1
    clocks = count >= 2
    for r in range(begin, end):
        used[r - begin] &= clocks[rows.group[r]]
    return used, clocks


@compiled
def _solve(
    rows: Rows,
    unseen_m2: Floats,
    begin: int,
    used: Bools,
    clocks: Bools,
    mean: Floats,
    spread: Floats,
    delays: Floats,
) -> bool:
    """Gauss and Newton from ``mean`` (n,); fills it and the place's part of both covariances (n, n).

    Groups without a clock of the reference take its place: the first that has one is the reference then.
    """
    reference = 0
    while not clocks[reference]:
        reference += 1
    unknowns = [0, 1, 2, CLOCK]
    for g in range(reference + 1, len(clocks)):
        if clocks[g]:
            unknowns.append(BIASES + g - 1)
    size = len(unknowns)
    mean[3:] = 0.0
    for _ in range(_STEPS):
        normal, middle, right = _equations(rows, unseen_m2, begin, used, reference, np.array(unknowns), mean)
        inverse = np.empty((size, size))
        if not invert(normal, inverse):
            return False
        change = inverse @ right
        for a in range(size):
            mean[unknowns[a]] += change[a]
        if np.abs(change).max() < _CLOSE_M:
            break
    else:
        return False
    spread[:3, :3] = inverse[:3, :3]
    delays[:3, :3] = (inverse @ middle @ inverse)[:3, :3]
    return bool(max(inverse[0, 0], inverse[1, 1], inverse[2, 2]) <= _WIDEST_M**2)


@compiled
def _equations(
    rows: Rows, unseen_m2: Floats, begin: int, used: Bools, reference: int, unknowns: Ints, mean: Floats
) -> tuple[Floats, Floats, Floats]:
    """H'PH (2.6), H'P V P H with V of ``unseen_m2``, and H'P residual, for the ``known`` (j,) places of the state."""
    size = len(unknowns)
    normal, middle, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    row = np.zeros(len(mean))
    for j in range(len(used)):
        if not used[j]:
            continue
        r = begin + j
        group = rows.group[r] if rows.group[r] != reference else 0
        residual = rows.range_m[r] - range_row(mean, rows.place_m[r], group, row)
        for a in range(size):
            weighed = row[unknowns[a]] / rows.variance_m2[r]
            right[a] += weighed * residual
            for b in range(size):
                normal[a, b] += weighed * row[unknowns[b]]
                middle[a, b] += weighed * row[unknowns[b]] * unseen_m2[r] / rows.variance_m2[r]
    return normal, middle, right


@compiled
def _misfit(rows: Rows, begin: int, used: Bools, mean: Floats, residuals: Floats) -> float:
    """The sum of the squares of the normalised residuals; the residuals themselves are filled in."""
    row = np.zeros(len(mean))
    total = 0.0
    for j in range(len(used)):
        if used[j]:
            r = begin + j
            residuals[r] = rows.range_m[r] - range_row(mean, rows.place_m[r], rows.group[r], row)
            total += residuals[r] ** 2 / rows.variance_m2[r]
    return total
