"""Extracts of the stored roads as the library's tables: whole, or around a place.

``app.roads`` writes the roads; what was measured on them is not known here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.tables import WITHOUT_HEIGHTS
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

_LINE_HEADER_BYTES = 9  # WKB: byte order, type, number of points

# What ``road_table`` reads, of the table that is called s (segments), and the order of its rows.
ROAD_COLUMNS = """s.id, s.osm_way_id, s.from_node, s.to_node, ST_AsBinary(s.geom, 'NDR') AS line,
           s.oneway, s.bridge, s.tunnel, s.layer, s.highway, s.name"""
ROAD_ORDER = "s.osm_way_id, s.from_node, s.to_node"

_ALL = text(f"SELECT {ROAD_COLUMNS} FROM segments AS s ORDER BY {ROAD_ORDER}")  # noqa: S608 - constants
_IN_BOX = text(f"""
    SELECT {ROAD_COLUMNS} FROM segments AS s
    WHERE s.geom && ST_MakeEnvelope(:west, :south, :east, :north, 4326)
    ORDER BY {ROAD_ORDER}
""")  # noqa: S608 - constants

_IDS_IN = text("""
    SELECT DISTINCT s.id
    FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                CAST(:north AS float8[])) AS box (west, south, east, north)
    JOIN segments AS s ON s.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326)
    WHERE s.id > :after ORDER BY s.id
""")
_BY_IDS = text(
    f"SELECT {ROAD_COLUMNS} FROM segments AS s WHERE s.id = ANY(CAST(:ids AS bigint[])) ORDER BY {ROAD_ORDER}"  # noqa: S608 - constants
)

_WITHOUT_HEIGHTS = text(f"""
    SELECT {ROAD_COLUMNS} FROM segments AS s
    WHERE s.id IN (SELECT id FROM segments WHERE id > :after AND {WITHOUT_HEIGHTS} ORDER BY id LIMIT :limit)
    ORDER BY {ROAD_ORDER}
""")  # noqa: S608 - constants
_WITHOUT_HEIGHTS_IN = text(f"""
    SELECT {ROAD_COLUMNS} FROM segments AS s
    WHERE EXISTS (SELECT FROM segments WHERE {WITHOUT_HEIGHTS})
        AND s.id IN (
            SELECT i.id
            FROM unnest(CAST(:west AS float8[]), CAST(:south AS float8[]), CAST(:east AS float8[]),
                        CAST(:north AS float8[])) AS box (west, south, east, north)
            JOIN segments AS i ON i.geom && ST_MakeEnvelope(box.west, box.south, box.east, box.north, 4326)
            WHERE {WITHOUT_HEIGHTS})
    ORDER BY {ROAD_ORDER}
""")  # noqa: S608 - constants


def roads_within(session: Session, bounds_deg: Bounds) -> tuple[RoadTable, Ints]:
    """At least the segments whose bounding box meets ``bounds_deg``, and their ids, shape (n,).

    The index compares boxes in single precision, rounded outwards, so a few more may come along.
    """
    west, south, east, north = bounds_deg
    box = {"west": west, "south": south, "east": east, "north": north}
    return road_table(list(session.execute(_IN_BOX, box)))


def segment_ids_in(session: Session, boxes_deg: Floats, after_id: int = 0) -> Ints:
    """The ids above one of the segments that meet one of the boxes (m, 4: west, south, east, north), ascending."""
    west, south, east, north = boxes_deg.T.tolist()
    box = {"west": west, "south": south, "east": east, "north": north, "after": after_id}
    return np.array(session.execute(_IDS_IN, box).scalars().all(), np.int64)


def roads_of(session: Session, ids: Ints) -> tuple[RoadTable, Ints]:
    """Those of the segments that are there, and their ids."""
    return road_table(list(session.execute(_BY_IDS, {"ids": ids.tolist()})))


def all_roads(session: Session) -> tuple[RoadTable, Ints]:
    """The whole network and the segments' ids, shape (n,)."""
    return road_table(list(session.execute(_ALL)))


def roads_without_heights(session: Session, after_id: int, limit: int) -> tuple[RoadTable, Ints]:
    """The next segments after an id that have a slope by the elevation model but no heights, and their ids."""
    return road_table(list(session.execute(_WITHOUT_HEIGHTS, {"after": after_id, "limit": limit})))


def roads_without_heights_in(session: Session, boxes_deg: Floats) -> tuple[RoadTable, Ints]:
    """Those of all that meet one of the boxes (m, 4: west, south, east, north)."""
    west, south, east, north = boxes_deg.T.tolist()
    box = {"west": west, "south": south, "east": east, "north": north}
    return road_table(list(session.execute(_WITHOUT_HEIGHTS_IN, box)))


def road_table(rows: Sequence[Row[Any]]) -> tuple[RoadTable, Ints]:
    """Rows of ``ROAD_COLUMNS`` in ``ROAD_ORDER`` as a table, and their ids, shape (n,)."""
    lines = b"".join(bytes(row.line)[_LINE_HEADER_BYTES:] for row in rows)
    lon0, lat0, lon1, lat1 = np.frombuffer(lines, "<f8").reshape(-1, 4).astype(np.float64).T.copy()
    table = RoadTable(
        osm_way_id=np.array([row.osm_way_id for row in rows], np.int64),
        from_node=np.array([row.from_node for row in rows], np.int64),
        to_node=np.array([row.to_node for row in rows], np.int64),
        lon0_deg=lon0,
        lat0_deg=lat0,
        lon1_deg=lon1,
        lat1_deg=lat1,
        oneway=np.array([row.oneway for row in rows], np.int8),
        bridge=np.array([row.bridge for row in rows], np.bool_),
        tunnel=np.array([row.tunnel for row in rows], np.bool_),
        layer=np.array([row.layer for row in rows], np.int8),
        highway=np.array([row.highway for row in rows], np.object_),
        name=np.array([row.name for row in rows], np.object_),
    )
    return table, np.array([row.id for row in rows], np.int64)
