"""Imports of road tables as regions, and maps in which nodes have moved."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
from sqlalchemy import text

from app.core.db import Sessions
from app.roads.documents import ImportCounts, Source, Wishes
from app.roads.imports import bring_in
from fusion.roads.table import RoadTable
from fusion.types import Ints

METRE = 1 / 111_132.0
"""Of latitude, degrees."""


def bring(
    sessions: Sessions,
    table: RoadTable,
    region: str = "here",
    *,
    dry_run: bool = False,
    yes: bool = True,
    dem_dir: Path = Path("nowhere"),
) -> ImportCounts:
    """Import a table as the roads of a region."""
    wishes = Wishes(dry_run=dry_run, accept_losses=yes)
    return bring_in(sessions, table, Source(f"{region}.osm", "0" * 64, region), dem_dir, wishes)


def stored(sessions: Sessions) -> dict[tuple[int, int, int], tuple[int, list[str]]]:
    """Number and regions of each segment by way and nodes."""
    query = text(
        """
        SELECT osm_way_id, from_node, to_node, id, ARRAY(SELECT name FROM regions WHERE id = ANY(s.regions) ORDER BY 1)
        FROM segments AS s
        """
    )
    with sessions() as session:
        return {tuple(row[:3]): (row[3], row[4]) for row in session.execute(query)}


def ids_of(sessions: Sessions, table: RoadTable) -> Ints:
    found = stored(sessions)
    keys = zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)
    return np.array([found[key][0] for key in keys])


def moved(table: RoadTable, nodes: Collection[int], north_m: float, east_m: float = 0.0) -> RoadTable:
    """The same map with some nodes elsewhere."""
    columns = {}
    for end, node in ((0, table.from_node), (1, table.to_node)):
        shifted = np.isin(node, list(nodes))
        lat = getattr(table, f"lat{end}_deg")
        columns[f"lat{end}_deg"] = lat + shifted * north_m * METRE
        columns[f"lon{end}_deg"] = getattr(table, f"lon{end}_deg") + shifted * east_m * METRE / np.cos(
            np.radians(lat)
        )
    return replace(table, **columns)
