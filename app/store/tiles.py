"""Tiles of the Web Mercator quad (z, x, y with y from the north).

Which roads a tile holds, so that one at a low zoom stays small: from ``full_zoom`` on all of them; further
out those that were driven, and by class from zoom 10 tertiary and above, from 8 primary and above, below that
motorways and trunk roads.
"""

from __future__ import annotations

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.store.rows import SegmentRow
from app.store.segments import FROM_SEGMENTS, SEGMENT_COLUMNS, segment_row

LAYER = "segments"
EXTENT = 4096
BUFFER = 64
FULL_ZOOM = 13

_MOTORWAYS = ("motorway", "trunk", "motorway_link", "trunk_link")
_PRIMARY = (*_MOTORWAYS, "primary", "primary_link")
_TERTIARY = (*_PRIMARY, "secondary", "secondary_link", "tertiary", "tertiary_link")

# The box for the index is wider than the tile by the buffer, else lines just outside it would end at its
# edge. Only what a map draws is in the tile: each further property costs a tenth of the whole query.
_MVT = text(
    """
    WITH box AS (
        SELECT ST_TileEnvelope(:z, :x, :y) AS tile,
               ST_TileEnvelope(:z, :x, :y, margin => CAST(:buffer AS float8) / :extent) AS wide
    ), feature AS (
        SELECT s.id, a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0) AS drives, s.highway,
               s.oneway, ST_AsMVTGeom(s.geom_3857, box.tile, :extent, :buffer, true) AS geom
        FROM box JOIN segments AS s ON s.geom_3857 && box.wide
        LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
        WHERE CAST(:classes AS text[]) IS NULL OR s.highway = ANY(:classes) OR a.segment_id IS NOT NULL
    )
    SELECT ST_AsMVT(feature, :layer, :extent, 'geom', 'id') FROM feature WHERE geom IS NOT NULL
    """
)

_GEOJSON = text(
    "SELECT"
    + SEGMENT_COLUMNS
    + FROM_SEGMENTS
    + """
    WHERE ST_Intersects(s.geom_3857, ST_TileEnvelope(:z, :x, :y))
        AND (CAST(:classes AS text[]) IS NULL OR s.highway = ANY(:classes) OR a.segment_id IS NOT NULL)
    ORDER BY s.id
    """
)


def mvt(session: Session, z: int, x: int, y: int, *, full_zoom: int = FULL_ZOOM) -> bytes:
    """The Mapbox vector tile: layer ``segments``, a segment's id as its feature's id; empty without any.

    0 <= x, y < 2**z is the caller's to check. Properties: ``slope_percent``, ``slope_sigma_percent`` (both
    absent where unknown), ``drives``, ``highway``, ``oneway``. Extent 4096, buffer 64.
    """
    values = {"z": z, "x": x, "y": y, "buffer": BUFFER, "extent": EXTENT, "layer": LAYER}
    return bytes(session.execute(_MVT, {**values, "classes": _classes(z, full_zoom)}).scalar_one() or b"")


def geojson_tile(session: Session, z: int, x: int, y: int, *, full_zoom: int = FULL_ZOOM) -> list[SegmentRow]:
    """The segments that meet the tile, whole and with all properties, by ascending id."""
    values = {"z": z, "x": x, "y": y, "classes": _classes(z, full_zoom)}
    return [segment_row(row) for row in session.execute(_GEOJSON, values)]


def _classes(z: int, full_zoom: int) -> list[str] | None:
    """The road classes shown at a zoom whether driven or not; None stands for all."""
    if z >= full_zoom:
        return None
    if z >= 10:
        return list(_TERTIARY)
    return list(_PRIMARY if z >= 8 else _MOTORWAYS)
