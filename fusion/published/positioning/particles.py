"""Particle filters under one normal law of errors: bootstrap, and FPLL with a Kalman filter's proposal.

Viandier 2011, 2.2.3: Algorithms 4 to 8. Both are for comparison: nine unknowns are many for two hundred points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fusion.gnss.measurements import Measurements
from fusion.published.positioning.particles_bank import Bank, Model, ParticleOptions, ParticleSolver, Step
from fusion.published.positioning.particles_each import correct_each, draw_each, weigh_each
from fusion.types import Floats, Ints


class ParticleFilterOptions(ParticleOptions):
    """Which proposal draws the particles."""

    proposal: Literal["bootstrap", "fpll"] = "fpll"
    """bootstrap: the motion alone (Algorithm 7). fpll: a Kalman step by the epoch (Algorithm 8)."""
    regularised: bool = True
    """Draw particles apart after resampling (Algorithm 6)."""


class ParticleFilter(ParticleSolver):
    """Points that are moved, weighed and drawn again."""

    name = "pf"
    source = "Viandier 2011, 2.2.3, Algorithms 6, 7 and 8"
    description = (
        "A particle filter that takes every error for white noise; proposes blindly, or by a Kalman step."
    )
    options_model = ParticleFilterOptions

    def model(self, measured: Measurements, options: ParticleFilterOptions) -> Model:
        """By the proposal."""
        return (_Fpll if options.proposal == "fpll" else _Bootstrap)(options.regularised)


@dataclass(frozen=True)
class _Bootstrap(Model):
    """Proposes by the motion, weighs by the measurements."""

    smooth: bool
    scattered = True
    literal = False

    def predict(self, bank: Bank, step: Step) -> None:
        super().predict(bank, step)
        bank.scatter()

    def correct(self, bank: Bank, step: Step, variance_m2: Floats) -> tuple[Floats, Floats]:
        unbiased = np.zeros((1, len(variance_m2)))
        weigh_each(step.rows, step.epoch, bank.means, unbiased, variance_m2[None], bank.log_weights)
        return variance_m2, np.full(len(variance_m2), np.nan)

    def resampled(self, bank: Bank, ancestors: Ints) -> None:
        if self.smooth:
            regularise(bank)


class _Fpll(_Bootstrap):
    """Proposes by motion and measurements, from the particle's point."""

    def predict(self, bank: Bank, step: Step) -> None:
        Model.predict(self, bank, step)

    def correct(self, bank: Bank, step: Step, variance_m2: Floats) -> tuple[Floats, Floats]:
        unbiased, variance = np.zeros((1, len(variance_m2))), variance_m2[None]
        correct_each(
            step.rows, step.epoch, bank.means, bank.covariances, unbiased, variance, bank.log_weights
        )
        bank.scatter()
        return variance_m2, np.full(len(variance_m2), np.nan)


def regularise(bank: Bank) -> None:
    """Draw copies apart, in place, without making the cloud wider (Algorithm 6).

    The thesis gives no width. Taken is the best one for a normal law, (4 / (N (n + 2)))^(1 / (n + 4)) of the cloud's
    covariance (Silverman 1986), and the cloud is drawn together by as much first (West 1993).
    """
    count, n = bank.means.shape
    width = min((4.0 / (count * (n + 2))) ** (1.0 / (n + 4)), 1.0)
    mean, covariance, _ = bank.estimate()
    bank.means[:] = mean + np.sqrt(1.0 - width**2) * (bank.means - mean)
    draw_each(bank.means, np.broadcast_to(width**2 * covariance, (count, n, n)).copy(), bank.rng)
