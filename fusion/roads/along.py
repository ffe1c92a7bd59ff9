"""Which roads lie along a log: boxes that follow it, so that a diagonal trip does not take the land beside it in."""

from __future__ import annotations

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats

STRETCH_M = 2000.0
"""Of the log that one box holds."""
DETOUR = 0.5
"""Between positions that are apart, roads within so much of their distance may be the way."""
LONGEST_GAP_M = 20_000.0
"""Nobody finds a way through longer gaps: the land between is left out."""
_HIGHEST_DEG = 89.9


def boxes_along(lon_deg: Floats, lat_deg: Floats, margin_m: float) -> Floats:
    """Boxes (m, 4: west, south, east, north; degrees) that hold all within about ``margin_m`` of positions (n,) and of
    the ways between them, more where positions are far apart; shape (0, 4) without any. They overlap.
    """
    known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    lon, lat = lon_deg[known], lat_deg[known]
    if not len(lon):
        return np.empty((0, 4))
    narrow = np.cos(np.radians(np.minimum(np.abs(lat), _HIGHEST_DEG)))
    step_m = METRES_PER_DEGREE * np.hypot(np.diff(lon) * narrow[:-1], np.diff(lat))
    bridged = step_m <= LONGEST_GAP_M
    # From each position to the next, but over a gap that nothing bridges; the last one stands for itself.
    to = np.arange(len(lon)) + np.append(bridged, False)
    gap_m = np.append(np.where(bridged, step_m, 0.0), 0.0)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    new = np.append(True, (np.diff(np.floor(along_m / STRETCH_M)) != 0) | ~bridged)
    first = np.flatnonzero(new)
    west = np.minimum.reduceat(np.minimum(lon, lon[to]), first)
    south = np.minimum.reduceat(np.minimum(lat, lat[to]), first)
    east = np.maximum.reduceat(np.maximum(lon, lon[to]), first)
    north = np.maximum.reduceat(np.maximum(lat, lat[to]), first)
    wider = (
        margin_m + DETOUR * np.maximum.reduceat(np.maximum(gap_m - margin_m, 0.0), first)
    ) / METRES_PER_DEGREE
    farthest = np.minimum(np.maximum(np.abs(south), np.abs(north)) + wider, _HIGHEST_DEG)
    across = wider / np.cos(np.radians(farthest))
    return np.column_stack([west - across, south - wider, east + across, north + wider])
