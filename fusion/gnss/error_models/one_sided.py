"""A reflected path is only ever longer: noise, and with a probability by C/N0 an exponential delay (notes 6, ours)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.gnss.error_models.base import Series
from fusion.gnss.error_models.law import ErrorLaw
from fusion.types import Floats

UNKNOWN_CN0_DBHZ = 30.0
"""What a signal is taken to have that comes without C/N0: most receivers give none below (Viandier 2011, 3.2.1.4)."""


@dataclass(frozen=True)
class OneSidedModel:
    """(1 - p) N(0, s2) + p [N(0, s2) * Exp(mean ``delay_m``)], p = 1 / (1 + exp((C/N0 - ``even_dbhz``) / slope)).

    s2 = ``near_m``^2 + ``noise_m``^2 10^((45 - C/N0) / 10). All values are of notes 6, fixed beforehand.
    """

    delay_m: float = 30.0
    even_dbhz: float = 40.0
    slope_db: float = 3.0
    near_m: float = 2.0
    noise_m: float = 1.5
    name = "one-sided"
    source = "this work, notes 6"
    description = "Noise and, the more often the weaker the signal, a delay that is never negative."

    def at(self, cn0_dbhz: float) -> ErrorLaw:
        """The law of an error at a C/N0; NaN is taken for a weak signal."""
        cn0_dbhz = UNKNOWN_CN0_DBHZ if np.isnan(cn0_dbhz) else cn0_dbhz
        reflected = float(self.reflected(np.array([cn0_dbhz]))[0])
        sigma = np.sqrt(self.near_m**2 + self.noise_m**2 * 10 ** ((45.0 - cn0_dbhz) / 10.0))
        zero = np.zeros(2)
        return ErrorLaw(
            np.array([1.0 - reflected, reflected]), zero, zero + sigma, np.array([0.0, self.delay_m])
        )

    def reflected(self, cn0_dbhz: Floats) -> Floats:
        """The probability (n,) of a reflection at each C/N0 before the pseudorange is seen."""
        return np.asarray(
            1.0 / (1.0 + np.exp((np.asarray(cn0_dbhz, float) - self.even_dbhz) / self.slope_db))
        )

    def second_moment_m2(self, cn0_dbhz: Floats) -> Floats:
        """The mean square (n,) of an error at each C/N0, its delay with it: what it may be off by, unknown its side."""
        cn0_dbhz = np.where(np.isnan(cn0_dbhz), UNKNOWN_CN0_DBHZ, cn0_dbhz)
        noise = self.near_m**2 + self.noise_m**2 * 10 ** ((45.0 - cn0_dbhz) / 10.0)
        return np.asarray(noise + self.reflected(cn0_dbhz) * 2 * self.delay_m**2)

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The laws of the series's values of C/N0, each as often as it comes; ``seed`` is not needed."""
        values, counts = np.unique(np.round(series.cn0_dbhz), return_counts=True)
        laws = [self.at(float(value)) for value in values]
        share = np.repeat(counts / counts.sum(), 2)
        columns = [np.concatenate([getattr(law, c) for law in laws]) for c in ("mean_m", "sigma_m", "tail_m")]
        return ErrorLaw(share * np.concatenate([law.weight for law in laws]), *columns)

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """The moments by each epoch's C/N0 alone."""
        laws = {value: self.at(value) for value in np.unique(series.cn0_dbhz).tolist()}
        if np.isnan(series.cn0_dbhz).any():
            laws = {**laws, UNKNOWN_CN0_DBHZ: self.at(UNKNOWN_CN0_DBHZ)}
        known = np.where(np.isnan(series.cn0_dbhz), UNKNOWN_CN0_DBHZ, series.cn0_dbhz).tolist()
        return np.array([laws[c].mean for c in known]), np.array([laws[c].variance for c in known])
