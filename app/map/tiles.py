"""Map tiles: Mapbox vector tiles and GeoJSON, with TileJSON 3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response
from sqlalchemy.orm import Session

from app.core.errors import NotFoundError
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    Service,
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
from app.map import store as tiles
from app.map.attribution import attribution, attribution_html
from app.map.coverage import cached_extent, dem_names
from app.map.segment import HEIGHT_DATUM
from app.map.segments import MAX_ID, SEGMENT_EXAMPLE
from app.network.cells import tile_tag
from app.terrain.store import dem_version_id

MVT = "application/vnd.mapbox-vector-tile"
TILE_SCHEMA = 3
"""Raise it whenever tiles change without their data changing, so that caches notice."""
FIELDS = {
    "slope_percent": "Number; percent, positive uphill from from_node to to_node; absent: unknown",
    "slope_sigma_percent": "Number; one standard deviation, percent; absent: unknown",
    "drives": "Number; drives behind the slope",
    "highway": "String; the road's class in OpenStreetMap",
    "oneway": "Number; 1 along the way, -1 against it, 0 both",
}
EXAMPLE = {
    "tilejson": "3.0.0",
    "tiles": ["http://127.0.0.1:8000/tiles/{z}/{x}/{y}.mvt"],
    "vector_layers": [{"id": tiles.LAYER, "fields": FIELDS}],
}

ZoomPath = Annotated[int, Path(ge=0, le=30, description="Zoom level.", examples=[14])]
ColumnPath = Annotated[
    int, Path(ge=0, description="Column from the antimeridian eastwards.", examples=[8579])
]
RowPath = Annotated[int, Path(ge=0, description="Row from the north.", examples=[5634])]

router = APIRouter(tags=["tiles"])

_EMPTY: dict[int | str, dict[str, Any]] = {
    204: {"description": "The tile holds nothing."},
    304: {"description": "Unchanged since the ETag."},
}


@router.get(
    "/tiles/{z}/{x}/{y}.mvt",
    summary="Vector tile",
    response_class=Response,
    responses={
        200: {
            "description": "The tile, layer `segments`, the segment's id as the feature's id.",
            "content": {MVT: {"schema": {"type": "string", "format": "binary"}}},
        },
        **_EMPTY,
        **problems(404, 503),
    },
)
def mvt_tile(z: ZoomPath, x: ColumnPath, y: RowPath, request: Request, service: ServiceDep) -> Response:
    """What a map draws. Revalidate with If-None-Match: an unchanged map answers 304."""

    def build(session: Session) -> Response:
        full_zoom = service.settings.tile_full_zoom
        shown = z >= service.settings.tile_min_zoom
        data = tiles.mvt(session, z, x, y, full_zoom=full_zoom) if shown else b""
        return Response(data, media_type=MVT) if data else Response(status_code=204)

    return _answer(request, service, (z, x, y), build)


@router.get(
    "/tiles/{z}/{x}/{y}.geojson",
    summary="GeoJSON tile",
    response_class=Response,
    responses={
        200: geojson_answer("One page of the segments that meet the tile, whole.", SEGMENT_EXAMPLE),
        304: _EMPTY[304],
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

    def build(session: Session) -> Response:
        full_zoom, most = service.settings.tile_full_zoom, service.settings.tile_features_max
        rows = []
        if z >= service.settings.tile_min_zoom:
            # One more than shown tells whether there is a next page.
            rows = tiles.geojson_tile(session, z, x, y, full_zoom=full_zoom, after_id=after, limit=most + 1)
        shown = rows[:most]
        here = f"{base}/tiles/{z}/{x}/{y}.geojson"
        links = [link(with_query(here, after=after or None), "self", GEO_JSON)]
        if len(rows) > most:
            title = f"The tile holds more than these {most} segments: the next ones"
            links.append(link(with_query(here, after=shown[-1].id), "next", GEO_JSON, title))
        return geojson_response(
            {
                "type": "FeatureCollection",
                "attribution": attribution(dem_names(service, session, shown)),
                "height_datum": HEIGHT_DATUM,
                "numberReturned": len(shown),
                "links": link_documents(links),
                "features": (row.geojson() for row in shown),
            }
        )

    return _answer(request, service, (z, x, y), build, with_source=True)


@router.get(
    "/tiles.json", summary="TileJSON", responses={200: json_answer("TileJSON 3.0.", EXAMPLE), **problems(503)}
)
def tile_json(service: ServiceDep, base: BaseUrl) -> dict[str, Any]:
    """What a map needs to know about the vector tiles."""
    settings = service.settings
    with service.reading() as session:
        bounds = cached_extent(service, session)
        names = dem_names(service, session)
    zooms = {"minzoom": settings.tile_min_zoom, "maxzoom": settings.tile_max_zoom}
    document: dict[str, Any] = {
        "tilejson": "3.0.0",
        "name": "Versant road slopes",
        "description": "Slopes of road segments, measured by vehicles",
        "scheme": "xyz",
        "tiles": [f"{base}/tiles/{{z}}/{{x}}/{{y}}.mvt"],
        "vector_layers": [{"id": tiles.LAYER, "description": "Road segments", "fields": FIELDS, **zooms}],
        "attribution": attribution_html(names),
        **zooms,
    }
    if bounds is not None:
        west, south, east, north = bounds
        document["bounds"] = list(bounds)
        document["center"] = [(west + east) / 2, (south + north) / 2, max(settings.tile_min_zoom, 12)]
    return document


def _answer(
    request: Request,
    service: Service,
    tile: tuple[int, int, int],
    build: Callable[[Session], Response],
    *,
    with_source: bool = False,
) -> Response:
    """The tile, or 304; ``with_source``: it names the elevation rasters, too."""
    _check_tile(tile, service.settings.tile_max_zoom)
    with service.reading() as session:
        # The version first: a tile newer than its tag is only fetched once more, an older one would stay.
        tag = tile_tag(session, *tile)
        if with_source:
            tag += f".{dem_version_id(session)}"
        etag = f'W/"{tag}-{TILE_SCHEMA}.{service.settings.tile_min_zoom}.{service.settings.tile_full_zoom}"'
        response = Response(status_code=304) if etag_matches(request, etag) else build(session)
    response.headers["ETag"] = etag
    response.headers["Cache-Control"] = REVALIDATE
    return response


def _check_tile(tile: tuple[int, int, int], max_zoom: int) -> None:
    z, x, y = tile
    if z > max_zoom:
        raise NotFoundError(f"Tiles end at zoom {max_zoom}; enlarge those for zoom {z}.", field="z")
    for name, number in (("x", x), ("y", y)):
        if number >= 2**z:
            raise NotFoundError(
                f"At zoom {z}, {name} goes from 0 to {2**z - 1}; {number} is outside.", field=name
            )
