"""RBPF-DPM: each particle draws the law of every satellite's error from a Polya urn, and runs a Kalman filter under it.

Viandier 2011, 4.3, Algorithm 11. In the literal reading the state is drawn from each Kalman filter's result, the base
measure of line of sight follows the residual as in Table 3.11, and residuals are predicted minus measured (3.5): the
mean that is added to the prediction (4.10) then runs from the truth. The stabilised reading keeps mean and covariance
of each particle, turns the residual's sign, centres line of sight on zero, adds the noise that the C/N0 stands for to
each drawn variance, and lets at least six satellites hold the position (notes 6).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from fusion.gnss.measurements import Measurements
from fusion.gnss.reception import LOS, states_by_epoch
from fusion.published.positioning.dpm import LOS_REAL, NLOS_BASE, BaseMeasure, Urns, draw_all, open_row
from fusion.published.positioning.particles_bank import Bank, Model, ParticleSolver, StateOptions, Step
from fusion.published.positioning.particles_each import correct_each, residuals_each
from fusion.registry import RequestMost
from fusion.types import Bools, Floats, Ints

FEWEST_LOS = 6
"""Satellites that hold the position: a reflected one's law follows its own residual, and holds nothing (notes 6)."""


class RbpfDpmOptions(StateOptions):
    """The reading, the threshold, and the two base measures."""

    los_alpha: float = Field(LOS_REAL.alpha, gt=0)
    """Weight of new draws under line of sight (Table 3.11)."""
    los_k: float = Field(LOS_REAL.k, gt=0)
    """Variance over variance of the mean, line of sight."""
    los_dof: float = Field(LOS_REAL.dof, gt=0)
    """Degrees of freedom of the variance, line of sight."""
    los_scale_m2: float = Field(LOS_REAL.scale_m2, gt=0)
    """Scale of the variance, m2, line of sight."""
    nlos_alpha: float = Field(NLOS_BASE.alpha, gt=0)
    """Weight of new draws under reflection (Table 3.9)."""
    nlos_k: float = Field(NLOS_BASE.k, gt=0)
    """Variance over variance of the mean, reflected."""
    nlos_dof: float = Field(NLOS_BASE.dof, gt=0)
    """Degrees of freedom of the variance, reflected."""
    nlos_scale_m2: float = Field(NLOS_BASE.scale_m2, gt=0)
    """Scale of the variance, m2, reflected."""
    memory: Annotated[int, RequestMost(600)] = Field(600, ge=1, le=10_000)
    """Epochs that an urn remembers (the thesis: all of its 594)."""


class RbpfDpm(ParticleSolver):
    """A Polya urn for each satellite in each particle."""

    name = "rbpf-dpm"
    source = "Viandier 2011, 4.3, Algorithm 11; sound reading: notes 6"
    description = (
        "Particles that draw each satellite's law of errors from a Dirichlet process, by its reception state."
    )
    options_model = RbpfDpmOptions

    def model(self, measured: Measurements, options: RbpfDpmOptions) -> Model:
        """Begin with empty urns."""
        return _Model.of(measured, options)


@dataclass
class _Model(Model):
    """The states of the satellites (m, s), the urns, and the base measures."""

    state: Ints
    urns: Urns
    los: BaseMeasure
    nlos: BaseMeasure
    literal: bool
    cn0_dbhz: Floats

    @classmethod
    def of(cls, measured: Measurements, options: RbpfDpmOptions) -> _Model:
        o, literal = options, options.reading == "literal"
        return cls(
            states_by_epoch(measured, o.threshold_dbhz),
            Urns.empty(min(o.memory, max(len(measured), 1)), len(measured.names), o.particles),
            BaseMeasure(o.los_alpha, o.los_k, o.los_dof, o.los_scale_m2, literal),
            BaseMeasure(o.nlos_alpha, o.nlos_k, o.nlos_dof, o.nlos_scale_m2, True),
            literal,
            measured.cn0_dbhz,
        )

    def correct(self, bank: Bank, step: Step, variance_m2: Floats) -> tuple[Floats, Floats]:
        satellites = step.rows.satellite[step.part]
        direct = self._direct(step, satellites)
        residual = residuals_each(step.rows, step.epoch, bank.means)
        row = step.epoch % len(self.urns.line)
        open_row(self.urns, row)
        centre = -residual if self.literal else residual
        offset, variance = draw_all(self.urns, row, satellites, direct, self.los, self.nlos, centre, bank.rng)
        stated = step.rows.variance_m2[step.part]
        if not self.literal:
            variance = (variance + stated) * step.repeats
        correct_each(step.rows, step.epoch, bank.means, bank.covariances, offset, variance, bank.log_weights)
        if self.literal:
            bank.draw()
        return variance.mean(axis=0), np.where(direct, 0.0, 1.0)

    def _direct(self, step: Step, satellites: Ints) -> Bools:
        """Which of an epoch's rows (r,) count as in line of sight; the strongest ones where too few do."""
        direct = self.state[step.epoch, satellites] == LOS
        if not self.literal and direct.sum() < FEWEST_LOS:
            strength = np.nan_to_num(self.cn0_dbhz[step.part], nan=-1.0)
            direct[np.argsort(-strength, kind="stable")[:FEWEST_LOS]] = True
        return np.asarray(direct)

    def resampled(self, bank: Bank, ancestors: Ints) -> None:
        self.urns.resample(ancestors)
