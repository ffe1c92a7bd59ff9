"""What a profile uses of segments and of a drive's estimates, out of the database: columns, for thousands at once."""

from __future__ import annotations

import uuid

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.drives.outputs.profile import RoadFacts
from fusion.types import Ints

_ROADS = """
    SELECT id, ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)),
           ST_Y(ST_EndPoint(geom)), bridge, tunnel, length_m, dem_heights_m
    FROM segments WHERE id = ANY(%(ids)s::bigint[])
"""
_SLOPES = text(
    "SELECT segment_id, slope_percent, slope_sigma_percent FROM drive_segments WHERE drive_id = :drive_id"
)


def road_facts(session: Session, segment_id: Ints) -> dict[int, RoadFacts]:
    """The facts of the segments of these epochs, by id; -1 is none, and one that an import dropped has none."""
    ids = np.unique(segment_id[segment_id >= 0])
    return {
        number: RoadFacts.between(
            (lon0, lat0), (lon1, lat1), bridge=bridge, tunnel=tunnel, length_m=length_m, dem_heights_m=heights
        )
        for number, lon0, lat0, lon1, lat1, bridge, tunnel, length_m, heights in fetch_binary(
            session, _ROADS, {"ids": ids}
        )
    }


def own_slopes(session: Session, drive_id: uuid.UUID) -> dict[int, tuple[float, float]]:
    """Slope and sigma of each segment from a drive alone, percent, from_node -> to_node."""
    rows = session.execute(_SLOPES, {"drive_id": drive_id})
    return {row.segment_id: (row.slope_percent, row.slope_sigma_percent) for row in rows}
