"""OGC API Tiles, part 1: tilesets of the whole and of each collection, and the one tile matrix set that they use.

The tiles are those of ``/tiles/{z}/{x}/{y}.mvt``, with the row before the column as the standard has it. A tileset of
the whole holds the segments: ways are the same roads once more.
"""

from __future__ import annotations

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
from app.map.tiles.documents import (
    QUAD_URI,
    WEB_MERCATOR,
    matrix_set_document,
    tilejson,
    tileset_document,
    tilesets_document,
)
from app.map.tiles.front import DEEPEST_ZOOM, LAYERS, QUAD, SUFFIXES, check_tile
from app.map.tiles.routes import EMPTY, MVT_ANSWER, vector_tile
from app.map.tiles.store import SEGMENTS, Address

_CLASSES = "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/"
TILES_CONFORMANCE = tuple(
    _CLASSES + name
    for name in ("core", "tileset", "tilesets-list", "dataset-tilesets", "geodata-tilesets", "mvt")
)
"""What holds of the routes here. ``oas30`` is of the document of all routes."""

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
    return matrix_set_document()


@router.get("/tiles", summary="Tilesets of the whole", responses=_LIST)
def tilesets(request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None) -> dict[str, Any]:
    """There is one: vector tiles of all segments."""
    _only(request, f, ("json",))
    return tilesets_document(service, base, f"{base}/tiles", SEGMENTS)


@router.get(f"/tiles/{QUAD}", summary="The tileset of the whole", responses=_TILESET)
def tileset(request: Request, service: ServiceDep, base: BaseUrl, f: TilesetFormat = None) -> dict[str, Any]:
    """Where its tiles are, what is in them, and which there are."""
    _only(request, f, ("json", "tilejson"))
    if f == "tilejson":
        return tilejson(service, base, SEGMENTS)
    return tileset_document(service, base, f"{base}/tiles", SEGMENTS)


@router.get("/collections/{collection}/tiles", summary="Tilesets of a collection", responses=_LIST)
def collection_tilesets(
    collection: Collection, request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None
) -> dict[str, Any]:
    """There is one: vector tiles."""
    layer = _layer(collection)
    _only(request, f, ("json",))
    return tilesets_document(service, base, f"{base}/collections/{layer}/tiles", layer)


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
    return tileset_document(service, base, f"{base}/collections/{layer}/tiles", layer)


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
for _suffix in (*(f".{suffix}" for suffix in SUFFIXES), ""):  # without one the whole part is the column
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
    collections = request.query_params.get("collections")
    if collections not in {None, "", SEGMENTS}:
        raise BadQueryError(
            f"The tiles of the whole hold the collection {SEGMENTS}; others have tiles of their own.",
            field="collections",
        )
