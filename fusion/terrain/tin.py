"""Triangulated heights on a grid of posts, a TIN over a regular grid (Al Assaad 2020, 2.33-2.34).

Knows grid coordinates only, no metres and no degrees.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats


@compiled
def _post(z: Floats, row: int, column: int, weight: float) -> float:
    """A post's share of a height; one without weight is not looked at, so that a void there is no matter."""
    if weight == 0.0:
        return 0.0
    if row < 0 or column < 0 or row >= z.shape[0] or column >= z.shape[1]:
        return np.nan
    return weight * float(z[row, column])


@compiled
def tin_height(z: Floats, u: float, v: float) -> float:
    """The height at grid coordinates: u counts columns, v rows, both 0 at post ``z[0, 0]``.

    Each cell A(i, j), B(i + 1, j), C(i, j + 1), D(i + 1, j + 1), with i along columns and j along rows, is
    the triangles ABC and BCD. In grid coordinates (2.34) reads zA + (zB - zA) u + (zC - zA) v, which is the
    spec's for any affine grid, rotated or with unequal postings. NaN beyond the posts and where a corner of
    the triangle is NaN.
    """
    if not (np.isfinite(u) and np.isfinite(v) and -1 < u < z.shape[1] and -1 < v < z.shape[0]):
        return np.nan
    i, j = int(np.floor(u)), int(np.floor(v))
    fu, fv = u - i, v - j
    if fu + fv <= 1.0:
        return _post(z, j, i, 1 - fu - fv) + _post(z, j, i + 1, fu) + _post(z, j + 1, i, fv)
    corner = _post(z, j + 1, i + 1, fu + fv - 1)
    return corner + _post(z, j, i + 1, 1 - fv) + _post(z, j + 1, i, 1 - fu)


@compiled
def tin_heights(z: Floats, u: Floats, v: Floats) -> Floats:
    """``tin_height`` at many places, shape (n,)."""
    heights = np.empty(len(u))
    for k in range(len(u)):
        heights[k] = tin_height(z, u[k], v[k])
    return heights
