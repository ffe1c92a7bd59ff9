"""Tiles of names: places, waters, streets and numbers of roads, for the labels of a map.

They are a tileset of their own. The tiles of slopes hold single segments and change with every drive; names are of
whole streets, change with imports alone, and end at a zoom from which a map enlarges them.
"""

from __future__ import annotations

import gzip
from hashlib import sha256
from typing import Any

from fastapi import APIRouter, Request, Response

from app.core.http import BaseUrl, ServiceDep, json_answer, not_modified, problems
from app.core.standby.use import MapRoute
from app.map.coverage import cached_extent
from app.map.segment import attribution_html
from app.map.tiles.documents import kinds
from app.map.tiles.front import MVT, check_tile, policy, takes_gzip
from app.map.tiles.routes import EMPTY, ColumnPath, RowPath, ZoomPath
from app.map.tiles.store import Address
from app.roads.names import FROM_ZOOM, LEAST_ZOOM, MOST_ZOOM, STREETS_FROM, names_tile
from app.roads.store import road_tag

SCHEMA = 1
"""Raise it whenever these tiles change without their data changing, so that caches notice."""
NAMES = "names"
_NAME = "String; as it is written there"
LAYERS: dict[str, tuple[str, int, dict[str, str]]] = {
    "places": (
        "Places with a name",
        min(FROM_ZOOM["places"].values()),
        {
            "name": _NAME,
            "kind": f"String; {', '.join(FROM_ZOOM['places'])}",
            "population": "Number; absent: unknown",
        },
    ),
    "water": (
        "Waters with a name",
        min(FROM_ZOOM["water"].values()),
        {"name": _NAME, "kind": f"String; {', '.join(FROM_ZOOM['water'])}"},
    ),
    "roads": (
        "Roads with a number",
        min(FROM_ZOOM["roads"].values()),
        {"ref": "String; the number, such as B 37", "kind": f"String; {', '.join(FROM_ZOOM['roads'])}"},
    ),
    "streets": (
        "Streets with a name, all segments of one name as one",
        STREETS_FROM,
        {
            "name": _NAME,
            "rank": "Number; 0 motorways to secondary roads, 1 tertiary ones, 2 others, 3 service roads and tracks",
        },
    ),
}
"""Layer -> what a feature is, the first zoom that has any, and its properties."""
EXAMPLE = {
    "tilejson": "3.0.0",
    "tiles": ["http://127.0.0.1:8000/names/{z}/{x}/{y}.mvt"],
    "vector_layers": [{"id": "places", "fields": kinds(LAYERS["places"][2])}],
}

router = APIRouter(tags=["tiles"], route_class=MapRoute)

_ANSWER: dict[str, Any] = {
    "description": f"The tile: {', '.join(LAYERS)}, each where it has anything.",
    "content": {MVT: {"schema": {"type": "string", "format": "binary"}}},
}


@router.get(
    "/names/{z}/{x}/{y}.mvt",
    summary="Vector tile of names",
    response_class=Response,
    responses={200: _ANSWER, **EMPTY, **problems(404, 503)},
)
def names_of_tile(z: ZoomPath, x: ColumnPath, y: RowPath, request: Request, service: ServiceDep) -> Response:
    """What labels of a map say, as OpenStreetMap has it. It changes with imports of roads alone."""
    check_tile(Address(NAMES, z, x, y), MOST_ZOOM)
    with service.reading() as session:
        # The version first: a tile newer than its tag is only fetched once more, an older one would stay.
        state = sha256(repr(road_tag(session)).encode()).hexdigest()[:20]
        caching = {name.decode(): value.decode() for name, value in policy(service.settings)}
        headers = {"ETag": f'W/"{state}-{SCHEMA}"', **caching}
        if unchanged := not_modified(request, headers):
            return unchanged
        body = names_tile(session, z, x, y)
    if not body:
        return Response(status_code=204, headers=headers)
    if takes_gzip(request.headers.get("accept-encoding", "")):
        body = gzip.compress(body, 6, mtime=0)
        headers |= {"Content-Encoding": "gzip"}
    return Response(body, media_type=MVT, headers=headers)


@router.get(
    "/names.json",
    summary="TileJSON of names",
    responses={200: json_answer("TileJSON 3.0.", EXAMPLE), **problems(503)},
)
def names_json(service: ServiceDep, base: BaseUrl) -> dict[str, Any]:
    """What a map needs to know about the vector tiles of names."""
    with service.reading() as session:
        bounds = cached_extent(service, session)
    layers = [
        {"id": name, "description": feature, "fields": kinds(fields), "minzoom": first, "maxzoom": MOST_ZOOM}
        for name, (feature, first, fields) in LAYERS.items()
    ]
    document: dict[str, Any] = {
        "tilejson": "3.0.0",
        "name": "Versant names",
        "description": "Names of places, waters and streets, and numbers of roads",
        "scheme": "xyz",
        "tiles": [f"{base}/names/{{z}}/{{x}}/{{y}}.mvt"],
        "vector_layers": layers,
        "attribution": attribution_html(),
        "minzoom": LEAST_ZOOM,
        "maxzoom": MOST_ZOOM,
    }
    if bounds is not None:
        document["bounds"] = list(bounds)
    return document
