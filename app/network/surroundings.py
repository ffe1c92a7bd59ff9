"""The stored roads around segments, and what stands beside them: drives, slopes, heights of the elevation model.

What is made of it is in ``solve``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.network.cell_roads import roads_in
from app.network.cells import partitions_around
from fusion.network.curve import interval_count, knot_length
from fusion.network.subnetwork import SOLVE_RADIUS_M, boxes_around
from fusion.network.terrain import Terrain, heights_at
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

_LINES = text("""
    SELECT ST_X(ST_StartPoint(geom)), ST_Y(ST_StartPoint(geom)), ST_X(ST_EndPoint(geom)), ST_Y(ST_EndPoint(geom))
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))
""")

# A segment is driven where a drive that is no duplicate has a pass; the first one is enough. OFFSET 0 makes the planner
# look at passes before drives, whatever it believes of tables that have grown since.
KNOWN = """
    SELECT s.id, coalesce(p.driven, false) AS driven, coalesce(n.drives, -1), n.slope_percent, n.slope_sigma_percent
    FROM unnest(%(ids)s) AS s (id)
    LEFT JOIN LATERAL (
        SELECT true AS driven FROM (
            SELECT drive_id FROM drive_passes WHERE segment_id = s.id AND partition = ANY(%(partitions)s::smallint[])
            ORDER BY entered_s OFFSET 0) AS over
        WHERE (SELECT duplicate_of IS NULL FROM drives WHERE id = over.drive_id) LIMIT 1) AS p ON true
    LEFT JOIN network_slopes AS n ON n.segment_id = s.id
    WHERE p.driven OR n.segment_id IS NOT NULL
"""

_HEIGHTS = """
    SELECT id, dem_heights_m FROM segments WHERE id = ANY(%(ids)s::bigint[]) AND dem_heights_m IS NOT NULL
"""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The roads around touched segments and what is known of them; every column has shape (n,)."""

    table: RoadTable
    ids: Ints
    cell: Ints
    """The cell of each row (``app.network.cells``)."""
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
    boxes = boxes_around(lon0, lat0, lon1, lat1, scale * SOLVE_RADIUS_M)
    roads = roads_in(session, boxes)
    row = np.argsort(roads.ids)
    rows = fetch_binary(session, KNOWN, {"ids": roads.ids, "partitions": partitions_around(roads.cell)})
    ids, driven, drives, slope, sigma = zip(*rows, strict=True) if rows else ((),) * 5
    at = row[np.searchsorted(roads.ids, np.array(ids, np.int64), sorter=row)]
    n = len(roads.ids)
    return Surroundings(
        roads.table,
        roads.ids,
        roads.cell,
        _spread(n, at, np.array(driven, bool), False),
        _spread(n, at, np.array(drives, np.int64), -1),
        _spread(n, at, np.array(slope, float), np.nan),
        _spread(n, at, np.array(sigma, float), np.nan),
    )


def _spread(n: int, at: Ints, values: NDArray[Any], otherwise: float) -> NDArray[Any]:
    """A vector (n,) with ``values`` where they are known."""
    out = np.full(n, otherwise, values.dtype)
    out[at] = values
    return out


def stored_terrain(session: Session, table: RoadTable, ids: Ints) -> Terrain | None:
    """Heights of the elevation model at the knots of ``table``, whose segments have these ids; None: there are none."""
    stored = dict(fetch_binary(session, _HEIGHTS, {"ids": ids.tolist()}))
    if not stored:
        return None
    count = interval_count(knot_length(table.length_m)) + 1
    heights = [
        np.asarray(stored[i], float) if i in stored and len(stored[i]) == n else np.full(n, np.nan)
        for i, n in zip(ids.tolist(), count.tolist(), strict=True)
    ]
    return heights_at(np.concatenate(heights))
