"""The height of the road under a drive, from an elevation model: it helps positioning where a road is matched."""

from __future__ import annotations

import numpy as np

from fusion.matching.drive import DriveMatcher
from fusion.matching.path import PathMatch
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats


def heights_under(log: DriveLog, network: RoadNetwork, dem: Dem) -> Floats:
    """The elevation model's heights (n,), m above its datum, at the places of the road that the fixes are matched to.

    NaN off the road, on bridges and in tunnels, where the ground is not the road.
    """
    x, y = network.projection.to_xy(log.fix.lon_deg, log.fix.lat_deg)
    match = DriveMatcher(network).match(log.fix.time_s, x, y, sigma_m=log.fix.h_acc_m)
    segment, along = _places(match)
    on = segment >= 0
    table = network.table
    on[on] &= ~(table.bridge | table.tunnel)[segment[on]]
    out = np.full(len(log.fix), np.nan)
    if on.any():
        s = segment[on]
        share = along[on] / np.maximum(network.length_m[s], 1e-9)
        lon = table.lon0_deg[s] + share * (table.lon1_deg[s] - table.lon0_deg[s])
        lat = table.lat0_deg[s] + share * (table.lat1_deg[s] - table.lat0_deg[s])
        out[on] = dem.heights(lon, lat)
    return out


def above_ellipsoid(height_m: Floats, solved_ell_m: Floats) -> Floats:
    """The same heights above the ellipsoid, with the antenna's above the road: shifted to solved heights by the median.

    No grid of the geoid comes with the library. What a whole drive's heights are off by stays in the shift: so the road
    tells a drive how its height changes, and not how high it is.
    """
    both = np.isfinite(height_m) & np.isfinite(solved_ell_m)
    if not both.any():
        return np.full(len(height_m), np.nan)
    return height_m + float(np.median(solved_ell_m[both] - height_m[both]))


def _places(match: PathMatch) -> tuple[np.ndarray, Floats]:
    """The segment (-1 off the road) and the distance from its from_node of each sample."""
    row, along = match.position_on(match.distance_m)
    row = np.where(match.traversal >= 0, row, -1)
    segment = np.where(row >= 0, match.segment[row] if len(match) else -1, -1)
    return segment, along
