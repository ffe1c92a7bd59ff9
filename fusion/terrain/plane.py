"""Planes fitted to posts (Al Assaad 2020, 3.1-3.12). Which posts, is for ``fusion.terrain.windows`` to say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats

_COLLINEAR = 1e-7  # ratio of the singular values of centred coordinates


class PlaneModel(NamedTuple):
    """The plane z = a (x - x0) + b (y - y0) + c over local metres.

    ``sigma_m`` is the standard deviation of the posts about it (residuals over n - 3), NaN for n = 3;
    ``posts`` is n, or 0 where there is no plane.
    """

    a: float
    b: float
    c: float
    x0: float
    y0: float
    sigma_m: float
    posts: int

    def height_at(self, x_m: float, y_m: float) -> float:
        """The height at a place in local metres."""
        return self.a * (x_m - self.x0) + self.b * (y_m - self.y0) + self.c


@compiled
def plane_through(x: Floats, y: Floats, z: Floats) -> PlaneModel:
    """The least-squares plane (3.10) through points (n,); none through fewer than 3 or collinear ones.

    Coordinates are centred first, and an orthogonal basis takes the place of the normal equations: squares of UTM
    coordinates would leave three digits to the slope.
    """
    n = len(z)
    none = PlaneModel(np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, 0)
    if n < 3:
        return none
    x0, y0, z0 = x.mean(), y.mean(), z.mean()
    dx, dy, dz = x - x0, y - y0, z - z0
    # Gram-Schmidt: dx = r11 q1, dy = r12 q1 + r22 q2; dy becomes r22 q2
    r11 = np.sqrt(np.sum(dx * dx))
    if r11 == 0.0:
        return none
    dx /= r11
    r12 = np.sum(dx * dy)
    square = r11 * r11 + r12 * r12
    dy -= r12 * dx
    r22 = np.sqrt(np.sum(dy * dy))
    square += r22 * r22
    # the singular values s1 >= s2 of the basis change: s1 s2 = r11 r22, s1^2 + s2^2 = square
    larger = (square + np.sqrt(max(square * square - 4.0 * (r11 * r22) ** 2, 0.0))) / 2.0
    if not r11 * r22 > _COLLINEAR * larger:
        return none
    dy /= r22
    p1, p2 = np.sum(dx * dz), np.sum(dy * dz)
    b = p2 / r22
    a = (p1 - r12 * b) / r11
    sigma = np.nan
    if n > 3:
        residual = dz - p1 * dx - p2 * dy
        sigma = np.sqrt(np.sum(residual * residual) / (n - 3))
    return PlaneModel(a, b, z0, x0, y0, sigma, n)
