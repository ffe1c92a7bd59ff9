"""What was measured on a segment, carried over to the segment that it has become: a little longer, or turned round.

Knots lie where a segment's length puts them, so that a segment of another length has other unknowns. A cubic over the
new knots says what height and grade the road has wherever the old knots were, and that is all that a factor needs. What
was measured of grades stays true when a map is corrected, so grades are kept and heights follow them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.network.curve import grade_rows, height_rows, interval_count, knot_length
from fusion.network.pass_factor import NUISANCES, PassFactor
from fusion.types import Floats

_SAME_M = 1e-3
"""What is nearer to an end than this is at it."""
_ALONG = 0.9
_STRETCH = (0.8, 1.25)
"""Cosine of the angle between old and new, and how much longer the new one may be, for places on one to be places on
the other; else shares of the length are."""

Ends = tuple[float, float, float, float]
"""Longitude and latitude of from_node and of to_node, degrees."""


@dataclass(frozen=True)
class Carrying:
    """From a segment of ``old_m`` to one of ``new_m`` metres, as knots assume them; on the new one the old from_node is
    at ``start_m``, the old to_node at ``end_m`` (before it where the new one runs the other way)."""

    old_m: float
    new_m: float
    start_m: float
    end_m: float

    @classmethod
    def between(
        cls, old_deg: Ends, old_length_m: float, new_deg: Ends, new_length_m: float, *, back: bool = False
    ) -> Self:
        """From the ends of the old segment to those of the new one; ``back``: it runs the other way."""
        old, new = float(knot_length(old_length_m)), float(knot_length(new_length_m))
        turned = (*old_deg[2:], *old_deg[:2]) if back else old_deg
        places = _places(turned, new_deg, old, new) or (0.0, new)
        return cls(old, new, *(places[::-1] if back else places))

    @property
    def back(self) -> bool:
        """Whether slopes have the other sign."""
        return self.end_m < self.start_m

    def factor(self, factor: PassFactor, segment: int) -> PassFactor:
        """The pass over the new ``segment``."""
        onto = self._unknowns
        knots, size = onto.shape
        transform = np.zeros((knots + NUISANCES, size + NUISANCES))
        transform[:knots, :size] = onto
        transform[knots:, size:] = np.eye(NUISANCES)
        information = transform.T @ factor.information @ transform
        driven = sorted(self._place(x) for x in (factor.start_m, factor.end_m))
        return replace(
            factor,
            segment=segment,
            information=0.5 * (information + information.T),
            vector=transform.T @ factor.vector,
            start_m=driven[0],
            end_m=driven[1],
        )

    @property
    def _scale(self) -> float:
        return (self.end_m - self.start_m) / self.old_m

    def _place(self, old_m: float) -> float:
        """Where a place of the old segment is on the new one; its ends are its ends."""
        if old_m <= _SAME_M or old_m >= self.old_m - _SAME_M:
            return self.new_m if (old_m <= _SAME_M) == self.back else 0.0
        return min(max(self.start_m + self._scale * old_m, 0.0), self.new_m)

    @property
    def _unknowns(self) -> Floats:
        """The old unknowns of the new ones, shape (old variables, new variables)."""
        knots = int(interval_count(self.old_m)) + 1
        place = np.linspace(self.start_m, self.end_m, knots)
        middle = np.array([0.5 * (self.start_m + self.end_m)])
        centre, height = self._height(middle), self._height(place)
        out = np.empty((2 * knots, height.shape[1]))
        out[::2] = centre + (height - centre) / abs(self._scale)
        out[1::2] = math.copysign(1.0, self._scale) * grade_rows(np.clip(place, 0.0, self.new_m), self.new_m)
        return out

    def _height(self, place_m: Floats) -> Floats:
        """Rows of heights; beyond its ends the road goes on as it ends."""
        inside = np.clip(place_m, 0.0, self.new_m)
        beyond = (place_m - inside)[:, None]
        return height_rows(inside, self.new_m) + beyond * grade_rows(inside, self.new_m)


def _places(old: Ends, new: Ends, old_m: float, new_m: float) -> tuple[float, float] | None:
    """Where the old ends lie along the new segment, m; None where the two do not lie along each other."""
    east_m = METRES_PER_DEGREE * math.cos(math.radians(new[1]))

    def offset(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
        return ((b[0] - a[0] + 180) % 360 - 180) * east_m, (b[1] - a[1]) * METRES_PER_DEGREE

    u, v = offset(new[:2], new[2:]), offset(old[:2], old[2:])
    across = math.hypot(*u) * math.hypot(*v)
    if not across or (u[0] * v[0] + u[1] * v[1]) / across < _ALONG:
        return None
    unit = u[0] / math.hypot(*u), u[1] / math.hypot(*u)
    start, end = (
        float(sum(p * q for p, q in zip(offset(a, b), unit, strict=True)))
        for a, b in ((new[:2], old[:2]), (new[2:], old[2:]))
    )
    end += new_m
    return (start, end) if _STRETCH[0] <= (end - start) / old_m <= _STRETCH[1] else None
