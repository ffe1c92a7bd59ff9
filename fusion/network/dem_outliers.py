"""Where an elevation model stands out from itself: a tile on another datum, a void that was filled badly.

Judged by heights of roads that do not know the model. All of them may count from another level than the model, so the
model's own usual difference is the measure. Where the heights come from is not known here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.types import Bools, Floats

DISPLACED_M = 15.0
"""Errors up to here are ordinary ones: SRTM was made to be within 16 m in nine of ten places, and is within 9 m
(Rodriguez, Morris and Belz 2006)."""
DISPLACED_SIGMAS = 4.0
"""... and so are those within so many of the model's own sigmas along these roads."""
SHORTEST_M = 100.0
"""Over a shorter way it is a cutting, an embankment or a clump of trees."""
_MEDIAN_TO_SIGMA = 1.4826


class Displaced(NamedTuple):
    """Which of n places stand out to the same side, by how much the model is too high there, and along how far."""

    where: Bools
    off_m: float
    length_m: float

    def said(self, lat_deg: float, lon_deg: float) -> str:
        """A sentence for a report; the place is one of those that stand out."""
        side = "high" if self.off_m > 0 else "low"
        return (
            f"The elevation model is about {abs(self.off_m):.0f} m too {side} along {self.length_m:.0f} m of the roads "
            f"driven (at {lat_deg:.5f}, {lon_deg:.5f} for one), against its height on the others. Look whether its "
            "tiles have one datum and whether it has filled voids there, or whether the altitudes recorded are wrong."
        )


def displaced(above_m: Floats, length_m: Floats) -> Displaced | None:
    """Where the model stands out, most of it; ``above_m`` (n,) is by how much it is above the roads' heights.

    ``length_m`` (n,): of how much road each is. Half of the places at least must agree with each other.
    """
    if not len(above_m):
        return None
    off = above_m - np.median(above_m)
    sigma = _MEDIAN_TO_SIGMA * float(np.median(np.abs(off)))
    least = max(DISPLACED_M, DISPLACED_SIGMAS * sigma)
    sides = [off > least, off < -least]
    where = max(sides, key=lambda side: float(np.sum(length_m[side])))
    far = float(np.sum(length_m[where]))
    if far < SHORTEST_M:
        return None
    # Against the others: the middle of all leans to those that stand out.
    return Displaced(where, float(np.median(off[where]) - np.median(off[~where])), far)
