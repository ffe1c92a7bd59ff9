"""OGC API Tiles, part 1: tilesets of the whole and of each collection, and the one tile matrix set that they use.

The tiles are those of ``/tiles/{z}/{x}/{y}.mvt``, with the row before the column as the standard has it. A tileset of
the whole holds the segments: ways are the same roads once more.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from app.core.errors import BadQueryError, NotFoundError
from app.core.http import (
    BaseUrl,
    Service,
    ServiceDep,
    json_answer,
    link,
    link_documents,
    problems,
)
from app.core.query import refuse_unknown
from app.map.attribution import OSM_LICENSE, OSM_LICENSE_URL, attribution
from app.map.coverage import cached_extent, dem_names
from app.map.tiles.answers import DEEPEST_ZOOM, LAYERS, MVT, QUAD, SUFFIXES, check_tile
from app.map.tiles.routes import ABOUT, EMPTY, MVT_ANSWER, lowest_zoom, tilejson, vector_tile
from app.map.tiles.store import SEGMENTS, Address

_CLASSES = "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/"
TILES_CONFORMANCE = tuple(
    _CLASSES + name
    for name in ("core", "tileset", "tilesets-list", "dataset-tilesets", "geodata-tilesets", "mvt")
)
"""What holds of the routes here. ``oas30`` is of the document of all routes."""

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
WEB_MERCATOR = "http://www.opengis.net/def/crs/EPSG/0/3857"
QUAD_URI = f"http://www.opengis.net/def/tilematrixset/OGC/1.0/{QUAD}"
SCHEME_REL = "http://www.opengis.net/def/rel/ogc/1.0/tiling-scheme"
SCHEMES_REL = "http://www.opengis.net/def/rel/ogc/1.0/tiling-schemes"
VECTOR_REL = "http://www.opengis.net/def/rel/ogc/1.0/tilesets-vector"
TILEJSON_TYPE = "application/vnd.mapbox.tile+json"

_HALF_M = math.pi * 6_378_137
_PIXELS = 256
_PIXEL_M = 0.00028
"""Side of a pixel on the screen that scale denominators are stated for (the standard's)."""
_EASE = 85.0511287798066
"""Latitude at which the square of the map ends, degrees."""

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

router = APIRouter(tags=["tiles"])

_LIST: dict[int | str, dict[str, Any]] = {
    200: json_answer(
        "One tileset.", {"links": [], "tilesets": [{"title": "Road slopes", "dataType": "vector"}]}
    ),
    **problems(400, 404, 503),
}
_TILESET: dict[int | str, dict[str, Any]] = {
    200: json_answer("The tileset.", {"title": "Road slopes", "dataType": "vector", "crs": WEB_MERCATOR}),
    **problems(400, 404, 503),
}
_TILE: dict[int | str, dict[str, Any]] = {200: MVT_ANSWER, **EMPTY, **problems(400, 404, 503)}


@router.get(
    "/tileMatrixSets",
    summary="Tile matrix sets",
    responses={200: json_answer("One.", {"tileMatrixSets": [{"id": QUAD}]}), **problems(400)},
)
def matrix_sets(request: Request, base: BaseUrl, f: FormatQuery = None) -> dict[str, Any]:
    """There is one: that of all maps on the web."""
    _only(request, f, ("json",))
    links = [link(f"{base}/tileMatrixSets/{QUAD}", "self", title="Its definition")]
    return {
        "tileMatrixSets": [
            {
                "id": QUAD,
                "title": "Web Mercator, by quarters",
                "uri": QUAD_URI,
                "links": link_documents(links),
            }
        ]
    }


@router.get(
    f"/tileMatrixSets/{QUAD}",
    summary="The tile matrix set",
    responses={200: json_answer("The definition.", {"id": QUAD, "crs": WEB_MERCATOR}), **problems(400)},
)
def matrix_set(request: Request, f: FormatQuery = None) -> dict[str, Any]:
    """Which tiles there are at each zoom level, and where (OGC 17-083r4)."""
    _only(request, f, ("json",))
    return {
        "id": QUAD,
        "title": "Web Mercator, by quarters",
        "uri": QUAD_URI,
        "crs": WEB_MERCATOR,
        "orderedAxes": ["X", "Y"],
        "wellKnownScaleSet": "http://www.opengis.net/def/wkss/OGC/1.0/GoogleMapsCompatible",
        "tileMatrices": [_matrix(z) for z in range(25)],
    }


@router.get("/tiles", summary="Tilesets of the whole", responses=_LIST)
def tilesets(request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None) -> dict[str, Any]:
    """There is one: vector tiles of all segments."""
    _only(request, f, ("json",))
    return _list(service, base, f"{base}/tiles", SEGMENTS)


@router.get(f"/tiles/{QUAD}", summary="The tileset of the whole", responses=_TILESET)
def tileset(request: Request, service: ServiceDep, base: BaseUrl, f: TilesetFormat = None) -> dict[str, Any]:
    """Where its tiles are, what is in them, and which there are."""
    _only(request, f, ("json", "tilejson"))
    if f == "tilejson":
        return tilejson(service, base, SEGMENTS)
    return _tileset(service, base, f"{base}/tiles", SEGMENTS)


@router.get("/collections/{collection}/tiles", summary="Tilesets of a collection", responses=_LIST)
def collection_tilesets(
    collection: Collection, request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None
) -> dict[str, Any]:
    """There is one: vector tiles."""
    layer = _layer(collection)
    _only(request, f, ("json",))
    return _list(service, base, f"{base}/collections/{layer}/tiles", layer)


@router.get(
    f"/collections/{{collection}}/tiles/{QUAD}", summary="The tileset of a collection", responses=_TILESET
)
def collection_tileset(
    collection: Collection, request: Request, service: ServiceDep, base: BaseUrl, f: TilesetFormat = None
) -> dict[str, Any]:
    """Where its tiles are, what is in them, and which there are."""
    layer = _layer(collection)
    _only(request, f, ("json", "tilejson"))
    if f == "tilejson":
        return tilejson(service, base, layer)
    return _tileset(service, base, f"{base}/collections/{layer}/tiles", layer)


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


_PLACE = "{tileMatrix}/{tileRow}/{tileCol}"
for _suffix in ("", *(f".{suffix}" for suffix in SUFFIXES)):
    _named = f" ({_suffix})" if _suffix else ""
    for _path, _route, _title in (
        (f"/tiles/{QUAD}/{_PLACE}", tile, "Vector tile of the whole"),
        (
            f"/collections/{{collection}}/tiles/{QUAD}/{_PLACE}",
            collection_tile,
            "Vector tile of a collection",
        ),
    ):
        router.add_api_route(
            _path + _suffix, _route, summary=_title + _named, response_class=Response, responses=_TILE
        )


async def _tile_of(request: Request, service: Service, at: Address) -> Response:
    check_tile(at, service.settings.tile_max_zoom, ("tileMatrix", "tileCol", "tileRow"))
    return await vector_tile(request, at)


def _layer(collection: str) -> str:
    if collection not in LAYERS:
        raise NotFoundError(
            f"There is no collection {collection[:50]!r}. There are: {', '.join(LAYERS)}.", field="collection"
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
    wanted = request.query_params.get("collections")
    if wanted not in {None, "", SEGMENTS}:
        raise BadQueryError(
            f"The tiles of the whole hold the collection {SEGMENTS}; others have tiles of their own.",
            field="collections",
        )


def _list(service: Service, base: str, here: str, layer: str) -> dict[str, Any]:
    about = ABOUT[layer]
    with service.reading() as session:
        source = attribution(dem_names(service, session))
    one = {
        "title": about.title,
        "dataType": "vector",
        "crs": WEB_MERCATOR,
        "tileMatrixSetURI": QUAD_URI,
        "links": link_documents(
            [
                link(f"{here}/{QUAD}", "self", title="The tileset"),
                link(f"{base}/tileMatrixSets/{QUAD}", SCHEME_REL, title="Its tile matrix set"),
            ]
        ),
    }
    links = [link(here, "self"), link(f"{base}/tileMatrixSets", SCHEMES_REL, title="Tile matrix sets")]
    return {"attribution": source, "links": link_documents(links), "tilesets": [one]}


def _tileset(service: Service, base: str, here: str, layer: str) -> dict[str, Any]:
    about, settings = ABOUT[layer], service.settings
    with service.reading() as session:
        bounds = cached_extent(service, session)
        source = attribution(dem_names(service, session))
    lowest = lowest_zoom(settings, layer)
    template = link(f"{here}/{QUAD}/{{tileMatrix}}/{{tileRow}}/{{tileCol}}", "item", MVT, "The tiles")
    links = [
        link(f"{here}/{QUAD}", "self"),
        link(f"{here}/{QUAD}?f=tilejson", "alternate", TILEJSON_TYPE, "TileJSON 3"),
        link(f"{base}/tileMatrixSets/{QUAD}", SCHEME_REL, title="Its tile matrix set"),
        link(f"{base}/collections/{layer}", "http://www.opengis.net/def/rel/ogc/1.0/geodata"),
        link(OSM_LICENSE_URL, "license", "text/html", OSM_LICENSE),
    ]
    document: dict[str, Any] = {
        "title": about.title,
        "description": about.description,
        "attribution": source,
        "dataType": "vector",
        "crs": WEB_MERCATOR,
        "tileMatrixSetURI": QUAD_URI,
        "tileMatrixSetLimits": [
            _limits(z, bounds or (-180.0, -_EASE, 180.0, _EASE))
            for z in range(lowest, settings.tile_max_zoom + 1)
        ],
        "layers": [_described(layer, lowest, settings.tile_max_zoom)],
        "links": [*link_documents(links), {**link_documents([template])[0], "templated": True}],
    }
    if bounds is not None:
        west, south, east, north = bounds
        document["boundingBox"] = {"lowerLeft": [west, south], "upperRight": [east, north], "crs": CRS84}
    return document


def _described(layer: str, lowest: int, highest: int) -> dict[str, Any]:
    """The layer as a tileset's metadata have it, its properties as a JSON schema."""
    about = ABOUT[layer]
    types = {"Number": "number", "String": "string"}
    properties = {
        name: {"title": name, "description": words.partition("; ")[2], "type": types[words.partition(";")[0]]}
        for name, words in about.fields.items()
    }
    return {
        "id": layer,
        "title": about.title,
        "description": about.feature,
        "dataType": "vector",
        "geometryDimension": 1,
        "minTileMatrix": str(lowest),
        "maxTileMatrix": str(highest),
        "propertiesSchema": {"type": "object", "properties": properties},
    }


def _matrix(z: int) -> dict[str, Any]:
    cell_m = 2 * _HALF_M / _PIXELS / 2**z
    return {
        "id": str(z),
        "scaleDenominator": cell_m / _PIXEL_M,
        "cellSize": cell_m,
        "cornerOfOrigin": "topLeft",
        "pointOfOrigin": [-_HALF_M, _HALF_M],
        "tileWidth": _PIXELS,
        "tileHeight": _PIXELS,
        "matrixWidth": 2**z,
        "matrixHeight": 2**z,
    }


def _limits(z: int, bounds: tuple[float, float, float, float]) -> dict[str, Any]:
    """The tiles of a zoom that a box (degrees) meets."""
    west, south, east, north = bounds
    if west > east:
        west, east = -180.0, 180.0
    columns = [_column(z, longitude) for longitude in (west, east)]
    rows = [_row(z, latitude) for latitude in (north, south)]
    return {
        "tileMatrix": str(z),
        "minTileCol": columns[0],
        "maxTileCol": columns[1],
        "minTileRow": rows[0],
        "maxTileRow": rows[1],
    }


def _column(z: int, longitude: float) -> int:
    return min((1 << z) - 1, max(0, int((longitude + 180) / 360 * 2**z)))


def _row(z: int, latitude: float) -> int:
    bounded = math.radians(min(_EASE, max(-_EASE, latitude)))
    return min((1 << z) - 1, max(0, int((1 - math.asinh(math.tan(bounded)) / math.pi) / 2 * 2**z)))
