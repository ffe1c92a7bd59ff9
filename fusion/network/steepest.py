"""The steepest stretch inside each segment, from the cubics between its knots. Drives and sigmas are not known here."""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats, Ints

STRETCH_M = 20.0
"""Over so much of the road its grade is taken: the spacing of knots, and about a long vehicle's length."""
STEPS = 20
"""Places at which the stretch is tried for each interval between knots: at most a metre apart where knots are 20 m
apart, and a twentieth of what the cubic bends over where they are farther."""
_EQUAL = 1e-9
"""Of stretches as steep as each other the first counts; rounding must not choose."""


@compiled
def _height(knots: Floats, first: int, intervals: int, length_m: float, at_m: float) -> float:
    spacing = length_m / intervals
    interval = min(int(at_m / spacing), intervals - 1)
    u = min(at_m / spacing - interval, 1.0)
    k = first + 2 * interval
    rest = 1.0 - u
    return float(
        rest * rest * ((1.0 + 2.0 * u) * knots[k] + spacing * u * knots[k + 1])
        + u * u * ((3.0 - 2.0 * u) * knots[k + 2] - spacing * rest * knots[k + 3])
    )


@compiled
def steepest(knots: Floats, first: Ints, intervals: Ints, length_m: Floats) -> Floats:
    """Mean grade over the steepest ``STRETCH_M`` of each segment, signed, and where it begins and ends, m: (3, n).

    ``knots`` holds height and grade at each knot in turn, those of a segment from ``first`` on. The mean grade is the
    difference of height over the distance; the whole segment counts where it is shorter than the stretch.
    """
    out = np.empty((3, len(first)))
    for row in range(len(first)):
        length = length_m[row]
        stretch = min(STRETCH_M, length)
        tries = STEPS * intervals[row] if length > stretch else 0
        best, where = -1.0, 0.0
        for k in range(tries + 1):
            begin = (length - stretch) * k / max(tries, 1)
            low = _height(knots, first[row], intervals[row], length, begin)
            grade = (_height(knots, first[row], intervals[row], length, begin + stretch) - low) / stretch
            if abs(grade) > best + _EQUAL:
                best, where = abs(grade), begin
                out[0, row] = grade
        out[1, row], out[2, row] = where, where + stretch
    return out
