"""Laws that residuals are held against: normal, Rayleigh, Laplace and mixtures of 2 to 10 normals.

Source: Viandier 2011, section 3.3.2 and annexes A and B. Mixtures are fitted by the expectation-maximisation of the
error models.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from fusion.errors import FusionError
from fusion.gnss.error_models.base import ErrorLaw
from fusion.published.positioning.gmm import FLOOR_M2, fit, start
from fusion.registry import unknown_name
from fusion.types import Floats

LEAST_SAMPLES = 20
"""Fewer say nothing about a law."""
MIXTURES = {f"{j} normals": j for j in range(2, 11)}
LAWS = ("normal", "rayleigh", "laplace", *MIXTURES)
"""What can be fitted, by name."""
_STEPS = 60
_LEAST_SIGMA_M = 1e-4
"""Residuals that are all alike still have a law."""


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
    return _CLOSED[name](float(np.mean(sample)), max(float(np.std(sample)), _LEAST_SIGMA_M))


def _normal(mean: float, sigma: float) -> FittedLaw:
    return FittedLaw(
        "normal",
        2,
        lambda x: np.asarray(ndtr((x - mean) / sigma)),
        lambda p: np.asarray(mean + sigma * ndtri(p)),
    )


def _laplace(mean: float, sigma: float) -> FittedLaw:
    scale = sigma / np.sqrt(2)

    def cdf(x: Floats) -> Floats:
        tail = 0.5 * np.exp(-np.abs(x - mean) / scale)
        return np.asarray(np.where(x < mean, tail, 1.0 - tail))

    def quantile(p: Floats) -> Floats:
        return np.asarray(mean - scale * np.sign(p - 0.5) * np.log1p(-2 * np.abs(p - 0.5)))

    return FittedLaw("laplace", 2, cdf, quantile)


def _rayleigh(mean: float, sigma: float) -> FittedLaw:
    square = mean**2 + sigma**2  # the mean square, which is twice the scale's
    return FittedLaw(
        "rayleigh",
        1,
        lambda x: -np.expm1(-(np.maximum(x, 0.0) ** 2) / square),
        lambda p: np.asarray(np.sqrt(-square * np.log1p(-p))),
    )


_CLOSED = {"normal": _normal, "laplace": _laplace, "rayleigh": _rayleigh}
"""Laws of a mean and a standard deviation. Written out: scipy's objects take longer to make than a window to test."""


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
