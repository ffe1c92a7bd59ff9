"""Which slope to go by where a consumer wants one of every segment, and in which directions it may be driven."""

from __future__ import annotations

import math
from enum import StrEnum

from app.map.segment import Segment

DEM_HEIGHT_SIGMA_M = 1.5
"""By how much heights of an elevation model at the ends of one segment are off against each other, about."""
USUAL_SLOPE_PERCENT = 4.0
"""How steep roads are, about: what a doubtful slope is drawn towards the level by."""


class Unmeasured(StrEnum):
    """What is assumed of segments that nobody measured."""

    DEM = "dem"
    LEVEL = "level"
    SKIP = "skip"


def slope_of(segment: Segment, unmeasured: Unmeasured) -> float | None:
    """The slope to go by, percent along the way; None where it is unknown.

    By the elevation model it is drawn towards the level, the more the shorter the segment: its heights are off by
    metres, which is nothing over a kilometre and a wall over ten metres. On bridges and in tunnels it says nothing.
    """
    if segment.slope_percent is not None:
        return segment.slope_percent
    dem = segment.dem_slope_percent
    if unmeasured is not Unmeasured.DEM or dem is None or segment.bridge or segment.tunnel:
        return None
    error = 100 * math.sqrt(2) * DEM_HEIGHT_SIGMA_M / max(segment.length_m, 1.0)
    return dem * USUAL_SLOPE_PERCENT**2 / (USUAL_SLOPE_PERCENT**2 + error**2)


def directions(segment: Segment) -> list[tuple[int, int, int]]:
    """The ways in which it may be driven: from a node, to a node, and the sign of its slope in that direction."""
    along = (segment.from_node, segment.to_node, 1)
    against = (segment.to_node, segment.from_node, -1)
    if segment.oneway:
        return [along if segment.oneway > 0 else against]
    return [along, against]
