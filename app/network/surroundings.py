"""The stored roads around segments, and what stands beside them: drives, slopes, heights of the elevation model.

What is made of it is in ``solve``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.network.extracts import ROAD_COLUMNS, ROAD_ORDER, road_table
from fusion.network.curve import interval_count, knot_length
from fusion.network.terrain import Terrain, heights_at
from fusion.network.window import WINDOW_RADIUS_M, boxes_around
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

_LINES = text(
    """
    SELECT ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)), ST_Y(ST_EndPoint(geom))
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))
    """
)

# Through the index on the geometry: the cost is that of the roads around the touched ones, however large the map. A
# segment is driven where a drive that is heard has a pass; the first that is found will do. Passes are looked at before
# drives, whatever the planner thinks of tables that have grown since it last looked (OFFSET 0 keeps it from that).
SURROUNDINGS = text(
    f"""
    SELECT {ROAD_COLUMNS}, s.cell, coalesce(p.driven, false) AS driven, n.drives, n.slope_percent, n.slope_sigma_percent
    FROM segments AS s
    LEFT JOIN LATERAL (
        SELECT true AS driven FROM (SELECT drive_id FROM drive_passes
            WHERE segment_id = s.id AND region = versant_region(s.cell)
            ORDER BY entered_s OFFSET 0) AS over
        WHERE (SELECT same_as IS NULL FROM drives WHERE id = over.drive_id) LIMIT 1) AS p ON true
    LEFT JOIN network_slopes AS n ON n.segment_id = s.id
    WHERE s.id IN (
        SELECT i.id
        FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                    CAST(:north AS float8[])) AS box (west, south, east, north)
        JOIN segments AS i ON i.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326))
    ORDER BY {ROAD_ORDER}
    """  # noqa: S608 - constants
)

_HEIGHTS = """
    SELECT id, dem_heights_m FROM segments WHERE id = ANY(%(ids)s::bigint[]) AND dem_heights_m IS NOT NULL
"""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The roads around touched segments and what is known of them; every column has shape (n,)."""

    table: RoadTable
    ids: Ints
    cell: Ints
    """The square of each row (``app.network.cells``)."""
    driven: Bools
    drives: Ints
    """As stored: -1 where the network has no slope."""
    slope_percent: Floats
    """As stored, like its sigma: NaN where the network has none."""
    slope_sigma_percent: Floats


def surroundings(session: Session, touched: Collection[int], scale: float) -> Surroundings:
    """The roads within the library's radius, times ``scale``, around ``touched`` segments."""
    lines = np.array([tuple(row) for row in session.execute(_LINES, {"ids": list(touched)})], float)
    lon0, lat0, lon1, lat1 = lines.reshape(-1, 4).T
    west, south, east, north = boxes_around(lon0, lat0, lon1, lat1, scale * WINDOW_RADIUS_M).T.tolist()
    box = {"west": west, "south": south, "east": east, "north": north}
    rows = session.execute(SURROUNDINGS, box).all()
    table, ids = road_table(rows)
    slopes = [
        (np.nan, np.nan) if row.drives is None else (row.slope_percent, row.slope_sigma_percent)
        for row in rows
    ]
    slope, sigma = np.array(slopes, float).reshape(-1, 2).T
    return Surroundings(
        table,
        ids,
        np.array([row.cell for row in rows], np.int64),
        np.array([row.driven for row in rows], bool),
        np.array([-1 if row.drives is None else row.drives for row in rows], np.int64),
        slope,
        sigma,
    )


def stored_terrain(session: Session, table: RoadTable, ids: Ints) -> Terrain | None:
    """Heights of the elevation model at the knots of ``table``, whose segments have these ids; None: there are none."""
    found = dict(fetch_binary(session, _HEIGHTS, {"ids": ids.tolist()}))
    if not found:
        return None
    count = interval_count(knot_length(table.length_m)) + 1
    heights = [
        np.asarray(found[i], float) if i in found and len(found[i]) == n else np.full(n, np.nan)
        for i, n in zip(ids.tolist(), count.tolist(), strict=True)
    ]
    return heights_at(np.concatenate(heights))
