"""Streets for pictures of maps."""

from __future__ import annotations

import numpy as np

from app.map.picture.slope_map import MapSegments
from fusion.types import Floats

LAT, LON = 48.0, 8.0
"""Where the first of the streets begins."""


def street(slope: Floats, sigma: Floats) -> MapSegments:
    """Parallel streets of about 100 m, one per slope, going east."""
    n = len(slope)
    lat: Floats = np.linspace(LAT, LAT + 2e-4 * n, n)
    return MapSegments(
        lon0_deg=np.full(n, LON),
        lat0_deg=lat,
        lon1_deg=np.full(n, LON + 1.3e-3),
        lat1_deg=lat,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        bridge=np.arange(n) % 5 == 1,
        tunnel=np.arange(n) % 5 == 2,
        name=np.array([None] * n, object),
    )
