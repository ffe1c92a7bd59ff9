"""What OGC API Tiles tells of tilesets and of their tile matrix set, as JSON documents."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from app.core.http import Link, Service, link, link_documents
from app.core.settings import Settings
from app.map.coverage import cached_extent, dem_names, elevation_credits
from app.map.segment import CRS84, OSM_LICENSE, OSM_LICENSE_URL, attribution, attribution_html
from app.map.tiles.front import MVT, QUAD
from app.map.tiles.store import EDGE_DEG, SEGMENTS, WAYS, column_of, row_of
from app.map.tiles.tiles import WAYS_FROM_ZOOM

FIELDS = {
    "slope_percent": "Number; percent, positive uphill from from_node to to_node; absent: unknown",
    "slope_sigma_percent": "Number; one standard deviation, percent; absent: unknown",
    "drives": "Number; drives behind the slope",
    "highway": "String; the road's class in OpenStreetMap",
    "oneway": "Number; 1 along the way, -1 against it, 0 both",
}
SEGMENT_FIELDS = {
    **FIELDS,
    "bridge": "Boolean; true on a bridge, else absent; where single segments are drawn",
    "tunnel": "Boolean; true in a tunnel, else absent; where single segments are drawn",
    "dem_slope_percent": "Number; percent, by the elevation model alone; absent: unknown; where single segments are "
    "drawn",
}


@dataclass(frozen=True)
class About:
    """What documents say of a layer."""

    title: str
    description: str
    feature: str
    """What one of them is."""
    fields: dict[str, str]


ABOUT = {
    SEGMENTS: About(
        "Versant road slopes",
        "Slopes of road segments, measured by vehicles",
        "Road segments",
        SEGMENT_FIELDS,
    ),
    WAYS: About(
        "Versant slopes of ways",
        "Slopes of roads from junction to junction or as long as an OpenStreetMap way goes on, measured by vehicles",
        "Consecutive segments of one OpenStreetMap way",
        {
            **FIELDS,
            "steepest_percent": "Number; mean grade over the steepest 20 m, percent, signed; absent: unknown",
        },
    ),
}


def kinds(fields: dict[str, str]) -> dict[str, str]:
    """What each field is, ``Number``, ``String`` or ``Boolean``: GDAL takes it for one only where no more is said."""
    return {name: words.partition(";")[0] for name, words in fields.items()}


WEB_MERCATOR = "http://www.opengis.net/def/crs/EPSG/0/3857"
QUAD_TITLE = "Web Mercator, by quarters"
QUAD_URI = f"http://www.opengis.net/def/tilematrixset/OGC/1.0/{QUAD}"
SCHEME_REL = "http://www.opengis.net/def/rel/ogc/1.0/tiling-scheme"
SCHEMES_REL = "http://www.opengis.net/def/rel/ogc/1.0/tiling-schemes"
VECTOR_REL = "http://www.opengis.net/def/rel/ogc/1.0/tilesets-vector"
_OF_TILESETS = {"dataType": "vector", "crs": WEB_MERCATOR, "tileMatrixSetURI": QUAD_URI}
TILEJSON_TYPE = "application/vnd.mapbox.tile+json"

DEEPEST_MATRIX = 24
"""The last zoom level that settings allow."""

_HALF_M = math.pi * 6_378_137
_PIXELS = 256
_PIXEL_M = 0.00028
"""Side of a pixel on the screen that scale denominators are stated for (the standard's)."""


def tilesets_link(base: str, layer: str | None = None) -> Link:
    """The link to vector tilesets that a landing page has, or the document of the collection ``layer``."""
    here = base if layer is None else f"{base}/collections/{layer}"
    return link(f"{here}/tiles", VECTOR_REL, title="Vector tiles")


def matrix_set_document() -> dict[str, Any]:
    """The definition of the tile matrix set (OGC 17-083r4)."""
    return {
        "id": QUAD,
        "title": QUAD_TITLE,
        "uri": QUAD_URI,
        "crs": WEB_MERCATOR,
        "orderedAxes": ["X", "Y"],
        "wellKnownScaleSet": "http://www.opengis.net/def/wkss/OGC/1.0/GoogleMapsCompatible",
        "tileMatrices": [_matrix(z) for z in range(DEEPEST_MATRIX + 1)],
    }


def tilesets_document(service: Service, base: str, here: str, layer: str) -> dict[str, Any]:
    """The list of tilesets of the whole or of a collection, at the address ``here``."""
    about = ABOUT[layer]
    with service.reading() as session:
        said = {"attribution": attribution(dem_names(service, session)), **service.edition_note(session)}
    own = [
        link(f"{here}/{QUAD}", "self", title="The tileset"),
        link(f"{base}/tileMatrixSets/{QUAD}", SCHEME_REL, title="Its tile matrix set"),
    ]
    one = {"title": about.title, **_OF_TILESETS, "links": link_documents(own)}
    links = [link(here, "self"), link(f"{base}/tileMatrixSets", SCHEMES_REL, title="Tile matrix sets")]
    return {**said, "links": link_documents(links), "tilesets": [one]}


def tileset_document(service: Service, base: str, here: str, layer: str) -> dict[str, Any]:
    """The metadata of a tileset; ``here``: of the list that it is in."""
    about, settings = ABOUT[layer], service.settings
    with service.reading() as session:
        bounds = cached_extent(service, session)
        said = {"attribution": attribution(dem_names(service, session)), **service.edition_note(session)}
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
        **said,
        **_OF_TILESETS,
        "tileMatrixSetLimits": [
            _limits(z, bounds or (-180.0, -EDGE_DEG, 180.0, EDGE_DEG))
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
    types = {"Number": "number", "String": "string", "Boolean": "boolean"}
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
    return {
        "tileMatrix": str(z),
        "minTileCol": column_of(z, west),
        "maxTileCol": column_of(z, east),
        "minTileRow": row_of(z, north),
        "maxTileRow": row_of(z, south),
    }


def tilejson(service: Service, base: str, layer: str) -> dict[str, Any]:
    """The TileJSON 3 document of a layer's tiles."""
    with service.reading() as session:
        bounds = cached_extent(service, session)
        said = {
            "attribution": attribution_html(dem_names(service, session)),
            "versant:elevation": elevation_credits(service, session),
            **service.edition_note(session),
        }
    about = ABOUT[layer]
    zooms = {"minzoom": lowest_zoom(service.settings, layer), "maxzoom": service.settings.tile_max_zoom}
    elsewhere = f"/collections/{layer}/tiles/{QUAD}/{{z}}/{{y}}/{{x}}.mvt"
    tiles = "/tiles/{z}/{x}/{y}.mvt" if layer == SEGMENTS else elsewhere
    document: dict[str, Any] = {
        "tilejson": "3.0.0",
        "name": about.title,
        "description": about.description,
        "scheme": "xyz",
        "tiles": [base + tiles],
        "vector_layers": [
            {"id": layer, "description": about.feature, "fields": kinds(about.fields), **zooms}
        ],
        **said,
        **zooms,
    }
    if bounds is not None:
        west, south, east, north = bounds
        document["bounds"] = list(bounds)
        document["center"] = [(west + east) / 2, (south + north) / 2, max(zooms["minzoom"], 12)]
    return document


def lowest_zoom(settings: Settings, layer: str) -> int:
    """The lowest zoom at which a layer's tiles hold anything."""
    return max(settings.tile_min_zoom, WAYS_FROM_ZOOM) if layer == WAYS else settings.tile_min_zoom
