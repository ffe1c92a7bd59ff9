"""A map of a million segments: copies of a real one side by side, with slopes on a third of the roads, as SQL fills it.

Copies lie a whole number of tiles of zoom 10 apart, so that tiles of a copy hold what those of the original hold. Which
roads are measured follows from the number of the way, slopes from the place: smooth, the same in every run.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.network.cells import raise_versions
from app.roads.imports import import_roads

TILE_DEG = 360 / 2**10
"""Width of a tile of zoom 10."""
NUMBERS = 10**12
"""Between the ways and nodes of two copies."""

# Of the original.
_EXTENT = text(
    "SELECT count(*), min(ST_XMin(geom)), max(ST_XMax(geom)) FROM segments WHERE osm_way_id < :numbers"
)
_COPIES = text("SELECT max(osm_way_id) / :numbers FROM segments")
_COPY = text(
    """
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, name, oneway, bridge,
                          tunnel, layer, dem_slope_percent, dem_heights_m, road_version_id, regions)
    SELECT osm_way_id + :number, from_node + :number, to_node + :number, moved, ST_Transform(moved, 3857), length_m,
           highway, name, oneway, bridge, tunnel, layer, dem_slope_percent, dem_heights_m, road_version_id, regions
    FROM segments, LATERAL (SELECT ST_Translate(geom, :shift_deg, 0) AS moved) AS m
    WHERE osm_way_id < :numbers ORDER BY id LIMIT :limit
    """
)
_COLUMNS = """
    segment_id, slope_percent, slope_sigma_percent, drives, observations, driven_share, height_from_m, height_to_m,
    height_sigma_m, steepest_percent, steepest_from_m, steepest_to_m
"""
_SLOPES = text(
    f"""
    INSERT INTO network_slopes ({_COLUMNS})
    SELECT id, slope, 0.2 + osm_way_id % 7 * 0.1, 1 + osm_way_id % 9, 5 + osm_way_id % 50, 1,
           200, 200 + slope * length_m / 100, 2, slope * 1.1, 0, least(length_m, 20)
    FROM segments, LATERAL (SELECT 6 * sin(ST_X(ST_StartPoint(geom)) * 700) * cos(ST_Y(ST_StartPoint(geom)) * 900)
                            + 0.01 AS slope) AS s
    WHERE osm_way_id % 3 = 0
    """  # noqa: S608 - constants
)
# As published: what rests on nothing would be taken away by a worker.
_PUBLISHED = text(
    f"INSERT INTO segment_slopes ({_COLUMNS}) SELECT {_COLUMNS} FROM network_slopes ORDER BY segment_id"  # noqa: S608
)
_CELLS = text("SELECT DISTINCT cell FROM segments")
_ANALYZE = "ANALYZE segments, network_slopes, segment_slopes, cells, segment_changes"


def fill(sessions: Sessions, roads: Path, folder: Path, segments: int = 1_000_000) -> None:
    """Fill an empty database of the present schema; ``folder`` is for what an import keeps."""
    import_roads(sessions, roads, folder)
    with sessions.begin() as session:
        for copy in copies(session, segments):
            copy_roads(session, copy)
    with sessions.begin() as session:
        session.execute(_SLOPES)
        session.execute(_PUBLISHED)
        raise_versions(session, session.execute(_CELLS).scalars().all())
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "AUTOCOMMIT"}).exec_driver_sql(_ANALYZE)


class Copy(NamedTuple):
    """One copy of the first roads: its number, from 1 on, how far east it lies, and how many segments it has."""

    number: int
    shift_deg: float
    segments: int


def copies(session: Session, segments: int) -> list[Copy]:
    """Those that make so many segments of the first ones."""
    there, west, east = session.execute(_EXTENT, {"numbers": NUMBERS}).one()
    apart = math.ceil((east - west) / TILE_DEG + 1e-9) * TILE_DEG
    numbers = range(1, math.ceil(segments / there))
    return [Copy(n, n * apart, min(there, segments - n * there)) for n in numbers]


def copies_there(session: Session) -> int:
    """The number of the last copy; 0: there is none."""
    return int(session.execute(_COPIES, {"numbers": NUMBERS}).scalar_one())


def copy_roads(session: Session, copy: Copy) -> None:
    """Add its roads."""
    values = {"number": copy.number * NUMBERS, "numbers": NUMBERS, "shift_deg": copy.shift_deg}
    session.execute(_COPY, {**values, "limit": copy.segments})
