"""The Kalman filter and the extended one: Al Assaad 2020, (1.33)-(1.37); Saadaoui 2011, Algorithms 1 and 2.

States are a mean x (n,) and a symmetric covariance P (n, n), both float64. The functions of the linear filter are
compiled and may be called from Python and from compiled loops alike; they return new arrays, but for
``correct_scalar``.

In the extended filter the mean goes through the model itself, the covariance through the model's Jacobian at the newest
mean. Two slips of the prints are put right: (1.37) takes the transition's Jacobian at the predicted mean, which is not
known by then, and Algorithm 2 leaves the measurement out of the innovation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats

Model = Callable[[Floats], Floats]


@compiled
def predict(
    mean: Floats, covariance: Floats, transition: Floats, process_noise: Floats
) -> tuple[Floats, Floats]:
    """F x and F P F' + Q, with ``transition`` F (n, n) and ``process_noise`` Q (n, n).

    The caller adds a known command.
    """
    x, P, F = np.ascontiguousarray(mean), np.ascontiguousarray(covariance), np.ascontiguousarray(transition)
    return F @ x, _symmetric(F @ P @ F.T + process_noise)


@compiled
def correct(
    mean: Floats, covariance: Floats, innovation: Floats, jacobian: Floats, measurement_noise: Floats
) -> tuple[Floats, Floats]:
    """x + K r and (I - K H) P (I - K H)' + K R K' with the gain K = P H' (H P H' + R)^-1.

    ``innovation`` r (m,) is z - H x, or z - h(x) wrapped where it is an angle; ``jacobian`` H (m, n) is the matrix of
    the measurement, or its derivative; ``measurement_noise`` R (m, m).

    The thesis prints (I - K H) P, which is the same for this gain; Joseph's form stays symmetric and positive
    semi-definite in finite arithmetic too. Raises ``LinAlgError`` where H P H' + R is singular.
    """
    P, r, H = (
        np.ascontiguousarray(covariance),
        np.ascontiguousarray(innovation),
        np.ascontiguousarray(jacobian),
    )
    R = np.ascontiguousarray(measurement_noise)
    K = np.ascontiguousarray(np.linalg.solve(H @ P @ H.T + R, H @ P).T)
    A = np.eye(len(mean)) - K @ H
    return mean + K @ r, _symmetric(A @ P @ A.T + K @ R @ K.T)


@compiled
def normalised_square(
    covariance: Floats, innovation: Floats, jacobian: Floats, measurement_noise: Floats
) -> float:
    """r' (H P H' + R)^-1 r: chi-square with m degrees of freedom where the filter's covariances are right.

    Shapes as for ``correct``. For gates, and for tests of consistency.
    """
    P, r, H = (
        np.ascontiguousarray(covariance),
        np.ascontiguousarray(innovation),
        np.ascontiguousarray(jacobian),
    )
    return float(r @ np.linalg.solve(H @ P @ H.T + measurement_noise, r))


@compiled
def correct_scalar(mean: Floats, covariance: Floats, innovation: float, row: Floats, variance: float) -> None:
    """Correct ``mean`` (n,) and ``covariance`` (n, n) in place by one scalar measurement, in Joseph's form.

    For compiled loops, where matrices would cost more than the sums. Measurements with independent errors may be
    taken one after another, each with the ``innovation`` that it has against the mean as it stands by then.
    ``row`` (n,) is the measurement's row of H, ``variance`` its positive variance.
    """
    n = len(mean)
    across = np.empty(n)
    total = variance
    for a in range(n):
        across[a] = 0.0
        for b in range(n):
            across[a] += covariance[a, b] * row[b]
        total += row[a] * across[a]
    # (I - k h') P (I - k h')' in two steps: multiplied out, a vague start would cost all digits.
    for a in range(n):
        gain = across[a] / total
        mean[a] += gain * innovation
        for b in range(n):
            covariance[a, b] -= gain * across[b]
    for a in range(n):
        left = 0.0
        for b in range(n):
            left += covariance[a, b] * row[b]
        left -= variance * across[a] / total
        for b in range(a + 1):
            covariance[a, b] = covariance[b, a] = covariance[a, b] - left * across[b] / total


@compiled
def _symmetric(matrix: Floats) -> Floats:
    return 0.5 * (matrix + matrix.T)


def predict_extended(
    mean: Floats, covariance: Floats, f: Model, jacobian: Model, process_noise: Floats
) -> tuple[Floats, Floats]:
    """f(x) and F P F' + Q, where F = ``jacobian(x)`` (n, n), ``f(x)`` (n,) and ``process_noise`` Q (n, n)."""
    _, predicted = predict(mean, covariance, jacobian(mean), process_noise)
    return f(mean), predicted


def correct_extended(
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
    return correct(mean, covariance, subtract(measured, h(mean)), jacobian(mean), measurement_noise)
