"""The segments of a solution that comes from no database, as records to be written."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

import numpy as np

from app.map.segment import Segment
from fusion.network.combine import NETWORK_ONLY
from fusion.results import Solution

OF_ROADS = ("osm_way_id", "from_node", "to_node", "length_m", "highway", "name", "oneway", "bridge", "tunnel")
OF_SLOPES = ("slope_percent", "slope_sigma_percent", "drives", "observations", *NETWORK_ONLY)
"""What a segment has of the roads, and of what was measured."""


def segments_of(solved: Solution, now: datetime) -> Iterator[Segment]:
    """Each segment with a slope, in the order of the solution; ``now`` is when that was found."""
    table = solved.roads
    roads = zip(*(getattr(table, name).tolist() for name in OF_ROADS), strict=True)
    ends = np.column_stack([table.lon0_deg, table.lat0_deg, table.lon1_deg, table.lat1_deg]).tolist()
    of_dem = solved.dem_slope_percent.tolist()
    for road, (lon0, lat0, lon1, lat1), total, dem_slope_percent in zip(
        roads, ends, solved.slopes, of_dem, strict=True
    ):
        yield Segment(
            id=None,
            **dict(zip(OF_ROADS, road, strict=True)),
            **{name: getattr(total, name) for name in OF_SLOPES},
            dem_slope_percent=dem_slope_percent,
            updated_at=now,
            coordinates=((lon0, lat0), (lon1, lat1)),
        )
