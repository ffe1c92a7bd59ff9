"""The landing page and the conformance classes."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from app.core.http import JSON, BaseUrl, link, link_documents
from app.core.query import refuse_unknown
from app.map.attribution import attribution
from app.map.items.api import OPENAPI_30, OPENAPI_31
from app.map.items.negotiation import AS_HTML, AS_JSON, HTML, FormatQuery, wanted
from app.map.items.pages import described, document_answer
from app.map.tiles.documents import SCHEMES_REL, tilesets_link
from app.map.tiles.ogc_routes import TILES_CONFORMANCE

BIND_NOTE = (
    "There is no access control yet: the service listens only on this machine's loopback address unless it "
    "is told otherwise (VERSANT_HOST, --host). Whoever reaches it can read, upload and delete drives."
)
_FEATURES = "http://www.opengis.net/spec/ogcapi-features-"
CORE_CLASSES = (
    f"{_FEATURES}1/1.0/conf/core",
    f"{_FEATURES}1/1.0/conf/oas30",
    f"{_FEATURES}1/1.0/conf/html",
    f"{_FEATURES}1/1.0/conf/geojson",
)
"""Each is declared because the tests that are named after its abstract tests hold (``tests/app/map/items``)."""
CRS_CLASSES = (f"{_FEATURES}2/1.0/conf/crs",)
QUERY_CLASSES = (
    f"{_FEATURES}3/1.0/conf/queryables",
    f"{_FEATURES}3/1.0/conf/queryables-query-parameters",
    f"{_FEATURES}3/1.0/conf/filter",
    f"{_FEATURES}3/1.0/conf/features-filter",
)
_CQL2 = "http://www.opengis.net/spec/cql2/1.0/conf/"
CQL2_CLASSES = tuple(
    _CQL2 + name
    for name in (
        "cql2-text",
        "cql2-json",
        "basic-cql2",
        "advanced-comparison-operators",
        "case-insensitive-comparison",
        "accent-insensitive-comparison",
        "basic-spatial-functions",
        "basic-spatial-functions-plus",
        "spatial-functions",
        "temporal-functions",
        "property-property",
        "arithmetic",
    )
)
SCHEMA_CLASSES = (
    f"{_FEATURES}5/1.0/conf/schemas",
    f"{_FEATURES}5/1.0/conf/core-roles-features",
    f"{_FEATURES}5/1.0/conf/returnables-and-receivables",
)
CONFORMANCE = (
    *CORE_CLASSES,
    *CRS_CLASSES,
    *QUERY_CLASSES,
    *CQL2_CLASSES,
    *SCHEMA_CLASSES,
    *TILES_CONFORMANCE,
)

router = APIRouter(tags=["map"])


@router.get(
    "/",
    summary="Landing page",
    response_class=Response,
    responses=described("Links to all there is.", {JSON: {"links": []}}, 400, 406),
)
def landing(request: Request, base: BaseUrl, f: FormatQuery = None) -> Response:
    """Where everything is."""
    refuse_unknown(request, {"f"})
    form = wanted(request, f, AS_JSON, AS_HTML)
    links = [
        *form.links(f"{base}/"),
        link(
            f"{base}/openapi.json?f={OPENAPI_30.names[0]}",
            "service-desc",
            OPENAPI_30.media_types[0],
            "The API, OpenAPI 3.0",
        ),
        link(f"{base}/openapi.json", "service-desc", OPENAPI_31.media_types[0], "The API, OpenAPI 3.1"),
        link(f"{base}/docs", "service-doc", HTML, "The documentation, for people"),
        link(f"{base}/conformance", "conformance", title="Conformance classes"),
        link(f"{base}/collections", "data", title="Collections"),
        link(f"{base}/tiles.json", "tiles", title="Vector tiles, TileJSON 3"),
        tilesets_link(base),
        link(f"{base}/tileMatrixSets", SCHEMES_REL, title="Tile matrix sets"),
        link(f"{base}/style.json", "style", title="A style for maps in a browser"),
        link(f"{base}/v1/changes", "changes", title="What changed since a version"),
        link(f"{base}/v1/exports", "exports", title="Files of the map"),
        link(f"{base}/v1/drives", "drives", title="Uploaded drives"),
    ]
    document: dict[str, Any] = {
        "title": "Versant",
        "description": f"Slopes of roads from vehicle logs. {BIND_NOTE}",
        "attribution": attribution(),
        "links": link_documents(links),
    }
    return document_answer(request, form, document, links, template="landing.html", title="Versant")


@router.get(
    "/conformance",
    summary="Conformance classes",
    response_class=Response,
    responses=described("The classes.", {JSON: {"conformsTo": list(CONFORMANCE)}}, 400, 406),
)
def conformance(request: Request, base: BaseUrl, f: FormatQuery = None) -> Response:
    """The parts of OGC standards that this service keeps to."""
    refuse_unknown(request, {"f"})
    form = wanted(request, f, AS_JSON, AS_HTML)
    links = form.links(f"{base}/conformance")
    document = {"conformsTo": list(CONFORMANCE), "links": link_documents(links)}
    return document_answer(
        request,
        form,
        document,
        links,
        template="conformance.html",
        title="Conformance classes",
        crumbs=[("Versant", f"{base}/")],
    )
