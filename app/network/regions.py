"""The squares of a grid in which a whole network is solved, one after the other."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from fusion.roads.table import RoadTable

REGION_DEG = 0.02
"""Side of the squares: a town's part of some thousand segments."""

Cell = tuple[int, int]
"""A square: its number eastwards and northwards."""

_CELLS = text(
    """
    SELECT id, CAST(floor(ST_XMin(geom) / :size) AS integer) AS x, CAST(floor(ST_YMin(geom) / :size) AS integer) AS y
    FROM segments WHERE id = ANY(CAST(:ids AS bigint[])) ORDER BY id
    """
)


@dataclass(frozen=True)
class Region:
    """Segments in one square of the grid."""

    cell: Cell
    ids: list[int]


def regions(session: Session, segment_ids: Collection[int]) -> list[Region]:
    """The segments that exist, grouped by squares, so that a group is solved at once."""
    groups: dict[Cell, list[int]] = {}
    for row in session.execute(_CELLS, {"ids": list(segment_ids), "size": REGION_DEG}):
        groups.setdefault((row.x, row.y), []).append(row.id)
    return [Region(cell, groups[cell]) for cell in sorted(groups)]


def cells_of(table: RoadTable) -> list[Cell]:
    """The squares of a table's segments, as ``regions`` groups them."""
    x = np.floor(np.minimum(table.lon0_deg, table.lon1_deg) / REGION_DEG).astype(np.int64)
    y = np.floor(np.minimum(table.lat0_deg, table.lat1_deg) / REGION_DEG).astype(np.int64)
    return list(zip(x.tolist(), y.tolist(), strict=True))
