"""What the particle solvers share: particles with a mean and a covariance each, and the round from epoch to epoch.

A solver brings one step: what an epoch with satellites enough does to predicted particles. Start, outages, resampling,
the estimate and its covariance are here.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from fusion.filters.resampling import RESAMPLERS, normalised
from fusion.gnss.error_models.one_sided import OneSidedModel
from fusion.gnss.measurements import Aids, Measurements, Solution, SolverOptions
from fusion.gnss.reception import THRESHOLDS_DBHZ
from fusion.gnss.solvers.ekf import (
    FEWEST,
    LOST_M,
    SURPRISE,
    correct_ranges,
    count_satellites,
    fill_residuals,
    motion,
    remember,
    surprises,
)
from fusion.gnss.solvers.state import CLOCK, Frame, Rows, cn0_variance, process_noise, start, states
from fusion.published.positioning.particles_each import draw_each, follow, predict_each
from fusion.published.threads import at_most_threads
from fusion.registry import RequestMost
from fusion.types import LONGEST_BRIDGED_OUTAGE_S, Floats, Ints, Progress

SETTLE_S = 5.0
"""How long one Kalman filter runs before particles are drawn from it: a clock's drift that may be anything within 300
m/s is no cloud of two hundred points."""


class ParticleOptions(SolverOptions):
    """What all particle solvers take."""

    particles: Annotated[int, RequestMost(2000)] = Field(200, ge=2, le=100_000)
    """Number of particles N."""
    resampling: Literal["multinomial", "residual", "stratified", "systematic"] = "systematic"
    """Scheme of resampling."""
    eta: float = Field(0.7, gt=0, le=1)
    """Resampled where fewer than eta N particles count (0.6 to 0.8)."""
    tau_s: float = Field(2.0, gt=0, le=60)
    """How long the error of a pseudorange lasts, s (notes 6: 2 to 5)."""


class StateOptions(ParticleOptions):
    """Of filters that go by the state of reception: the reading, and the threshold."""

    reading: Literal["stabilised", "literal"] = "stabilised"
    """stabilised, or literal: as printed, to see what happens."""
    threshold_dbhz: float = Field(THRESHOLDS_DBHZ["u-blox"], ge=0, le=60)
    """C/N0 from which on a signal is direct: 40 u-blox, 42 PolaRx2."""


@dataclass
class Bank:
    """Means (N, n), covariances (N, n, n) and log weights (N,) of the particles, and who draws."""

    means: Floats
    covariances: Floats
    log_weights: Floats
    rng: np.random.Generator

    def estimate(self) -> tuple[Floats, Floats, Floats]:
        """Mean (n,) and covariance (n, n) of the particles' mixture, and their weights (N,)."""
        if not (np.isfinite(self.log_weights).all() and np.isfinite(self.means).all()):
            raise np.linalg.LinAlgError("the particles have left what numbers can hold")
        weights = normalised(self.log_weights)
        mean = weights @ self.means
        away = self.means - mean
        spread = np.tensordot(weights, self.covariances, 1) + (away * weights[:, None]).T @ away
        return mean, spread, weights

    def fill(self, mean: Floats, covariance: Floats) -> None:
        """All particles at one place, with one covariance."""
        self.means[:], self.covariances[:], self.log_weights[:] = mean, covariance, 0.0

    def draw(self) -> None:
        """Draw each particle from its own normal, and keep the normal's covariance."""
        draw_each(self.means, self.covariances, self.rng)

    def scatter(self) -> None:
        """Draw each particle from its own normal; what it did not know is in the cloud then."""
        self.draw()
        self.covariances[:] = 0.0


@dataclass(frozen=True)
class Step:
    """An epoch that particles are to be corrected by: its number, and the time (s) since the one before.

    ``repeats`` is how many epochs share one error of a pseudorange. ``mean`` (n,) is the particles' predicted one.
    """

    rows: Rows
    epoch: int
    dt_s: float
    repeats: float
    moves: Floats
    noise: Floats
    mean: Floats

    @property
    def part(self) -> slice:
        """The epoch's rows."""
        return slice(int(self.rows.first[self.epoch]), int(self.rows.first[self.epoch + 1]))


class Model(ABC):
    """What tells particle solvers apart. Particles that are ``scattered`` are points; else each keeps its covariance.

    Particles are spread anew where an epoch contradicts all of them, but for a ``literal`` reading.
    """

    scattered = False
    literal: bool

    def predict(self, bank: Bank, step: Step) -> None:
        """Move the particles to the epoch; called for epochs without satellites too."""
        predict_each(bank.means, bank.covariances, step.moves, step.noise)

    @abstractmethod
    def correct(self, bank: Bank, step: Step, variance_m2: Floats) -> tuple[Floats, Floats]:
        """Correct and weigh; returns the variances (r,) that the epoch's rows had, and their NLOS probabilities.

        ``variance_m2`` (r,) are those of a single normal law, wider where a row contradicts the particles.
        """

    def resampled(self, bank: Bank, ancestors: Ints) -> None:  # noqa: B027 (most models hold nothing to copy)
        """Particles were replaced by copies of ``ancestors`` (N,)."""


@dataclass
class _Round:
    """The state of a run, epoch by epoch."""

    rows: Rows
    bank: Bank
    model: Model
    options: ParticleOptions
    seed: int
    moved_by: Floats
    unseen: Floats
    shadow: Floats
    since_s: float = math.nan
    """How long the particles have been running; NaN before."""

    def begin(self, k: int) -> bool:
        """Start anew at an epoch, if it can be."""
        n = self.bank.means.shape[1]
        mean, covariance = np.zeros(n), np.zeros((n, n))
        if not start(self.rows, k, mean, covariance):
            return False
        self.bank.fill(mean, covariance)
        self.moved_by[:], self.shadow[:], self.since_s = 0.0, covariance, 0.0
        return True

    def epoch(
        self, k: int, time_s: Floats, unseen_m2: Floats, enough: bool
    ) -> tuple[Floats, Floats, Floats] | None:
        """Begin, begin anew or go on; None as long as nothing is known."""
        dt_s = float(time_s[k] - time_s[max(k - 1, 0)])
        lost = dt_s > LONGEST_BRIDGED_OUTAGE_S or np.trace(self.shadow[:2, :2]) > LOST_M**2
        if (math.isnan(self.since_s) or lost) and enough and self.begin(k):
            return *self.bank.estimate()[:2], np.full(self.rows.first[k + 1] - self.rows.first[k], np.nan)
        return None if math.isnan(self.since_s) else self.go_on(k, dt_s, unseen_m2, enough)

    def go_on(self, k: int, dt_s: float, unseen_m2: Floats, enough: bool) -> tuple[Floats, Floats, Floats]:
        """Predict and, where there are satellites, correct; returns the estimate, and the rows' NLOS probabilities."""
        n = self.bank.means.shape[1]
        moves, noise = motion(n, dt_s, math.nan), process_noise(dt_s, n)
        repeats = max(self.options.tau_s / dt_s, 1.0)
        step = Step(self.rows, k, dt_s, repeats, moves, noise, moves @ self.bank.estimate()[0])
        nlos = np.full(step.part.stop - step.part.start, np.nan)
        self.moved_by[:] = moves @ self.moved_by
        self.shadow[:] = moves @ self.shadow @ moves.T + noise
        former, self.since_s = self.since_s, self.since_s + dt_s
        if former < SETTLE_S:
            self._settle(step, enough)
        else:
            self.model.predict(self.bank, step)
            if enough:
                remember(self.rows, k, unseen_m2, self.unseen)
                nlos = self._correct(step)
        mean, covariance, weights = self.bank.estimate()
        if former >= SETTLE_S and 1.0 / (weights @ weights) < self.options.eta * len(weights):
            self._resample(weights, k)
        return mean, covariance + (self.moved_by * self.unseen) @ self.moved_by.T, nlos

    def _settle(self, step: Step, enough: bool) -> None:
        """One Kalman filter's epoch; at the end of its time, particles are drawn from it."""
        covariance = step.moves @ self.bank.covariances[0] @ step.moves.T + step.noise
        self._take(step, step.mean.copy(), covariance, enough)
        if self.since_s >= SETTLE_S and self.model.scattered:
            self.bank.scatter()

    def _take(self, step: Step, mean: Floats, covariance: Floats, enough: bool) -> None:
        if enough:
            correct_ranges(step.rows, step.epoch, mean, covariance, self.moved_by, step.repeats)
        self.bank.fill(mean, covariance)
        self.shadow[:] = covariance

    def _correct(self, step: Step) -> Floats:
        mean, covariance, _ = self.bank.estimate()
        variance, usual = surprises(step.rows, step.epoch, mean, covariance, step.repeats)
        if usual > SURPRISE**2 and not self.model.literal:
            # All particles are contradicted: points cannot find back by themselves, a Kalman filter widens and does.
            self._take(step, mean, covariance, True)
            self.since_s = 0.0
            return np.full(len(variance), np.nan)
        used, nlos = self.model.correct(self.bank, step, variance)
        follow(step.rows, step.epoch, step.mean, self.shadow, self.moved_by, used)
        return nlos

    def _resample(self, weights: Floats, k: int) -> None:
        ancestors = RESAMPLERS[self.options.resampling](weights, self.seed, k)
        bank = self.bank
        bank.means[:], bank.covariances[:] = bank.means[ancestors], bank.covariances[ancestors]
        bank.log_weights[:] = 0.0
        self.model.resampled(bank, ancestors)


class ParticleSolver(ABC):
    """A solver by particles; its model tells it from the others."""

    @abstractmethod
    def model(self, measured: Measurements, options: Any) -> Model:
        """What epochs do to the particles of a drive."""

    def solve(
        self, measured: Measurements, aids: Aids, options: Any, seed: int, progress: Progress
    ) -> Solution:
        """Positions of all epochs from the first that can be solved; aids are not needed."""
        return _run(measured, self.model(measured, options), options, seed, progress)


def _run(
    measured: Measurements, model: Model, options: ParticleOptions, seed: int, progress: Progress
) -> Solution:
    frame = Frame.around(measured)
    # Rows have the variance that solvers of one law give pseudoranges (notes 6).
    rows = frame.rows(measured, cn0_variance(measured.cn0_dbhz, measured.elevation_rad))
    n, count = states(measured), options.particles
    bank = Bank(np.zeros((count, n)), np.zeros((count, n, n)), np.zeros(count), np.random.default_rng(seed))
    names = len(measured.names)
    state = _Round(rows, bank, model, options, seed, np.zeros((n, names)), np.zeros(names), np.zeros((n, n)))
    unseen = OneSidedModel().second_moment_m2(measured.cn0_dbhz)
    means, covariances = np.full((len(measured), n), np.nan), np.full((len(measured), n, n), np.nan)
    residual, nlos = np.full(len(rows.range_m), np.nan), np.full(len(rows.range_m), np.nan)
    predicted = np.zeros(len(measured), bool)
    restarts = 0
    # Some hundred particles are too few to share out: threads that wait for one another cost more than they save.
    with at_most_threads(1):
        for k in range(len(measured)):
            part = slice(int(rows.first[k]), int(rows.first[k + 1]))
            enough = count_satellites(rows, k) >= FEWEST
            try:
                known = state.epoch(k, measured.time_s, unseen, enough)
            except np.linalg.LinAlgError:  # what a literal reading may come to: it begins anew
                state.since_s, known = math.nan, None
                restarts += 1
            if known is not None:
                means[k], covariances[k], nlos[part] = known
                predicted[k] = not enough
            fill_residuals(rows, k, means[k], residual)
            if k % 64 == 0:
                progress("positioning", k / len(measured))
    progress("positioning", 1.0)
    position, velocity, covariance = frame.to_ecef(means, covariances)
    return Solution(
        position, velocity, covariance, means[:, CLOCK], nlos, residual, predicted, {"restarts": restarts}
    )
