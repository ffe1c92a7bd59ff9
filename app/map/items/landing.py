"""The landing page, the conformance classes, and the API's own document.

The page at the root is for people too: where everything is, in their language and colours, without a script. The
language is what the browser asks for, or ``lang=``; the colours are the system's, or ``theme=``.

That is OpenAPI 3.1 as it is derived, 3.0 for clients that want that, and a plain page.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal, cast

from fastapi import APIRouter, Depends, FastAPI, Query, Request, Response

from app.core.errors import NotAcceptableError
from app.core.http import JSON, BaseUrl, link, link_documents
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.text import dumps, language_of
from app.map.items import pages
from app.map.items.openapi30 import openapi_30
from app.map.segment import attribution
from app.map.tiles.documents import SCHEMES_REL, tilesets_link
from app.map.tiles.routes import TILES_CLASSES
from fusion.messages import text_in

Language = Literal["en", "de"]
Theme = Literal["light", "dark"]
PAGES = ("map", "upload", "drives", "admin", "docs")
CARDS = ("map", "upload", "record", "drives", "admin", "docs")
"""Pages that the root says more of."""
LANGUAGES: Mapping[Language, str] = {"en": "English", "de": "Deutsch"}


class Seen:
    """How the page is to be seen."""

    def __init__(
        self, form: pages.Wanted, language: Language, theme: Theme | None, asked: Language | None
    ) -> None:
        """``asked``: the language that the address names, None: the browser's."""
        self.form, self.language, self.theme, self._asked = form, language, theme, asked

    def word(self, name: str) -> str:
        """A word or a sentence of the page."""
        return text_in(self.language, say(f"home.{name}"))

    def here(self, **other: str) -> str:
        """This page with another language or other colours."""
        own = {"f": self.form.asked, "lang": self._asked, "theme": self.theme} | other
        return pages.with_pairs("/", [(name, text) for name, text in own.items() if text])

    def page(self, name: str) -> str:
        """The address of another page, in the language that was asked for."""
        return pages.with_pairs(f"/{name}", [("lang", self._asked)] if self._asked else [])


def _seen(
    request: Request,
    f: pages.FormatQuery = None,
    lang: Annotated[Language | None, Query(description="The language of the page for people.")] = None,
    theme: Annotated[Theme | None, Query(description="Its colours; unset: as the system has them.")] = None,
) -> Seen:
    refuse_unknown(request, {"f", "lang", "theme"})
    form = pages.wanted(request, f, pages.AS_JSON, pages.AS_HTML)
    return Seen(
        form, lang or cast(Language, language_of(request.headers.get("accept-language", ""))), theme, lang
    )


SeenDep = Annotated[Seen, Depends(_seen)]


BIND_NOTE = (
    "Requests need a key, but for those of the map where it is public (VERSANT_PUBLIC_MAP). The service listens "
    "only on this machine's loopback address unless it is told otherwise (VERSANT_HOST, --host)."
)


# Each is declared because the tests that are named after its abstract tests hold (``tests/app/map/items``).
_CLASSES = {
    "ogcapi-features-1": ("core", "oas30", "html", "geojson"),
    "ogcapi-features-2": ("crs",),
    "ogcapi-features-3": ("queryables", "queryables-query-parameters", "filter", "features-filter"),
    "cql2": (
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
    ),
    "ogcapi-features-5": ("schemas", "core-roles-features", "returnables-and-receivables"),
    "ogcapi-tiles-1": TILES_CLASSES,
}
"""By the standard that they are of."""
CONFORMANCE = tuple(
    f"http://www.opengis.net/spec/{part}/1.0/conf/{name}"
    for part, names in _CLASSES.items()
    for name in names
)

router = APIRouter(tags=["map"])


@router.get(
    "/",
    summary="Landing page",
    response_class=Response,
    responses=pages.described("Links to all there is.", {JSON: {"links": []}}, 400, 406),
)
def landing(request: Request, base: BaseUrl, seen: SeenDep) -> Response:
    """Where everything is."""
    form = seen.form
    api, older = f"{base}/openapi.json", OPENAPI_30
    links = [
        *form.links(f"{base}/"),
        link(f"{api}?f={older.names[0]}", "service-desc", older.media_types[0], "The API, OpenAPI 3.0"),
        link(api, "service-desc", OPENAPI_31.media_types[0], "The API, OpenAPI 3.1"),
        link(f"{base}/docs", "service-doc", pages.HTML, "The documentation, for people"),
        link(f"{base}/conformance", "conformance", title="Conformance classes"),
        link(f"{base}/collections", "data", title="Collections"),
        link(f"{base}/tiles.json", "tiles", title="Vector tiles, TileJSON 3"),
        tilesets_link(base),
        link(f"{base}/tileMatrixSets", SCHEMES_REL, title="Tile matrix sets"),
        link(f"{base}/style.json", "style", title="A style for maps in a browser"),
        link(f"{base}/v1/changes", "changes", title="What changed since a version"),
        link(f"{base}/v1/exports", "exports", title="Files of the map"),
        link(f"{base}/v1/editions", "editions", title="Editions of the map, with their files"),
        link(f"{base}/v1/drives", "drives", title="Uploaded drives"),
        link(f"{base}/v1/privacy", "privacy-policy", title="What is shown to whom"),
    ]
    document: dict[str, Any] = {
        "title": "Versant",
        "description": f"Slopes of roads from vehicle logs. {BIND_NOTE}",
        "attribution": attribution(),
        "links": link_documents(links),
    }
    if not form.html:
        return pages.answered(request, dumps(document), form.media_type, links=links)
    values = {"seen": seen, "languages": LANGUAGES, "shown_pages": PAGES, "cards": CARDS}
    text = pages.page("landing.html", title="Versant", crumbs=(), links=links, document=document, **values)
    headers = {**pages.page_headers(), "Vary": "Accept, Accept-Language", "Content-Language": seen.language}
    return pages.answered(request, text, pages.HTML, links=links, headers=headers)


@router.get(
    "/conformance",
    summary="Conformance classes",
    response_class=Response,
    responses=pages.described("The classes.", {JSON: {"conformsTo": list(CONFORMANCE)}}, 400, 406),
)
def conformance(request: Request, base: BaseUrl, form: pages.FormDep) -> Response:
    """The parts of OGC standards that this service keeps to."""
    links = form.links(f"{base}/conformance")
    document = {"conformsTo": list(CONFORMANCE), "links": link_documents(links)}
    return pages.document_answer(
        request, form, document, links, "conformance.html", "Conformance classes", pages.crumbs(base)
    )


_OPENAPI = "application/vnd.oai.openapi+json"
OPENAPI_31 = pages.Form(("json", "openapi-3.1"), (f"{_OPENAPI};version=3.1", JSON), "OpenAPI 3.1")
OPENAPI_30 = pages.Form(("openapi-3.0",), (f"{_OPENAPI};version=3.0",), "OpenAPI 3.0")
_FORMS = (OPENAPI_31, OPENAPI_30, pages.AS_HTML)
_EXAMPLES = {
    media_type: {"openapi": version}
    for form, version in ((OPENAPI_31, "3.1.0"), (OPENAPI_30, "3.0.3"))
    for media_type in form.media_types
}


@router.get(
    "/openapi.json",
    summary="The API's description",
    response_class=Response,
    responses=pages.described("OpenAPI 3.1, 3.0, or a plain page.", _EXAMPLES, 400, 406),
)
def openapi(request: Request, base: BaseUrl, f: pages.FormatQuery = None) -> Response:
    """Everything that can be asked, with examples: OpenAPI 3.1.

    With `f=openapi-3.0`, or `Accept: application/vnd.oai.openapi+json;version=3.0`, the same in OpenAPI 3.0; with
    `f=html`, or `Accept: text/html`, on one page without scripts.
    """
    refuse_unknown(request, {"f"})
    form = _version(request, f)
    documentation = link(f"{base}/docs", "alternate", pages.HTML, "The documentation")
    links = [*form.links(f"{base}/openapi.json"), documentation]
    if form.html:
        document = request.app.openapi()
        parts = {"information": document["info"], "groups": _groups(document)}
        return pages.page_answer(request, "api.html", "The API", pages.crumbs(base), links, **parts)
    return pages.answered(request, _text(request.app, form.form), form.media_type, links=links)


def _version(request: Request, f: str | None) -> pages.Wanted:
    """As ``wanted``, but by the version too, which is a parameter of the media type."""
    accept = request.headers.get("accept", "").strip() or "*/*"
    if f is not None:
        return pages.wanted(request, f, *_FORMS)
    ranges = sorted((_range(item) for item in accept.split(",")), key=lambda one: -one[2])
    for name, version, weight in ranges:
        if weight > 0 and name in {_OPENAPI, "application/openapi+json"}:
            form = OPENAPI_30 if version.startswith("3.0") else OPENAPI_31
            return pages.Wanted(form, form.media_types[0], _FORMS, None)
        if weight > 0 and name in {JSON, "application/*", "*/*"}:
            return pages.Wanted(OPENAPI_31, JSON, _FORMS, None)
        if weight > 0 and name in {pages.HTML, "text/*"}:
            return pages.Wanted(pages.AS_HTML, pages.HTML, _FORMS, None)
    offered = ", ".join(media_type for form in _FORMS for media_type in form.media_types)
    raise NotAcceptableError(say("items.no_form", names=offered))


def _range(item: str) -> tuple[str, str, float]:
    """Media type, version and weight of one part of an Accept header."""
    name, *rest = (part.strip().lower() for part in item.split(";"))
    parameters = dict(part.split("=", 1) for part in rest if "=" in part)
    try:
        return name, parameters.get("version", ""), float(parameters.get("q", "1"))
    except ValueError:
        return name, "", 0.0


@lru_cache(maxsize=4)
def _text(app: FastAPI, form: pages.Form) -> str:
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
