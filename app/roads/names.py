"""Names that the map shows: written by imports, region by region, and read as vector tiles.

Streets are the segments' own, put together where a tile shows them; the rest is in ``map_names``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from app.core.tables.served import FAR_ZOOM
from fusion.roads.names import MapNames
from fusion.types import Floats

LEAST_ZOOM, MOST_ZOOM = 4, 14
"""Of tiles of names; a map enlarges those of the last one."""
FROM_ZOOM = {
    "places": {"city": 4, "town": 8, "village": 10, "suburb": 11, "hamlet": 12},
    "water": {"river": 9, "canal": 12, "stream": 13},
    "roads": {"motorway": 9, "trunk": 10, "primary": 11, "secondary": 12, "tertiary": 13},
}
"""Layer -> kind -> the first zoom whose tiles have it."""
STREETS_FROM = 13
"""The first zoom with streets: through roads, and one later all."""
_THROUGH = ("motorway", "trunk", "primary", "secondary", "tertiary")
_LARGE = (*_THROUGH[:4], *(f"{kind}_link" for kind in _THROUGH[:4]))
_LESSER = ("service", "track")
_AT_ONCE = 5000
_DETAIL_M = 2
"""What lines are simplified to: a tile of ``MOST_ZOOM`` has 0.6 m for a unit."""
EXTENT, BUFFER = 4096, 128
"""Of a tile; names near its edge are in its neighbour as well."""

_PUT = f"""
    INSERT INTO map_names AS m (layer, osm_id, kind, name, population, from_zoom, regions, geom_3857)
    SELECT n.layer, n.osm_id, n.kind, n.name, n.population, n.from_zoom, ARRAY[%(region)s::smallint],
           ST_Simplify(ST_Transform(ST_GeomFromWKB(n.line, 4326), 3857), {_DETAIL_M}, true)
    FROM unnest(%(layer)s::text[], %(osm_id)s::bigint[], %(kind)s::text[], %(name)s::text[],
                %(population)s::bigint[], %(from_zoom)s::smallint[], %(line)s::bytea[])
        AS n (layer, osm_id, kind, name, population, from_zoom, line)
    ON CONFLICT (layer, osm_id) DO UPDATE
    SET kind = excluded.kind, name = excluded.name, population = excluded.population, from_zoom = excluded.from_zoom,
        geom_3857 = excluded.geom_3857,
        regions = CASE WHEN m.regions @> excluded.regions THEN m.regions ELSE m.regions || excluded.regions END
    WHERE NOT m.regions @> excluded.regions OR (m.kind, m.name, m.population) IS DISTINCT FROM
        (excluded.kind, excluded.name, excluded.population) OR NOT m.geom_3857 = excluded.geom_3857
"""  # noqa: S608 - constants
_RELEASE = text("""
    UPDATE map_names AS m SET regions = array_remove(m.regions, CAST(:region AS smallint))
    WHERE m.regions @> ARRAY[CAST(:region AS smallint)] AND NOT EXISTS (
        SELECT FROM unnest(CAST(:layer AS text[]), CAST(:osm_id AS bigint[])) AS n (layer, osm_id)
        WHERE n.layer = m.layer AND n.osm_id = m.osm_id)
""")
_DROP = text("DELETE FROM map_names WHERE regions = '{}'")
_ANALYZE = text("ANALYZE map_names")

_AS_GEOM = f"ST_AsMVTGeom({{}}, box.tile, {EXTENT}, {BUFFER}, true) AS geom"
_ONE_LINE = _AS_GEOM.format("ST_LineMerge(ST_Collect({}))")
_IN_BOX = "m.geom_3857 && box.wide AND m.from_zoom <= %(z)s{far} AND m.layer = '{layer}'"
_POINTS = f"""
    SELECT m.name, m.kind, m.population, {_AS_GEOM.format("m.geom_3857")}
    FROM box JOIN map_names AS m ON {_IN_BOX} ORDER BY m.osm_id
"""  # noqa: S608 - constants
_LINES = f"""
    SELECT m.name AS {{called}}, m.kind, {_ONE_LINE.format("m.geom_3857")}
    FROM box JOIN map_names AS m ON {_IN_BOX} GROUP BY box.tile, m.kind, m.name ORDER BY m.name, m.kind
"""  # noqa: S608 - constants
_STREETS = f"""
    SELECT s.name, min(s.rank) AS rank, {_ONE_LINE.format("s.geom_3857 ORDER BY s.id")} FROM box JOIN (
        SELECT id, name, geom_3857, CASE WHEN highway = ANY(%(large)s) THEN 0 WHEN highway = ANY(%(through)s) THEN 1
            WHEN highway = ANY(%(lesser)s) THEN 3 ELSE 2 END AS rank FROM segments
    ) AS s ON s.geom_3857 && box.wide AND s.name <> '' AND s.rank <= %(most)s
    GROUP BY box.tile, s.name ORDER BY s.name
"""  # noqa: S608 - constants
_LAYERS = {"places": _POINTS, "water": _LINES, "roads": _LINES, "streets": _STREETS}
"""What a tile's layers hold; a layer without features is none."""
_LAYER_OF = f"""
    SELECT ST_AsMVT(feature, '{{layer}}', {EXTENT}, 'geom') FROM (
        WITH box AS (SELECT ST_TileEnvelope(%(z)s, %(x)s, %(y)s) AS tile,
            ST_TileEnvelope(%(z)s, %(x)s, %(y)s, margin => CAST({BUFFER / EXTENT} AS float8)) AS wide)
        SELECT * FROM ({{features}} OFFSET 0) AS every WHERE geom IS NOT NULL) AS feature
"""  # noqa: S608 - constants


def bring_names(session: Session, region_id: int, names: MapNames) -> None:
    """Make these the names of a region, in place of those that it had. What other regions have as well stays theirs."""
    zooms = [FROM_ZOOM[layer][kind] for layer, kind in zip(names.layer, names.kind, strict=True)]
    columns: dict[str, list[Any]] = {
        **{column: getattr(names, column) for column in ("layer", "osm_id", "kind", "name", "population")},
        "from_zoom": zooms,
    }
    lines = map(_wkb, names.lines_deg())
    for start in range(0, len(names), _AT_ONCE):
        part = {column: values[start : start + _AT_ONCE] for column, values in columns.items()}
        send_binary(session, _PUT, {"region": region_id, **part, "line": list(islice(lines, _AT_ONCE))})
    session.execute(_RELEASE, {"region": region_id, "layer": names.layer, "osm_id": names.osm_id})
    session.execute(_DROP)
    session.execute(_ANALYZE)


def names_tile(session: Session, z: int, x: int, y: int) -> bytes:
    """The vector tile as it is now, not compressed; empty without any name.

    0 <= x, y < 2**z is the caller's to check. Layers ``places`` (points), ``water``, ``roads`` and ``streets`` (lines),
    each where it has anything at this zoom. Extent 4096, buffer 128.
    """
    far = f" AND m.from_zoom <= {FAR_ZOOM}" if z <= FAR_ZOOM else ""
    streets = {
        "large": list(_LARGE),
        "through": [*_THROUGH, *_LARGE],
        "lesser": list(_LESSER),
        "most": 1 if z == STREETS_FROM else 3,
    }
    parts: list[Any] = []
    for layer in _layers_at(z):
        called = "ref" if layer == "roads" else "name"
        features = _LAYERS[layer].format(layer=layer, far=far, called=called)
        statement = _LAYER_OF.format(layer=layer, features=features)
        parts += fetch_binary(session, statement, {"z": z, "x": x, "y": y, **streets})[0]
    return b"".join(bytes(part) for part in parts if part)


def _layers_at(z: int) -> Iterator[str]:
    for layer in _LAYERS:
        first = STREETS_FROM if layer == "streets" else min(FROM_ZOOM[layer].values())
        if first <= z <= MOST_ZOOM:
            yield layer


def _wkb(points_deg: Floats) -> bytes:
    """A point, or a line of two points or more, little-endian."""
    kind: Sequence[int] = (1,) if len(points_deg) == 1 else (2, len(points_deg))
    return b"\x01" + np.array(kind, "<u4").tobytes() + points_deg.astype("<f8").tobytes()
