"""A mixture of normals fitted to the last 40 seconds by expectation and maximisation.

Viandier 2011, 3.3.4.1, Algorithm 12, annex B.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.gnss.error_models.base import ErrorLaw, Series
from fusion.gnss.reception import WINDOW_S
from fusion.types import Floats, Ints

FLOOR_M2 = 0.25**2
"""The least variance of a component: receiver noise of 0.25 m (Table 3.3). Without one, a component that shrinks to a
single sample has an infinite likelihood."""
TOLERANCE = 1e-4
"""The stop of Algorithm 12, whose value is not printed: gain of the mean log-likelihood per sample."""
MOST_STEPS = 100


@dataclass(frozen=True)
class GmmModel:
    """``components`` J and ``window_s`` as the thesis chose them by trial; ``floor_m2`` is a component's variance."""

    components: int = 2
    window_s: float = WINDOW_S
    floor_m2: float = FLOOR_M2
    name = "gmm"
    source = "Viandier 2011, 3.3.4.1, (3.27), (3.28), annex B (B.21)-(B.25)"
    description = "A mixture of two normals, fitted to the last 40 seconds."

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The mixture fitted to the whole series; ``seed`` is not needed."""
        weight, mean, variance = start(np.asarray(series.error_m, float), self.components, self.floor_m2)
        fit(np.asarray(series.error_m, float), weight, mean, variance, self.floor_m2)
        return ErrorLaw.of_normals(weight, mean, variance)

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """Moments (3.27), (3.28) of the mixture of each epoch's window."""
        error_m = np.ascontiguousarray(series.error_m, np.float64)
        return _track(error_m, series.begins(self.window_s), self.components, self.floor_m2)


@compiled
def start(sample: Floats, components: int, floor_m2: float) -> tuple[Floats, Floats, Floats]:
    """Weights, means and variances (j,) to begin with: those of equal parts of the sorted sample (n,), n >= 1."""
    ordered = np.sort(sample)
    n = len(ordered)
    weight = np.full(components, 1.0 / components)
    mean, variance = np.empty(components), np.empty(components)
    for j in range(components):
        low = min(j * n // components, n - 1)
        part = ordered[low : max((j + 1) * n // components, low + 1)]
        mean[j] = part.mean()
        variance[j] = max(part.var(), floor_m2)
    return weight, mean, variance


@compiled
def fit(sample: Floats, weight: Floats, mean: Floats, variance: Floats, floor_m2: float) -> float:
    """Expectation (B.23) and maximisation (B.21), (B.24), (B.25) in place until the likelihood stands still.

    ``sample`` (n,); weights, means, variances (j,). Returns the log-likelihood of the parameters before the last step.
    A component that no sample belongs to keeps its mean and variance, with weight 0.
    """
    n, components = len(sample), len(weight)
    part, sums = np.empty(components), np.empty((components, 3))
    factor = np.empty(components)
    former = -math.inf
    for _ in range(MOST_STEPS):
        likelihood = 0.0
        sums[:] = 0.0
        origin = mean.copy()  # squares are taken about the former mean, so that no digits are lost
        for j in range(components):
            factor[j] = math.log(max(weight[j], 1e-300)) - 0.5 * math.log(2 * math.pi * variance[j])
        for x in sample:
            top = -math.inf
            for j in range(components):
                part[j] = factor[j] - 0.5 * (x - mean[j]) ** 2 / variance[j]
                top = max(top, part[j])
            total = 0.0
            for j in range(components):
                part[j] = math.exp(part[j] - top)
                total += part[j]
            likelihood += top + math.log(total)
            for j in range(components):
                share = part[j] / total
                away = x - origin[j]
                sums[j, 0] += share
                sums[j, 1] += share * away
                sums[j, 2] += share * away * away
        for j in range(components):
            weight[j] = sums[j, 0] / n
            if sums[j, 0] > 1e-9:
                shift = sums[j, 1] / sums[j, 0]
                mean[j] = origin[j] + shift
                variance[j] = max(sums[j, 2] / sums[j, 0] - shift * shift, floor_m2)
        if likelihood - former <= TOLERANCE * n:
            return likelihood
        former = likelihood
    return former


@compiled
def moments(weight: Floats, mean: Floats, variance: Floats) -> tuple[float, float]:
    """Mean (3.27) and variance (3.28) of a mixture of normals, (j,) each."""
    middle, square = 0.0, 0.0
    for j in range(len(weight)):
        middle += weight[j] * mean[j]
    for j in range(len(weight)):
        square += weight[j] * (variance[j] + (mean[j] - middle) ** 2)
    return middle, square


@compiled
def _track(error_m: Floats, begin: Ints, components: int, floor_m2: float) -> tuple[Floats, Floats]:
    n = len(error_m)
    means, variances = np.empty(n), np.empty(n)
    weight, mean, variance = start(error_m[:1], components, floor_m2)
    for t in range(n):
        sample = error_m[begin[t] : t + 1]
        # From the last epoch's fit; where that has lost a component, or is young, from the beginning.
        if weight.min() < 1.0 / (2 * len(sample)) or len(sample) < 10 * components:
            weight, mean, variance = start(sample, components, floor_m2)
        fit(sample, weight, mean, variance, floor_m2)
        means[t], variances[t] = moments(weight, mean, variance)
    return means, variances
