"""Streets for pictures of maps."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.map.picture.slope_map import MapSegments
from fusion.types import Floats

LAT, LON = 48.0, 8.0
"""Where the first of the streets begins."""


def lines(lon0: Any, lat0: Any, lon1: Any, lat1: Any) -> Floats:
    """The ends of lines in degrees, (n, 2, 2); single numbers are of all lines."""
    return np.stack(np.broadcast_arrays(lon0, lat0, lon1, lat1), axis=-1).reshape(-1, 2, 2).astype(float)


def street(slope: Floats, sigma: Floats) -> MapSegments:
    """Parallel streets of about 100 m, one per slope, going east."""
    n = len(slope)
    lat: Floats = np.linspace(LAT, LAT + 2e-4 * n, n)
    return MapSegments(
        ends_deg=lines(LON, lat, LON + 1.3e-3, lat),
        slope_percent=slope,
        slope_sigma_percent=sigma,
        bridge=np.arange(n) % 5 == 1,
        tunnel=np.arange(n) % 5 == 2,
        name=np.array([None] * n, object),
    )
