"""The extended Kalman filter: Al Assaad 2020, (1.35)-(1.37); Saadaoui 2011, Algorithm 2.

The mean goes through the model itself, the covariance through the model's Jacobian at the newest mean. Two slips of the
prints are put right: (1.37) takes the transition's Jacobian at the predicted mean, which is not known by then, and
Algorithm 2 leaves the measurement out of the innovation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fusion.filters import kalman
from fusion.types import Floats

Model = Callable[[Floats], Floats]


def predict(
    mean: Floats, covariance: Floats, f: Model, jacobian: Model, process_noise: Floats
) -> tuple[Floats, Floats]:
    """f(x) and F P F' + Q, where F = ``jacobian(x)`` (n, n), ``f(x)`` (n,) and ``process_noise`` Q (n, n)."""
    _, predicted = kalman.predict(mean, covariance, jacobian(mean), process_noise)
    return f(mean), predicted


def correct(
    mean: Floats,
    covariance: Floats,
    measured: Floats,
    h: Model,
    jacobian: Model,
    measurement_noise: Floats,
    subtract: Callable[[Floats, Floats], Floats] = np.subtract,
) -> tuple[Floats, Floats]:
    """The Kalman correction by the innovation ``subtract(measured, h(x))`` (m,), with H = ``jacobian(x)`` (m, n).

    ``measurement_noise`` is R (m, m). ``subtract`` wraps what is an angle. The covariance has Joseph's form.
    """
    return kalman.correct(mean, covariance, subtract(measured, h(mean)), jacobian(mean), measurement_noise)
