"""Where the posts of a grid lie in a local metric plane, and which posts are near a place of the plane.

A projection per post or per estimate would take too long: over some kilometres both ways are polynomials. Those
of degree 4 over 128 posts of three arc seconds (12 km) are right to less than a micrometre there, and to a tenth of
a millimetre within 50 km, farther than any segment reaches. Knows no heights.
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
