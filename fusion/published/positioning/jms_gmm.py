"""JMS-GMM: a mixture of normals for each satellite's residuals of the last 40 seconds, chosen by its reception state.

Viandier 2011, 4.2, Algorithm 10. In the literal reading residuals are predicted minus measured (3.5), the moments of
the window go into every Kalman filter, the state is drawn from each one's result and weighed by (2.31). In the
stabilised reading residuals have the sign that (4.10) needs, a signal in line of sight has the noise that its C/N0
stands for, particles keep mean and covariance, and each draws under which component of the mixture a reflected signal
came: a jump system with its linear part integrated, as the chapter's title has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import Field

from fusion.compiled import compiled
from fusion.gnss.measurements import Measurements
from fusion.gnss.reception import LOS, NLOS, PSEUDO_COUNT, WINDOW_S, smoothed, states_by_epoch
from fusion.published.positioning.gmm import FLOOR_M2, fit, moments
from fusion.published.positioning.gmm import start as spread_out
from fusion.published.positioning.particles_bank import Bank, Model, ParticleSolver, StateOptions, Step
from fusion.published.positioning.particles_each import (
    correct_each,
    log_normal_each,
    residuals_each,
    weigh_each,
)
from fusion.types import Floats, Ints

YOUNG = 10
"""Residuals for each component that a window needs before a mixture is fitted to it; before, its moments serve."""


class JmsGmmOptions(StateOptions):
    """The reading, the window and the mixture."""

    window_s: float = Field(WINDOW_S, gt=0, le=600)
    """How long residuals are kept, s."""
    components: int = Field(2, ge=1, le=10)
    """Normals of the mixture, J."""
    pseudo_count: float = Field(PSEUDO_COUNT, gt=0)
    """Added to each count of transitions."""


class JmsGmm(ParticleSolver):
    """Windows of residuals, mixtures, and a chain of reception states."""

    name = "jms-gmm"
    source = "Viandier 2011, 4.2, Algorithm 10; sound reading: notes 6"
    description = (
        "Particles under a mixture of normals fitted to each satellite's last residuals, by reception state."
    )
    options_model = JmsGmmOptions

    def model(self, measured: Measurements, options: JmsGmmOptions) -> Model:
        """Begin with empty windows."""
        return _Model.of(measured, options)


class Windows(NamedTuple):
    """The last residuals of the satellites: a ring (s, k) of times and values, with where it begins and how many."""

    time_s: Floats
    residual_m: Floats
    head: Ints
    kept: Ints
    mixture: Floats
    """Weights, means and variances (s, 3, j) of the latest fit; weights of 0 before the first."""


@dataclass
class _Model(Model):
    """The chain's states (m, s) and probabilities of reflection (m, s), and the windows."""

    time_s: Floats
    state: Ints
    reflected: Floats
    windows: Windows
    window_s: float
    literal: bool

    @classmethod
    def of(cls, measured: Measurements, options: JmsGmmOptions) -> _Model:
        seen = states_by_epoch(measured, options.threshold_dbhz)
        chains = [
            smoothed(seen[:, s], measured.time_s, options.window_s, options.pseudo_count)
            for s in range(seen.shape[1])
        ]
        known = len(chains)
        # No more epochs than the window holds at the log's shortest step, nor than there are.
        begin = np.searchsorted(measured.time_s, measured.time_s - options.window_s)
        room = int(np.max(np.arange(len(begin)) - begin, initial=0)) + 1
        windows = Windows(
            np.zeros((known, room)), np.zeros((known, room)), np.zeros(known, np.int64), np.zeros(known, np.int64),
            np.zeros((known, 3, options.components)),
        )  # fmt: skip
        state = np.column_stack([chain.state for chain in chains])
        reflected = np.column_stack([chain.probability[:, NLOS] for chain in chains])
        literal = options.reading == "literal"
        return cls(measured.time_s, state, reflected, windows, options.window_s, literal)

    def predict(self, bank: Bank, step: Step) -> None:
        if self.literal:
            self._former = bank.means.copy()
        super().predict(bank, step)

    def correct(self, bank: Bank, step: Step, variance_m2: Floats) -> tuple[Floats, Floats]:
        satellites = step.rows.satellite[step.part]
        residual = residuals_each(step.rows, step.epoch, step.mean[None])[0]
        direct = self.state[step.epoch, satellites] == LOS
        sign = -1.0 if self.literal else 1.0
        now_s, oldest_s = self.time_s[step.epoch], self.time_s[step.epoch] - self.window_s
        push(self.windows, satellites, sign * residual, now_s, oldest_s)
        stated = step.rows.variance_m2[step.part]
        if self.literal:
            offset, variance = printed(self.windows, satellites, direct)
            self._sample(bank, step, offset, variance)
        else:
            offset, variance = draw_components(
                self.windows, satellites, direct, stated, len(bank.means), bank.rng
            )
            variance *= step.repeats
            correct_each(
                step.rows, step.epoch, bank.means, bank.covariances, offset, variance, bank.log_weights
            )
        return variance.mean(axis=0), self.reflected[step.epoch, satellites]

    def _sample(self, bank: Bank, step: Step, offset: Floats, variance: Floats) -> None:
        """Draw each state from its filter's result, and weigh it by (2.31)."""
        unused = np.zeros(len(bank.means))
        correct_each(step.rows, step.epoch, bank.means, bank.covariances, offset, variance, unused)
        proposed = bank.means.copy()
        bank.draw()
        weigh_each(step.rows, step.epoch, bank.means, offset, variance, bank.log_weights)
        bank.log_weights += log_normal_each(bank.means, self._former @ step.moves.T, step.noise[None])
        bank.log_weights -= log_normal_each(bank.means, proposed, bank.covariances)


@compiled
def push(windows: Windows, satellites: Ints, residual_m: Floats, now_s: float, oldest_s: float) -> None:
    """Put an epoch's residuals (r,) of ``satellites`` (r,) into their windows, and drop what is too old."""
    room = windows.time_s.shape[1]
    for j in range(len(satellites)):
        s = satellites[j]
        if not np.isfinite(residual_m[j]):
            continue
        while windows.kept[s] and windows.time_s[s, windows.head[s]] < oldest_s:
            windows.head[s] = (windows.head[s] + 1) % room
            windows.kept[s] -= 1
        place = (windows.head[s] + windows.kept[s]) % room
        windows.time_s[s, place], windows.residual_m[s, place] = now_s, residual_m[j]
        windows.kept[s] += 1


@compiled
def sample_of(windows: Windows, satellite: int) -> Floats:
    """The residuals in a satellite's window, oldest first."""
    count, room = windows.kept[satellite], windows.time_s.shape[1]
    out = np.empty(count)
    for k in range(count):
        out[k] = windows.residual_m[satellite, (windows.head[satellite] + k) % room]
    return out


@compiled
def refit(windows: Windows, satellite: int) -> None:
    """Fit the satellite's mixture to its window, from the latest fit where that is whole."""
    sample = sample_of(windows, satellite)
    mixture = windows.mixture[satellite]
    components = mixture.shape[1]
    if mixture[0].min() < 1.0 / (2 * len(sample)) or len(sample) < YOUNG * components:
        mixture[0], mixture[1], mixture[2] = spread_out(sample, components, FLOOR_M2)
    if len(sample) < YOUNG * components:
        mixture[1], mixture[2] = sample.mean(), max(sample.var(), FLOOR_M2)
    else:
        fit(sample, mixture[0], mixture[1], mixture[2], FLOOR_M2)


@compiled
def printed(windows: Windows, satellites: Ints, direct: Floats) -> tuple[Floats, Floats]:
    """Offsets and variances (1, r) of an epoch's rows as Algorithm 10 prints them."""
    offset, variance = np.zeros((1, len(satellites))), np.zeros((1, len(satellites)))
    for j in range(len(satellites)):
        s = satellites[j]
        if direct[j]:
            sample = sample_of(windows, s)
            offset[0, j], variance[0, j] = sample.mean(), max(sample.var(), FLOOR_M2)
        else:
            refit(windows, s)
            mixture = windows.mixture[s]
            offset[0, j], variance[0, j] = moments(mixture[0], mixture[1], mixture[2])
    return offset, variance


@compiled
def draw_components(
    windows: Windows,
    satellites: Ints,
    direct: Floats,
    stated_m2: Floats,
    particles: int,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Offsets and variances (n, r) of an epoch's rows: 0 and the stated one in line of sight, else a component's.

    To a component's variance the stated one is added: the window's residuals follow the position, and differ less from
    one another than from the truth.
    """
    offset, variance = np.zeros((particles, len(satellites))), np.empty((particles, len(satellites)))
    for j in range(len(satellites)):
        variance[:, j] = stated_m2[j]
        if direct[j]:
            continue
        refit(windows, satellites[j])
        mixture = windows.mixture[satellites[j]]
        for i in range(particles):
            left = rng.random()
            of = 0
            while of < mixture.shape[1] - 1 and left >= mixture[0, of]:
                left -= mixture[0, of]
                of += 1
            offset[i, j] = mixture[1, of]
            variance[i, j] += mixture[2, of]
    return offset, variance
