"""Where the posts of a grid lie in a local metric plane, and which posts are near a place of the plane.

A projection per post or per estimate would take too long: over some kilometres both ways are polynomials. Those
of degree 4 over 128 posts of three arc seconds (12 km) are right to less than a micrometre there, and to a tenth of
a millimetre within 50 km, farther than any segment reaches. Heights between posts are those of triangles, a TIN over a
regular grid (Al Assaad 2020, 2.33-2.34).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats

_DEGREE = 4
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 2) + 0.5) / (_DEGREE + 2))

Map = Callable[[Floats, Floats], tuple[Floats, Floats]]


def _terms(s: Floats, t: Floats) -> Floats:
    """Monomials s^i t^j, i + j <= 4, in the order of ``polynomial``; shape (n, 15)."""
    return np.column_stack([s**i * t**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)])


_S, _T = (w.ravel() for w in np.meshgrid(_NODES, _NODES))
_FIT = np.asarray(np.linalg.pinv(_terms(_S, _T)), np.float64)


@compiled
def polynomial(coefficients: Floats, s: float, t: float) -> tuple[float, float]:
    """Two polynomials of degree 4 at one place; ``coefficients`` has shape (15, 2), see ``_terms``."""
    p = q = 0.0
    k = 0
    power_s = 1.0
    for i in range(_DEGREE + 1):
        power = power_s
        for _ in range(_DEGREE + 1 - i):
            p += coefficients[k, 0] * power
            q += coefficients[k, 1] * power
            power *= t
            k += 1
        power_s *= s
    return p, q


@dataclass(frozen=True, eq=False)
class LocalGrid:
    """A rectangle of a grid in a local plane.

    ``to_plane`` and ``to_grid``, shape (15, 2), are polynomials of places counted from the middle and divided by
    half the extent: ``grid_box`` holds (u, v, half the columns, half the rows), ``plane_box`` (x, y, half the
    extent) in metres.
    """

    grid_box: tuple[float, float, float, float]
    plane_box: tuple[float, float, float]
    to_plane: Floats
    to_grid: Floats

    @classmethod
    def over(cls, columns: tuple[int, int], rows: tuple[int, int], project: Map) -> LocalGrid:
        """Fit both ways over posts first..last; ``project`` takes grid coordinates (u, v) to metres (x, y)."""
        (u0, u1), (v0, v1) = columns, rows
        box = ((u0 + u1) / 2, (v0 + v1) / 2, max(u1 - u0, 1) / 2, max(v1 - v0, 1) / 2)
        u, v = box[0] + box[2] * _S, box[1] + box[3] * _T
        x, y = project(u, v)
        x0, y0 = float(x.mean()), float(y.mean())
        half_m = float(max(np.ptp(x), np.ptp(y))) / 2
        terms = _terms((x - x0) / half_m, (y - y0) / half_m)
        to_grid = np.linalg.lstsq(terms, np.column_stack([u, v]), rcond=None)[0]
        to_plane = _FIT @ np.column_stack([x, y])
        return cls(box, (x0, y0, half_m), to_plane, np.ascontiguousarray(to_grid, np.float64))


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
