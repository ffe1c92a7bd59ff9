"""What a map of slopes shows: every road with its slope, lines wide where sure, arrows where the sign is certain.

How that is drawn is in ``app.map.slope_picture``: here is no matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.map.segment import Segment
from fusion.roads.table import RoadTable
from fusion.types import Floats

SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT = 0.3, 3.0
SURE_WIDTH_PT, UNSURE_WIDTH_PT = 5.0, 1.2
"""Lines are widest at the first sigma and below, narrowest at the second and above."""
DOUBT = 1.96  # an arrow needs a slope whose sign is beyond 95 % doubt
ARROW_PERCENT = 1.0  # and steeper than this


@dataclass(frozen=True)
class MapSegments:
    """What the map draws, n segments: ends in degrees, slope and sigma in percent (NaN where unknown)."""

    lon0_deg: Floats
    lat0_deg: Floats
    lon1_deg: Floats
    lat1_deg: Floats
    slope_percent: Floats
    slope_sigma_percent: Floats
    bridge: NDArray[np.bool_]
    tunnel: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which segments have a slope."""
        return np.isfinite(self.slope_percent)


def map_segments(roads: RoadTable, segments: Iterable[Segment]) -> MapSegments:
    """The roads with the slopes of those of the segments that are among them."""
    known = {(s.osm_way_id, s.from_node, s.to_node): s for s in segments}
    slope, sigma = np.full(len(roads), np.nan), np.full(len(roads), np.nan)
    keys = zip(roads.osm_way_id.tolist(), roads.from_node.tolist(), roads.to_node.tolist(), strict=True)
    for row, key in enumerate(keys):
        segment = known.get(key)
        if segment is not None and segment.slope_percent is not None:
            slope[row] = segment.slope_percent
            sigma[row] = np.nan if segment.slope_sigma_percent is None else segment.slope_sigma_percent
    return MapSegments(
        lon0_deg=roads.lon0_deg,
        lat0_deg=roads.lat0_deg,
        lon1_deg=roads.lon1_deg,
        lat1_deg=roads.lat1_deg,
        slope_percent=slope,
        slope_sigma_percent=sigma,
        bridge=roads.bridge,
        tunnel=roads.tunnel,
    )


def line_widths(sigma_percent: Floats) -> Floats:
    """Width in points per sigma in percent: wide where sure; logarithmic, clipped; NaN is unsure."""
    sigma = np.where(np.isfinite(sigma_percent), sigma_percent, UNSURE_SIGMA_PERCENT)
    sigma = np.clip(sigma, SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT)
    doubt = np.log(sigma / SURE_SIGMA_PERCENT) / np.log(UNSURE_SIGMA_PERCENT / SURE_SIGMA_PERCENT)
    return np.asarray(SURE_WIDTH_PT + doubt * (UNSURE_WIDTH_PT - SURE_WIDTH_PT), float)


def arrow_choice(
    middle_m: Floats, slope_percent: Floats, sigma_percent: Floats, spacing_m: float
) -> NDArray[np.int64]:
    """Indices of segments that get an uphill arrow: steep and of a certain sign, steepest first, ``spacing_m``
    apart.

    ``middle_m`` has shape (n, 2).
    """
    doubt = DOUBT * np.where(np.isfinite(sigma_percent), sigma_percent, np.inf)
    sure = np.abs(slope_percent) > np.maximum(doubt, ARROW_PERCENT)
    chosen: list[int] = []
    for i in np.argsort(-np.abs(np.where(sure, slope_percent, 0.0)), kind="stable"):
        if not sure[i]:
            break
        apart = np.hypot(*(middle_m[chosen] - middle_m[i]).T)
        if not chosen or apart.min() >= spacing_m:
            chosen.append(int(i))
    return np.array(chosen, np.int64)
