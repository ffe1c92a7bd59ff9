"""A reflected path is only ever longer: noise, and with a probability by C/N0 an exponential delay (notes 6, ours)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fusion.gnss.error_models.base import ErrorLaw, Series
from fusion.gnss.error_models.likelihood import Law
from fusion.types import Floats


@dataclass(frozen=True)
class OneSidedModel:
    """(1 - p) N(0, s2) + p [N(0, s2) * Exp(mean delay)], p and s2 by C/N0 as ``rule`` has them."""

    rule: Law = field(default_factory=Law)
    name = "one-sided"
    source = "this work, notes 6"
    description = "Noise and, the more often the weaker the signal, a delay that is never negative."

    def at(self, cn0_dbhz: float) -> ErrorLaw:
        """The law of an error at a C/N0, dB-Hz or NaN."""
        cn0 = np.array([cn0_dbhz])
        reflected, sigma = float(self.reflected(cn0)[0]), float(np.sqrt(self.rule.variance(cn0)[0]))
        delays = np.array([0.0, self.rule.delay_m])
        return ErrorLaw(np.array([1.0 - reflected, reflected]), np.zeros(2), np.full(2, sigma), delays)

    def reflected(self, cn0_dbhz: Floats) -> Floats:
        """The probability (n,) of a reflection at each C/N0 before the pseudorange is seen."""
        return self.rule.share(np.asarray(cn0_dbhz, float))

    def second_moment_m2(self, cn0_dbhz: Floats) -> Floats:
        """The mean square (n,) of an error at each C/N0, its delay with it: what it may be off by, unknown its side."""
        cn0_dbhz = np.asarray(cn0_dbhz, float)
        return self.rule.variance(cn0_dbhz) + self.rule.share(cn0_dbhz) * 2 * self.rule.delay_m**2

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The laws of the series's values of C/N0, each as often as it comes; ``seed`` is not needed."""
        values, counts = np.unique(np.round(series.cn0_dbhz), return_counts=True)
        laws = [self.at(float(value)) for value in values]
        share = np.repeat(counts / counts.sum(), 2)
        columns = [np.concatenate([getattr(law, c) for law in laws]) for c in ("mean_m", "sigma_m", "tail_m")]
        return ErrorLaw(share * np.concatenate([law.weight for law in laws]), *columns)

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """The moments by each epoch's C/N0 alone."""
        values, which = np.unique(series.cn0_dbhz, return_inverse=True)
        laws = [self.at(float(value)) for value in values]
        return np.array([law.mean for law in laws])[which], np.array([law.variance for law in laws])[which]
