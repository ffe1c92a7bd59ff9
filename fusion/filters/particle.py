"""Particle filters for any model: SIS and SIR of Al Assaad 2020, sections 1.4.3.2 and 1.4.3.3, in plain numpy.

The loop over the epochs is the caller's; ``ParticleFilter.step`` is one pass through it. The trigger ``never`` makes it
Algorithm SIS, any other Algorithm SIR. The method ``particle`` runs a compiled cloud of its own with the same parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.filters.resampling import RESAMPLERS, normalised
from fusion.filters.triggers import TRIGGERS, effective_number, entropy
from fusion.types import Floats

Draw = Callable[[Floats, np.random.Generator], Floats]
"""Points (n, d) of the last epoch -> points (n, d) of this one, drawn from the importance density q."""

LogLikelihood = Callable[[Floats], Floats]
"""Points (n, d) -> log p(Z | X) (n,), up to a constant; -inf where a point cannot be."""

LogRatio = Callable[[Floats, Floats], Floats]
"""Points of this epoch and of the last, (n, d) each -> log p(X | X_before) - log q(X | X_before, Z) (n,)."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """``points`` (n, d) with ``log_weights`` (n,), which are known up to a constant."""

    points: Floats
    log_weights: Floats

    @classmethod
    def of(cls, points: Floats) -> Cloud:
        """Draws from the distribution of the start, all of the same weight."""
        return cls(points, np.zeros(len(points)))

    @property
    def weights(self) -> Floats:
        """Weights (n,) that sum to 1, (1.47). Raises ``ValueError`` where the measurements exclude every point."""
        return normalised(self.log_weights)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The ``mean`` (d,), (1.48), and ``covariance`` (d, d) of the weighted points before any resampling.

    ``cloud`` is what the next epoch begins with, ``n_eff`` (1.50) and ``entropy`` (1.49) say how uneven the weights
    were, and ``resampled`` whether they were made equal.
    """

    cloud: Cloud
    mean: Floats
    covariance: Floats
    n_eff: float
    entropy: float
    resampled: bool


def predict(cloud: Cloud, draw: Draw, rng: np.random.Generator, log_ratio: LogRatio | None = None) -> Cloud:
    """Move the points; ``log_ratio`` is needed where ``draw`` does not follow the transition itself (1.46)."""
    points = draw(cloud.points, rng)
    ratio = 0.0 if log_ratio is None else log_ratio(points, cloud.points)
    return Cloud(points, cloud.log_weights + ratio)


def correct(cloud: Cloud, log_likelihood: LogLikelihood) -> Cloud:
    """Weigh each point by how well it explains the measurements (1.46)."""
    return Cloud(cloud.points, cloud.log_weights + log_likelihood(cloud.points))


@dataclass(frozen=True)
class ParticleFilter:
    """``resampling`` and ``trigger`` are names in their registries; ``threshold`` None is the trigger's default.

    Draws depend on ``seed`` and the number of the step only.
    """

    resampling: str = "multinomial"
    trigger: str = "n_eff"
    threshold: float | None = None
    seed: int = 0

    def step(
        self,
        cloud: Cloud,
        step: int,
        draw: Draw,
        log_likelihood: LogLikelihood,
        log_ratio: LogRatio | None = None,
    ) -> Estimate:
        """Predict, correct, normalise, estimate and, if it is due, resample: epoch ``step`` of the algorithm."""
        rng = np.random.default_rng([self.seed, step])
        cloud = correct(predict(cloud, draw, rng, log_ratio), log_likelihood)
        weights = cloud.weights
        mean = weights @ cloud.points
        away = cloud.points - mean
        n_eff, disorder = effective_number(weights), entropy(weights)
        resampled = self._due(n_eff, disorder, len(weights))
        if resampled:
            cloud = Cloud.of(cloud.points[RESAMPLERS[self.resampling](weights, self.seed, step)])
        return Estimate(cloud, mean, (weights * away.T) @ away, n_eff, disorder, resampled)

    def _due(self, n_eff: float, disorder: float, particles: int) -> bool:
        trigger = TRIGGERS[self.trigger]
        threshold = trigger.default_threshold if self.threshold is None else self.threshold
        return trigger.due(n_eff, disorder, particles, threshold)
