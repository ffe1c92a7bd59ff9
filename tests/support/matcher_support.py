"""Connected road networks from plain coordinates, and matches of plain positions, for tests of the matchers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.published.matchers.base import PointMatcher, PointMatches
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable

PLANE = LocalProjection(8.0, 49.0)


def connected(nodes: ArrayLike, pairs: ArrayLike, oneway: ArrayLike = 0) -> RoadNetwork:
    """A network of nodes (k, 2) in metres and segments (n, 2) between them, in this order."""
    xy, ab = np.asarray(nodes, float).reshape(-1, 2), np.asarray(pairs, np.int64).reshape(-1, 2)
    n = len(ab)
    lon, lat = PLANE.to_lonlat(xy[:, 0], xy[:, 1])
    table = RoadTable.from_columns(
        osm_way_id=np.arange(n),
        from_node=ab[:, 0],
        to_node=ab[:, 1],
        lon0_deg=lon[ab[:, 0]],
        lat0_deg=lat[ab[:, 0]],
        lon1_deg=lon[ab[:, 1]],
        lat1_deg=lat[ab[:, 1]],
        oneway=np.broadcast_to(oneway, n),
        bridge=np.zeros(n, bool),
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n),
        highway=["residential"] * n,
        name=[None] * n,
    )
    (x0, y0), (x1, y1) = (np.ascontiguousarray(xy[ab[:, end]].T) for end in range(2))
    return RoadNetwork(table, PLANE, x0, y0, x1, y1, np.hypot(x1 - x0, y1 - y0), np.arctan2(y1 - y0, x1 - x0))


def matched(
    matcher: PointMatcher, network: RoadNetwork, xy: ArrayLike, heading_rad: ArrayLike = np.nan
) -> PointMatches:
    """Matches of positions (n, 2), two seconds apart."""
    at = np.asarray(xy, float).reshape(-1, 2)
    heading = np.broadcast_to(heading_rad, len(at))
    return matcher.match(network, 2.0 * np.arange(len(at)), at[:, 0], at[:, 1], heading)
