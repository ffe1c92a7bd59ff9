"""Map tiles: Mapbox vector tiles and GeoJSON, with TileJSON 3."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from app.core.admission import class_of_request
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    ServiceDep,
    etag_matches,
    geojson_answer,
    geojson_response,
    json_answer,
    link,
    link_documents,
    problems,
    with_query,
)
from app.core.text import GEO_JSON
from app.map.attribution import attribution
from app.map.coverage import dem_names
from app.map.segment import HEIGHT_DATUM
from app.map.segments import MAX_ID, SEGMENT_EXAMPLE
from app.map.store import geojson_tile as geojson_rows
from app.map.tiles.documents import SEGMENT_FIELDS, kinds, tilejson
from app.map.tiles.front import DEEPEST_ZOOM, MVT, answer, check_tile
from app.map.tiles.store import SEGMENTS, Address
from app.network.cells import tile_tag
from app.terrain.store import dem_version_id

GEOJSON_SCHEMA = 3
"""Raise it whenever these tiles change without their data changing, so that caches notice."""
EXAMPLE = {
    "tilejson": "3.0.0",
    "tiles": ["http://127.0.0.1:8000/tiles/{z}/{x}/{y}.mvt"],
    "vector_layers": [{"id": SEGMENTS, "fields": kinds(SEGMENT_FIELDS)}],
}

ZoomPath = Annotated[int, Path(ge=0, le=DEEPEST_ZOOM, description="Zoom level.", examples=[14])]
ColumnPath = Annotated[
    int, Path(ge=0, description="Column from the antimeridian eastwards.", examples=[8579])
]
RowPath = Annotated[int, Path(ge=0, description="Row from the north.", examples=[5634])]

router = APIRouter(tags=["tiles"])

MVT_ANSWER: dict[str, Any] = {
    "description": "The tile: one layer, named as the collection is; a segment's or way's id is its feature's id.",
    "content": {MVT: {"schema": {"type": "string", "format": "binary"}}},
}
EMPTY: dict[int | str, dict[str, Any]] = {
    204: {"description": "The tile holds nothing."},
    304: {"description": "Unchanged since the ETag."},
}


@router.get(
    "/tiles/{z}/{x}/{y}.mvt",
    summary="Vector tile",
    response_class=Response,
    responses={200: MVT_ANSWER, **EMPTY, **problems(404, 503)},
)
@router.get(
    "/tiles/{z}/{x}/{y}.pbf",
    summary="Vector tile, by the other name of its format",
    response_class=Response,
    responses={200: MVT_ANSWER, **EMPTY, **problems(404, 503)},
)
async def mvt_tile(z: ZoomPath, x: ColumnPath, y: RowPath, request: Request, service: ServiceDep) -> Response:
    """What a map draws. Revalidate with If-None-Match: an unchanged map answers 304."""
    at = Address(SEGMENTS, z, x, y)
    check_tile(at, service.settings.tile_max_zoom)
    return await vector_tile(request, at)


async def vector_tile(request: Request, at: Address) -> Response:
    """The answer of a route to a request for a vector tile."""
    # Requests that have a class got their place before the route (``app.core.admission``).
    is_admitted = class_of_request("GET", request.url.path) is not None
    reply = await answer(request.app.state.tiles, at, request.scope["headers"], is_admitted=is_admitted)
    response = Response(reply.body, reply.status)
    response.raw_headers = reply.headers
    return response


@router.get(
    "/tiles/{z}/{x}/{y}.geojson",
    summary="GeoJSON tile",
    response_class=Response,
    responses={
        200: geojson_answer("One page of the segments that meet the tile, whole.", SEGMENT_EXAMPLE),
        304: EMPTY[304],
        **problems(404, 503),
    },
)
def geojson_tile(
    z: ZoomPath,
    x: ColumnPath,
    y: RowPath,
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    after: Annotated[
        int, Query(ge=0, le=MAX_ID, description="For `next` links: the last id before the page.")
    ] = 0,
) -> Response:
    """The same segments with all their properties, not cut at the tile's edge.

    A tile that has more of them than the service puts into one answer has a `next` link, as items have: follow it
    until there is none, and every segment comes exactly once.
    """

    full_zoom, most = service.settings.tile_full_zoom, service.settings.tile_features_max
    check_tile(Address(SEGMENTS, z, x, y), service.settings.tile_max_zoom)
    with service.reading() as session:
        # The version first: a tile newer than its tag is only fetched once more, an older one would stay.
        tag = f"{tile_tag(session, z, x, y)}.{dem_version_id(session)}"
        headers = {
            "ETag": f'W/"{tag}-{GEOJSON_SCHEMA}.{service.settings.tile_min_zoom}.{full_zoom}"',
            "Cache-Control": REVALIDATE,
        }
        if etag_matches(request, headers["ETag"]):
            return Response(status_code=304, headers=headers)
        rows = []
        if z >= service.settings.tile_min_zoom:
            # One more than shown tells whether there is a next page.
            rows = geojson_rows(session, z, x, y, full_zoom=full_zoom, after_id=after, limit=most + 1)
        source = attribution(dem_names(service, session, rows[:most]))
    shown = rows[:most]
    here = f"{base}/tiles/{z}/{x}/{y}.geojson"
    links = [link(with_query(here, after=after or None), "self", GEO_JSON)]
    if len(rows) > most:
        title = f"The tile holds more than these {most} segments: the next ones"
        links.append(link(with_query(here, after=shown[-1].id), "next", GEO_JSON, title))
    document = {
        "type": "FeatureCollection",
        "attribution": source,
        "height_datum": HEIGHT_DATUM,
        "numberReturned": len(shown),
        "links": link_documents(links),
        "features": (row.geojson() for row in shown),
    }
    return geojson_response(document, headers)


@router.get(
    "/tiles.json", summary="TileJSON", responses={200: json_answer("TileJSON 3.0.", EXAMPLE), **problems(503)}
)
def tile_json(service: ServiceDep, base: BaseUrl) -> dict[str, Any]:
    """What a map needs to know about the vector tiles."""
    return tilejson(service, base, SEGMENTS)
