"""Surveyed heights that were imported, as solvers of roads near them read them.

``fusion.network.control`` decides what a point does to heights; ``control_import`` writes the points.
"""

from __future__ import annotations

import math

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from fusion.frames import SHORTEST_DEGREE_M
from fusion.network.control import REACH_M, ControlHeights, ControlPoint, place
from fusion.roads.table import RoadTable

_NEAR = text("""
    SELECT lon_deg, lat_deg, height_m, sigma_m, name FROM control_points
    WHERE lon_deg BETWEEN :west AND :east AND lat_deg BETWEEN :south AND :north
    ORDER BY lon_deg, lat_deg
""")


def control_near(session: Session, bounds_deg: Bounds) -> list[ControlPoint]:
    """The stored points in a box (degrees), in the same order however they came."""
    west, south, east, north = bounds_deg
    box = {"west": west, "south": south, "east": east, "north": north}
    return [ControlPoint(*row) for row in session.execute(_NEAR, box)]


def control_on(session: Session, table: RoadTable) -> ControlHeights:
    """The stored points on the roads of a table that holds all roads where it has any."""
    points = control_near(session, widened(table.bounds_deg())) if len(table) else []
    return place(points, table)[0]


def widened(bounds_deg: Bounds) -> Bounds:
    """The box and all within a point's reach of it."""
    west, south, east, north = bounds_deg
    margin = REACH_M / SHORTEST_DEGREE_M
    farthest = min(max(abs(south), abs(north)) + margin, 89.9)
    wider = margin / math.cos(math.radians(farthest))
    return west - wider, south - margin, east + wider, north + margin
