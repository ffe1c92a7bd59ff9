"""Planes fitted to posts (Al Assaad 2020, 3.1-3.12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.types import Floats

_COLLINEAR = 1e-7  # ratio of the singular values of centred, scaled coordinates


@dataclass(frozen=True, slots=True)
class PlaneModel:
    """The plane z = a (x - x0) + b (y - y0) + c over local metres.

    ``sigma_m`` is the standard deviation of the posts about it (residuals over n - 3), NaN for n = 3;
    ``posts`` is n.
    """

    a: float
    b: float
    c: float
    x0: float
    y0: float
    sigma_m: float
    posts: int

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights at local metres, in the broadcast shape."""
        return (
            self.a * (np.asarray(x_m, float) - self.x0) + self.b * (np.asarray(y_m, float) - self.y0) + self.c
        )


def fit_plane(x_m: Floats, y_m: Floats, z_m: Floats) -> PlaneModel | None:
    """The least-squares plane (3.10) of the points with a height; None for fewer than 3 or collinear ones.

    Arguments have shape (n,). Coordinates are centred and scaled first: squares of UTM coordinates would
    leave three digits to the slope.
    """
    known = np.isfinite(z_m)
    x, y, z = x_m[known], y_m[known], z_m[known]
    if len(z) < 3:
        return None
    x0, y0, z0 = float(x.mean()), float(y.mean()), float(z.mean())
    scale = float(max(np.ptp(x), np.ptp(y)))
    if scale == 0.0:
        return None
    design = np.column_stack([x - x0, y - y0]) / scale
    gradient, _, rank, _ = np.linalg.lstsq(design, z - z0, rcond=_COLLINEAR)
    if rank < 2:
        return None
    residual = z - z0 - design @ gradient
    sigma = float(np.sqrt(residual @ residual / (len(z) - 3))) if len(z) > 3 else float("nan")
    return PlaneModel(float(gradient[0]) / scale, float(gradient[1]) / scale, z0, x0, y0, sigma, len(z))
