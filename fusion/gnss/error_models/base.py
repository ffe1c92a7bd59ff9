"""What an error model of pseudoranges is: a series of one satellite in, the law of its errors and its moments out.

Every error model of this room ends in an ``ErrorLaw`` (mixtures of normals, some with an exponential tail to the
right), so that tests of laws, draws and scores of densities know but one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from scipy.special import erfcx, log_ndtr, logsumexp, ndtr

from fusion.options import Described
from fusion.registry import Registry
from fusion.types import Floats, Ints

SMALLEST_SIGMA_M = 1e-3
"""No receiver measures codes better than to a millimetre."""


@dataclass(frozen=True)
class ErrorLaw:
    """Sum of ``weight`` x [N(``mean_m``, ``sigma_m``^2) * Exp(mean ``tail_m``)], (k,) components each.

    ``*`` is the law of the sum of two independent draws; a tail of 0 leaves the normal. Weights sum to one. Raises
    ``ValueError`` for other weights, sigmas under a millimetre and negative tails.
    """

    weight: Floats
    mean_m: Floats
    sigma_m: Floats
    tail_m: Floats

    def __post_init__(self) -> None:
        for spec in fields(self):
            column = np.atleast_1d(np.asarray(getattr(self, spec.name), float))
            if column.shape != np.shape(np.atleast_1d(self.weight)) or not np.isfinite(column).all():
                raise ValueError(f"ErrorLaw.{spec.name} must hold one finite number for each component")
            object.__setattr__(self, spec.name, column)
        if np.any(self.weight < 0) or abs(self.weight.sum() - 1.0) > 1e-9:
            raise ValueError("ErrorLaw.weight must not be negative, and sum to one")
        if np.any(self.sigma_m < SMALLEST_SIGMA_M) or np.any(self.tail_m < 0):
            raise ValueError("ErrorLaw: a sigma is under a millimetre, or a tail negative")

    @classmethod
    def of_normals(cls, weight: Floats, mean_m: Floats, variance_m2: Floats) -> ErrorLaw:
        """A mixture of normals, (k,) each."""
        sigma_m = np.maximum(np.sqrt(np.atleast_1d(variance_m2)), SMALLEST_SIGMA_M)
        return cls(weight, mean_m, sigma_m, np.zeros(np.shape(sigma_m)))

    def log_density(self, error_m: Floats) -> Floats:
        """The logarithm of the density per metre at errors (n,); finite wherever doubles reach."""
        away = np.asarray(error_m, float)[..., None] - self.mean_m
        tailed = self.tail_m > 0
        tail = np.where(tailed, self.tail_m, 1.0)
        plain = -0.5 * (away / self.sigma_m) ** 2 - np.log(self.sigma_m * np.sqrt(2 * np.pi))
        parts = np.where(tailed, _log_tailed(away, self.sigma_m, tail), plain)
        with np.errstate(divide="ignore"):
            return np.asarray(logsumexp(parts + np.log(self.weight), axis=-1))

    def cdf(self, error_m: Floats) -> Floats:
        """The probability of an error of at most each of (n,)."""
        away = np.asarray(error_m, float)[..., None] - self.mean_m
        tailed = self.tail_m > 0
        tail = np.where(tailed, self.tail_m, 1.0)
        beyond = np.where(tailed, tail * np.exp(_log_tailed(away, self.sigma_m, tail)), 0.0)
        return np.asarray(np.sum(self.weight * np.clip(ndtr(away / self.sigma_m) - beyond, 0, 1), axis=-1))

    @property
    def mean(self) -> float:
        """m; for a mixture (3.27)."""
        return float(np.sum(self.weight * (self.mean_m + self.tail_m)))

    @property
    def variance(self) -> float:
        """m2; for a mixture (3.28)."""
        centre = self.mean_m + self.tail_m - self.mean
        return float(np.sum(self.weight * (self.sigma_m**2 + self.tail_m**2 + centre**2)))

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Independent errors (count,), m."""
        which = rng.choice(len(self.weight), count, p=self.weight)
        noise = rng.normal(self.mean_m[which], self.sigma_m[which])
        return np.asarray(noise + self.tail_m[which] * rng.exponential(size=count))


def _log_tailed(away_m: Floats, sigma_m: Floats, tail_m: Floats) -> Floats:
    """The logarithm of the density of N(0, sigma^2) * Exp(mean tail).

    1/tail exp(s^2/2 - away/tail) Phi(away/sigma - s) with s = sigma/tail: left of the bend the exponent and Phi would
    run against each other, so that there the scaled complement of the error function takes both.
    """
    s = sigma_m / tail_m
    bend = (s - away_m / sigma_m) / np.sqrt(2.0)
    left_side = -0.5 * (away_m / sigma_m) ** 2 + np.log(erfcx(np.maximum(bend, 0.0)) / 2.0)
    right = 0.5 * s**2 - away_m / tail_m + log_ndtr(-np.sqrt(2.0) * np.minimum(bend, 0.0))
    return np.asarray(np.where(bend > 0, left_side, right) - np.log(tail_m))


@dataclass(frozen=True)
class Series:
    """Errors of one satellite's pseudorange or residuals for them (measured minus predicted, m), (n,) each.

    ``time_s`` increases; ``state`` is the reception's (``fusion.gnss.reception``), ``cn0_dbhz`` may be NaN. Raises
    ``ValueError`` for other shapes, errors that are not finite, and a series without any.
    """

    time_s: Floats
    error_m: Floats
    state: Ints
    cn0_dbhz: Floats

    def __post_init__(self) -> None:
        shapes = {np.shape(c) for c in (self.time_s, self.error_m, self.state, self.cn0_dbhz)}
        if len(shapes) != 1 or not len(self.error_m) or not np.isfinite(self.error_m).all():
            raise ValueError(
                "a series of errors must hold at least one, all finite, with a time, state and C/N0 each"
            )

    def __len__(self) -> int:
        return len(self.error_m)

    def begins(self, window_s: float) -> Ints:
        """For each epoch the first that lies within ``window_s`` before it, (n,)."""
        return np.searchsorted(self.time_s, self.time_s - window_s)


class ErrorModel(Described, Protocol):
    """A named model of one satellite's errors, by its name in ``ERROR_MODELS``."""

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The law of all errors of a series together."""
        ...

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """Mean (m) and variance (m2) at each epoch, (n,) each, from what was seen up to it and with it."""
        ...


ERROR_MODELS: Registry[ErrorModel] = Registry("error model")
"""The laws by name; filled by ``fusion.catalogue``."""


def share_within(series: Series, mean_m: Floats, variance_m2: Floats, sigmas: float) -> float:
    """The share of epochs whose error lies within mean +- ``sigmas`` x sigma: Table 3.10's score, 0 to 1."""
    return float(np.mean(np.abs(series.error_m - mean_m) <= sigmas * np.sqrt(variance_m2)))
