"""Laws that residuals are held against: normal, Rayleigh, Laplace and mixtures of 2 to 10 normals.

Source: Viandier 2011, section 3.3.2 and annexes A and B. Mixtures are fitted by the expectation-maximisation of the
error models.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from fusion.errors import FusionError
from fusion.gnss.error_models.gmm import FLOOR_M2, fit, start
from fusion.gnss.error_models.law import ErrorLaw
from fusion.registry import unknown_name
from fusion.types import Floats

LEAST_SAMPLES = 20
"""Fewer say nothing about a law."""
MIXTURES = {f"{j} normals": j for j in range(2, 11)}
LAWS = ("normal", "rayleigh", "laplace", *MIXTURES)
"""What can be fitted, by name."""
_STEPS = 60


class TooFewSamplesError(FusionError):
    """A law was to be fitted to a handful of residuals."""


@dataclass(frozen=True)
class FittedLaw:
    """A law with its parameters estimated from a sample; ``parameters`` is how many were."""

    name: str
    parameters: int
    cdf: Callable[[Floats], Floats]
    quantile: Callable[[Floats], Floats]
    """Values (n,) below which a draw lies with probabilities (n,) strictly between 0 and 1."""


def fit_law(name: str, sample: Floats) -> FittedLaw:
    """Estimate a law of ``LAWS`` from a sample (n,), all finite.

    By moments, as the thesis does (its Laplace law of N(0, 1) draws has the rate 1.4 = sqrt 2 / sigma). A Rayleigh law
    knows no negative value. Raises ``UnknownNameError``, and ``TooFewSamplesError`` below 20 values.
    """
    if name not in LAWS:
        raise unknown_name("law", name, LAWS)
    if len(sample) < LEAST_SAMPLES:
        raise TooFewSamplesError(
            f"A law needs {LEAST_SAMPLES} residuals or more, and there are {len(sample)}."
        )
    if name in MIXTURES:
        return _mixture(name, sample)
    mean, sigma = float(np.mean(sample)), max(float(np.std(sample)), float(np.sqrt(FLOOR_M2)) * 1e-3)
    frozen, parameters = {
        "normal": (stats.norm(mean, sigma), 2),
        "rayleigh": (stats.rayleigh(scale=np.sqrt(0.5 * (mean**2 + sigma**2))), 1),
        "laplace": (stats.laplace(mean, sigma / np.sqrt(2)), 2),
    }[name]
    return FittedLaw(name, parameters, frozen.cdf, frozen.ppf)


def _mixture(name: str, sample: Floats) -> FittedLaw:
    components = MIXTURES[name]
    sample = np.ascontiguousarray(sample, np.float64)
    # The floor follows the sample's own scale, so that centimetres are fitted as well as tens of metres.
    floor = min(FLOOR_M2, 1e-3 * max(float(np.var(sample)), 1e-12))
    weight, mean, variance = start(sample, components, floor)
    fit(sample, weight, mean, variance, floor)
    law = ErrorLaw.of_normals(weight / weight.sum(), mean, variance)

    def quantile(probability: Floats) -> Floats:
        """By bisection between bounds outside of which nothing lies."""
        reach = 40.0 * float(np.sqrt(variance.max()))
        low = np.full(np.shape(probability), float(mean.min()) - reach)
        high = np.full(np.shape(probability), float(mean.max()) + reach)
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            below = law.cdf(middle) < probability
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))

    return FittedLaw(name, 3 * components - 1, law.cdf, quantile)
