"""The landing page, the conformance classes, and the API's own document.

That is OpenAPI 3.1 as it is derived, 3.0 for clients that want that, and a plain page.
"""

from __future__ import annotations

from collections import defaultdict
from functools import lru_cache
from typing import Any

from fastapi import APIRouter, FastAPI, Request, Response

from app.core.errors import NotAcceptableError
from app.core.http import JSON, BaseUrl, link, link_documents
from app.core.query import refuse_unknown
from app.core.text import dumps
from app.map.items.openapi30 import openapi_30
from app.map.items.pages import (
    AS_HTML,
    HTML,
    Form,
    FormatQuery,
    FormDep,
    Wanted,
    answered,
    crumbs,
    described,
    document_answer,
    page_answer,
    wanted,
)
from app.map.segment import attribution
from app.map.tiles.documents import SCHEMES_REL, tilesets_link
from app.map.tiles.routes import TILES_CONFORMANCE

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
def landing(request: Request, base: BaseUrl, form: FormDep) -> Response:
    """Where everything is."""
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
    return document_answer(request, form, document, links, "landing.html", "Versant", ())


@router.get(
    "/conformance",
    summary="Conformance classes",
    response_class=Response,
    responses=described("The classes.", {JSON: {"conformsTo": list(CONFORMANCE)}}, 400, 406),
)
def conformance(request: Request, base: BaseUrl, form: FormDep) -> Response:
    """The parts of OGC standards that this service keeps to."""
    links = form.links(f"{base}/conformance")
    document = {"conformsTo": list(CONFORMANCE), "links": link_documents(links)}
    return document_answer(
        request, form, document, links, "conformance.html", "Conformance classes", crumbs(base)
    )


_OPENAPI = "application/vnd.oai.openapi+json"
OPENAPI_31 = Form(("json", "openapi-3.1"), (f"{_OPENAPI};version=3.1", JSON), "OpenAPI 3.1")
OPENAPI_30 = Form(("openapi-3.0",), (f"{_OPENAPI};version=3.0",), "OpenAPI 3.0")
_FORMS = (OPENAPI_31, OPENAPI_30, AS_HTML)
_EXAMPLES = {
    media_type: {"openapi": version}
    for form, version in ((OPENAPI_31, "3.1.0"), (OPENAPI_30, "3.0.3"))
    for media_type in form.media_types
}


@router.get(
    "/openapi.json",
    summary="The API's description",
    response_class=Response,
    responses=described("OpenAPI 3.1, 3.0, or a plain page.", _EXAMPLES, 400, 406),
)
def openapi(request: Request, base: BaseUrl, f: FormatQuery = None) -> Response:
    """Everything that can be asked, with examples: OpenAPI 3.1.

    With `f=openapi-3.0`, or `Accept: application/vnd.oai.openapi+json;version=3.0`, the same in OpenAPI 3.0; with
    `f=html`, or `Accept: text/html`, on one page without scripts.
    """
    refuse_unknown(request, {"f"})
    form = _version(request, f)
    documentation = link(f"{base}/docs", "alternate", HTML, "The documentation")
    links = [*form.links(f"{base}/openapi.json"), documentation]
    if form.html:
        document = request.app.openapi()
        parts = {"information": document["info"], "groups": _groups(document)}
        return page_answer(request, "api.html", "The API", crumbs(base), links, **parts)
    return answered(request, _text(request.app, form.form), form.media_type, links=links)


def _version(request: Request, f: str | None) -> Wanted:
    """As ``wanted``, but by the version too, which is a parameter of the media type."""
    accept = request.headers.get("accept", "").strip() or "*/*"
    if f is not None:
        return wanted(request, f, *_FORMS)
    ranges = sorted((_range(item) for item in accept.split(",")), key=lambda one: -one[2])
    for name, version, weight in ranges:
        if weight > 0 and name in {_OPENAPI, "application/openapi+json"}:
            form = OPENAPI_30 if version.startswith("3.0") else OPENAPI_31
            return Wanted(form, form.media_types[0], _FORMS, None)
        if weight > 0 and name in {JSON, "application/*", "*/*"}:
            return Wanted(OPENAPI_31, JSON, _FORMS, None)
        if weight > 0 and name in {HTML, "text/*"}:
            return Wanted(AS_HTML, HTML, _FORMS, None)
    offered = ", ".join(media_type for form in _FORMS for media_type in form.media_types)
    raise NotAcceptableError(f"There is no such form of this document. There are: {offered}.")


def _range(item: str) -> tuple[str, str, float]:
    """Media type, version and weight of one part of an Accept header."""
    name, *rest = (part.strip().lower() for part in item.split(";"))
    parameters = dict(part.split("=", 1) for part in rest if "=" in part)
    try:
        return name, parameters.get("version", ""), float(parameters.get("q", "1"))
    except ValueError:
        return name, "", 0.0


@lru_cache(maxsize=4)
def _text(app: FastAPI, form: Form) -> str:
    """The document's text, made once in an application's life."""
    document = app.openapi()
    return dumps(openapi_30(document) if form is OPENAPI_30 else document)


def _groups(document: dict[str, Any]) -> list[tuple[str, str, list[dict[str, Any]]]]:
    """Tag, what it is for, and its operations, each with method and path."""
    by_tag: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for path, item in document["paths"].items():
        for method, operation in item.items():
            for tag in operation.get("tags", []):
                by_tag[tag].append({"method": method.upper(), "path": path, **operation})
    described = {tag["name"]: tag["description"] for tag in document.get("tags", [])}
    order = [*described, *(tag for tag in by_tag if tag not in described)]
    return [(tag, described.get(tag, ""), by_tag[tag]) for tag in order if tag in by_tag]
