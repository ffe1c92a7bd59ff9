"""The unscented Kalman filter with scaled sigma points (Wan & van der Merwe 2000): Saadaoui 2011, Algorithm 3.

With alpha = 1e-3 the points lie close together and their weights are of the order of 1e6, alternating in sign. All sums
here are therefore taken over differences from the centre point's image, d_i = f(x_i) - f(x_0). As the mean's weights
sum to one, the centre's own weight drops out of them:

    mean = f(x_0) + m,  m = sum W d_i          covariance = sum W d_i d_i' + (beta - alpha^2) m m'

over the 2 n outer points, each of weight W = 1 / (2 alpha^2 (n + kappa)). Nothing large is left to cancel, and angles
need no other mean than that of their wrapped differences. What remains is the rounding of the images themselves, which
m holds 1 / alpha^2 times: for a small alpha, take coordinates from an origin nearby.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.types import Floats

PointsModel = Callable[[Floats], Floats]
"""Maps points in rows, (k, n), to points in rows, (k, n) or (k, m)."""

Subtract = Callable[[Floats, Floats], Floats]
"""Differences (k, n) - (n,) or (m,) - (m,), wrapped where they are angles."""

_ROUNDING = 8.0 * np.finfo(np.float64).eps  # relative, of a point's image: a few operations
_INDEFINITE = 1e-9  # a negative eigenvalue of this share of the greatest is no rounding any more


@dataclass(frozen=True)
class Unscented:
    """``alpha`` > 0 spreads the points, ``beta`` = 2 is best for a Gaussian, ``kappa`` is 0 as a rule.

    Each step draws its points from the mean and covariance that it is given. (Algorithm 3 draws them once an epoch,
    before the process noise is added, so that the points it corrects by are too close together.) Raises
    ``ValueError`` for an alpha that is not positive, and in use for n + kappa <= 0 and for an indefinite covariance.
    """

    alpha: float = 1e-3
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not self.alpha > 0.0:
            raise ValueError(f"alpha must be positive, not {self.alpha}")

    def sigma_points(self, mean: Floats, covariance: Floats) -> Floats:
        """The mean, then the mean plus and minus the columns of a scaled root of the covariance: (2 n + 1, n)."""
        points: Floats = mean + self._offsets(covariance)
        return points

    def predict(
        self,
        mean: Floats,
        covariance: Floats,
        f: PointsModel,
        process_noise: Floats,
        subtract: Subtract = np.subtract,
    ) -> tuple[Floats, Floats]:
        """Mean and covariance of f(x) + w, w of covariance ``process_noise`` Q (n, n).

        ``subtract`` gives differences of states.
        """
        centre, shift, differences = self._image(f(self.sigma_points(mean, covariance)), subtract)
        return centre + shift, self._covariance(differences, shift) + process_noise

    def correct(
        self,
        mean: Floats,
        covariance: Floats,
        measured: Floats,
        h: PointsModel,
        measurement_noise: Floats,
        subtract: Subtract = np.subtract,
    ) -> tuple[Floats, Floats]:
        """x + K (z - h) and the covariance after it; ``measured`` z (m,), ``measurement_noise`` R (m, m).

        ``subtract`` gives differences of measurements. The printed P - K Pzz K' is summed as the covariance of
        what the gain leaves of each point, plus K R K', which is Joseph's form for sigma points.
        """
        offsets = self._offsets(covariance)
        centre, shift, differences = self._image(h(mean + offsets), subtract)
        weight = 0.5 / self._scale(len(mean))
        cross = weight * offsets.T @ differences
        gain = np.linalg.solve(self._covariance(differences, shift) + measurement_noise, cross.T).T
        left = self._covariance(offsets - differences @ gain.T, gain @ shift)
        corrected = left + _symmetric(gain @ measurement_noise @ gain.T)
        return mean + gain @ subtract(measured, centre + shift), corrected

    def _scale(self, n: int) -> float:
        """alpha^2 (n + kappa), which is n + lambda."""
        if not n + self.kappa > 0.0:
            raise ValueError(
                f"kappa = {self.kappa} leaves n + kappa = {n + self.kappa}, which must be positive"
            )
        return self.alpha**2 * (n + self.kappa)

    def _offsets(self, covariance: Floats) -> Floats:
        root = np.sqrt(self._scale(len(covariance))) * _root(covariance).T
        return np.concatenate([np.zeros((1, len(root))), root, -root])

    def _image(self, points: Floats, subtract: Subtract) -> tuple[Floats, Floats, Floats]:
        """The centre's image (m,), how far the mean lies from it (m,), and the differences from it (k, m).

        What a pair of opposite points says about the bend of a model is dropped where rounding alone can say it.
        """
        centre, n = points[0], len(points) // 2
        differences = subtract(points, centre)
        bend = differences[1 : n + 1] + differences[n + 1 :]
        bend[np.abs(bend) <= _ROUNDING * np.abs(centre)] = 0.0
        return centre, bend.sum(axis=0) * (0.5 / self._scale(n)), differences

    def _covariance(self, differences: Floats, shift: Floats) -> Floats:
        weight = 0.5 / self._scale(len(differences) // 2)
        spread = weight * differences.T @ differences + (self.beta - self.alpha**2) * np.outer(shift, shift)
        return _symmetric(spread)


def _root(covariance: Floats) -> Floats:
    """A matrix A with A A' = P: Cholesky's, or one from eigenvalues where P is only semi-definite."""
    try:
        return np.linalg.cholesky(covariance).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        if not values[0] >= -_INDEFINITE * values[-1]:
            raise ValueError("a covariance must be positive semi-definite") from None
        root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
        return root


def _symmetric(matrix: Floats) -> Floats:
    symmetric: Floats = 0.5 * (matrix + matrix.T)
    return symmetric
