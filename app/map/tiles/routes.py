"""Map tiles: Mapbox vector tiles and GeoJSON, with TileJSON 3, and OGC API Tiles, part 1.

The latter has tilesets of the whole and of each collection, and the one tile matrix set that they use. Its tiles are
those of ``/tiles/{z}/{x}/{y}.mvt``, with the row before the column as the standard has it. A tileset of the whole holds
the segments: ways are the same roads once more.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from app.core.admission import class_of_request
from app.core.errors import BadQueryError, NotFoundError
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    Service,
    ServiceDep,
    geojson_answer,
    geojson_response,
    json_answer,
    link,
    link_documents,
    not_modified,
    problems,
    with_query,
)
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.standby.use import MapRoute
from app.core.text import GEO_JSON
from app.map.coverage import dem_names
from app.map.segment import HEIGHT_DATUM, attribution
from app.map.segments import MAX_ID, SEGMENT_EXAMPLE
from app.map.store import geojson_tile as geojson_rows
from app.map.tiles import documents
from app.map.tiles.front import DEEPEST_ZOOM, LAYERS, MVT, QUAD, SUFFIXES, answer, check_tile, tiles_of
from app.map.tiles.store import SEGMENTS, Address
from app.network.cells import tile_tag
from app.terrain.store import dem_version_id

GEOJSON_SCHEMA = 3
"""Raise it whenever these tiles change without their data changing, so that caches notice."""
EXAMPLE = {
    "tilejson": "3.0.0",
    "tiles": ["http://127.0.0.1:8000/tiles/{z}/{x}/{y}.mvt"],
    "vector_layers": [{"id": SEGMENTS, "fields": documents.kinds(documents.SEGMENT_FIELDS)}],
}

ZoomPath = Annotated[int, Path(ge=0, le=DEEPEST_ZOOM, description="Zoom level.", examples=[14])]
ColumnPath = Annotated[
    int, Path(ge=0, description="Column from the antimeridian eastwards.", examples=[8579])
]
RowPath = Annotated[int, Path(ge=0, description="Row from the north.", examples=[5634])]

router = APIRouter(tags=["tiles"], route_class=MapRoute)

MVT_ANSWER: dict[str, Any] = {
    "description": "The tile: one layer, named as the collection is; a segment's or way's id is its feature's id.",
    "content": {MVT: {"schema": {"type": "string", "format": "binary"}}},
}
EMPTY: dict[int | str, dict[str, Any]] = {
    204: {"description": "The tile holds nothing."},
    304: {"description": "Unchanged since the ETag."},
}


_MVT_ROUTE: dict[str, Any] = {
    "response_class": Response,
    "responses": {200: MVT_ANSWER, **EMPTY, **problems(404, 503)},
}


@router.get("/tiles/{z}/{x}/{y}.mvt", summary="Vector tile", **_MVT_ROUTE)
@router.get("/tiles/{z}/{x}/{y}.pbf", summary="Vector tile, by the other name of its format", **_MVT_ROUTE)
async def mvt_tile(z: ZoomPath, x: ColumnPath, y: RowPath, request: Request, service: ServiceDep) -> Response:
    """What a map draws. Revalidate with If-None-Match: an unchanged map answers 304."""
    at = Address(SEGMENTS, z, x, y)
    check_tile(at, service.settings.tile_max_zoom)
    return await vector_tile(request, at)


async def vector_tile(request: Request, at: Address) -> Response:
    """The answer of a route to a request for a vector tile."""
    # Requests that have a class got their place before the route (``app.core.admission``).
    is_admitted = class_of_request("GET", request.url.path) is not None
    tiles = tiles_of(request.app.state).now
    reply = await answer(tiles, at, request.scope["headers"], is_admitted=is_admitted)
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
        if unchanged := not_modified(request, headers):
            return unchanged
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
    return documents.tilejson(service, base, SEGMENTS)


TILES_CLASSES = ("core", "tileset", "tilesets-list", "dataset-tilesets", "geodata-tilesets", "mvt")
"""The conformance classes of OGC API Tiles that hold of the routes here. ``oas30`` is of the document of all routes."""

FormatQuery = Annotated[str | None, Query(description="`json`.")]
TilesetFormat = Annotated[str | None, Query(description="`json`, or `tilejson` for TileJSON 3.")]
TileFormat = Annotated[str | None, Query(description="`mvt`; `pbf` is the same.")]
Collection = Annotated[
    str, Path(description=f"One of: {', '.join(LAYERS)}.", examples=[SEGMENTS], alias="collection")
]
Matrix = Annotated[
    int, Path(ge=0, le=DEEPEST_ZOOM, description="Zoom level.", examples=[14], alias="tileMatrix")
]
Row = Annotated[int, Path(ge=0, description="Row from the north.", examples=[5634], alias="tileRow")]
Column = Annotated[
    int, Path(ge=0, description="Column from the antimeridian eastwards.", examples=[8579], alias="tileCol")
]

ogc_router = APIRouter(tags=["tiles"], route_class=MapRoute)

_LIST: dict[int | str, dict[str, Any]] = {
    200: json_answer(
        "One tileset.", {"links": [], "tilesets": [{"title": "Road slopes", "dataType": "vector"}]}
    ),
    **problems(400, 404, 503),
}
_TILESET: dict[int | str, dict[str, Any]] = {
    200: json_answer(
        "The tileset.", {"title": "Road slopes", "dataType": "vector", "crs": documents.WEB_MERCATOR}
    ),
    **problems(400, 404, 503),
}
_TILE: dict[int | str, dict[str, Any]] = {200: MVT_ANSWER, **EMPTY, **problems(400, 404, 503)}


@ogc_router.get(
    "/tileMatrixSets",
    summary="Tile matrix sets",
    responses={200: json_answer("One.", {"tileMatrixSets": [{"id": QUAD}]}), **problems(400)},
)
def matrix_sets(request: Request, base: BaseUrl, f: FormatQuery = None) -> dict[str, Any]:
    """There is one: that of all maps on the web."""
    _only(request, f, ("json",))
    links = link_documents([link(f"{base}/tileMatrixSets/{QUAD}", "self", title="Its definition")])
    one = {"id": QUAD, "title": documents.QUAD_TITLE, "uri": documents.QUAD_URI, "links": links}
    return {"tileMatrixSets": [one]}


@ogc_router.get(
    f"/tileMatrixSets/{QUAD}",
    summary="The tile matrix set",
    responses={
        200: json_answer("The definition.", {"id": QUAD, "crs": documents.WEB_MERCATOR}),
        **problems(400),
    },
)
def matrix_set(request: Request, f: FormatQuery = None) -> dict[str, Any]:
    """Which tiles there are at each zoom level, and where (OGC 17-083r4)."""
    _only(request, f, ("json",))
    return documents.matrix_set_document()


@ogc_router.get("/tiles", summary="Tilesets of the whole", responses=_LIST)
def tilesets(request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None) -> dict[str, Any]:
    """There is one: vector tiles of all segments."""
    _only(request, f, ("json",))
    return documents.tilesets_document(service, base, f"{base}/tiles", SEGMENTS)


@ogc_router.get(f"/tiles/{QUAD}", summary="The tileset of the whole", responses=_TILESET)
def tileset(request: Request, service: ServiceDep, base: BaseUrl, f: TilesetFormat = None) -> dict[str, Any]:
    """Where its tiles are, what is in them, and which there are."""
    return _tileset(request, service, base, SEGMENTS, f"{base}/tiles", f)


@ogc_router.get("/collections/{collection}/tiles", summary="Tilesets of a collection", responses=_LIST)
def collection_tilesets(
    collection: Collection, request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None
) -> dict[str, Any]:
    """There is one: vector tiles."""
    layer = _layer(collection)
    _only(request, f, ("json",))
    return documents.tilesets_document(service, base, f"{base}/collections/{layer}/tiles", layer)


@ogc_router.get(
    f"/collections/{{collection}}/tiles/{QUAD}", summary="The tileset of a collection", responses=_TILESET
)
def collection_tileset(
    collection: Collection, request: Request, service: ServiceDep, base: BaseUrl, f: TilesetFormat = None
) -> dict[str, Any]:
    """Where its tiles are, what is in them, and which there are."""
    layer = _layer(collection)
    return _tileset(request, service, base, layer, f"{base}/collections/{layer}/tiles", f)


def _tileset(
    request: Request, service: Service, base: str, layer: str, here: str, f: str | None
) -> dict[str, Any]:
    _only(request, f, ("json", "tilejson"))
    if f == "tilejson":
        return documents.tilejson(service, base, layer)
    return documents.tileset_document(service, base, here, layer)


async def tile(
    matrix: Matrix, row: Row, column: Column, request: Request, service: ServiceDep, f: TileFormat = None
) -> Response:
    """The vector tile, as under /tiles/{z}/{x}/{y}.mvt; here the row comes first."""
    _only(request, f, SUFFIXES, to_whom=("f", "collections"))
    return await _tile_of(request, service, Address(SEGMENTS, matrix, column, row))


async def collection_tile(
    collection: Collection,
    matrix: Matrix,
    row: Row,
    column: Column,
    request: Request,
    service: ServiceDep,
    f: TileFormat = None,
) -> Response:
    """The vector tile of a collection."""
    layer = _layer(collection)
    _only(request, f, SUFFIXES)
    return await _tile_of(request, service, Address(layer, matrix, column, row))


for _suffix in (*(f".{suffix}" for suffix in SUFFIXES), ""):  # without one the whole part is the column
    _named = f" ({_suffix})" if _suffix else ""
    for _above, _route, _of in (
        ("", tile, "the whole"),
        ("/collections/{collection}", collection_tile, "a collection"),
    ):
        ogc_router.add_api_route(
            f"{_above}/tiles/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}{_suffix}",
            _route,
            summary=f"Vector tile of {_of}{_named}",
            response_class=Response,
            responses=_TILE,
        )


async def _tile_of(request: Request, service: Service, at: Address) -> Response:
    check_tile(at, service.settings.tile_max_zoom, ("tileMatrix", "tileCol", "tileRow"))
    return await vector_tile(request, at)


def _layer(collection: str) -> str:
    if collection not in LAYERS:
        raise NotFoundError(
            say("items.no_collection", name=collection[:50], names=", ".join(LAYERS)), field="collection"
        )
    return collection


def _only(
    request: Request, f: str | None, formats: tuple[str, ...], to_whom: tuple[str, ...] = ("f",)
) -> None:
    refuse_unknown(request, frozenset(to_whom))
    if f not in {None, *formats}:
        raise BadQueryError(
            f"There is no format {f[:50]!r} here. There is: {', '.join(formats)}."
            if f
            else "f names no format.",
            field="f",
        )
    collections = request.query_params.get("collections")
    if collections not in {None, "", SEGMENTS}:
        raise BadQueryError(
            say("tiles.of_the_whole", name=SEGMENTS),
            field="collections",
        )
