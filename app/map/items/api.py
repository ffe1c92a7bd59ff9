"""The API's own document: OpenAPI 3.1 as it is derived, 3.0 for clients that want that, and a plain page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from fastapi import APIRouter, FastAPI, Request, Response

from app.core.errors import NotAcceptableError
from app.core.http import JSON, BaseUrl, Link, link, problems
from app.core.query import refuse_unknown
from app.core.text import dumps
from app.map.items.negotiation import AS_HTML, HTML, Form, FormatQuery, Wanted, answered, wanted
from app.map.items.openapi30 import openapi_30
from app.map.items.pages import page, page_headers

_OPENAPI = "application/vnd.oai.openapi+json"
OPENAPI_31 = Form(("json", "openapi-3.1"), (f"{_OPENAPI};version=3.1", JSON), "OpenAPI 3.1")
OPENAPI_30 = Form(("openapi-3.0",), (f"{_OPENAPI};version=3.0",), "OpenAPI 3.0")
_FORMS = (OPENAPI_31, OPENAPI_30, AS_HTML)

router = APIRouter(tags=["map"])


@router.get(
    "/openapi.json",
    summary="The API's description",
    response_class=Response,
    responses={
        200: {
            "description": "OpenAPI 3.1, 3.0, or a plain page.",
            "content": {
                media_type: {"schema": {"type": "object"}, "example": {"openapi": version}}
                for form, version in ((OPENAPI_31, "3.1.0"), (OPENAPI_30, "3.0.3"))
                for media_type in form.media_types
            }
            | {HTML: {"schema": {"type": "string"}, "example": "<!doctype html>"}},
        },
        304: {"description": "Unchanged since the ETag."},
        **problems(400, 406),
    },
)
def openapi(request: Request, base: BaseUrl, f: FormatQuery = None) -> Response:
    """Everything that can be asked, with examples: OpenAPI 3.1.

    With `f=openapi-3.0`, or `Accept: application/vnd.oai.openapi+json;version=3.0`, the same in OpenAPI 3.0; with
    `f=html`, or `Accept: text/html`, on one page without scripts.
    """
    refuse_unknown(request, {"f"})
    form = _version(request, f)
    links = [
        *form.links(f"{base}/openapi.json"),
        link(f"{base}/docs", "alternate", HTML, "The documentation"),
    ]
    if form.html:
        return _plain_page(request, base, links)
    return answered(request, _text(request.app, form.form), form.media_type, links=links)


def _plain_page(request: Request, base: str, links: Sequence[Link]) -> Response:
    document = request.app.openapi()
    text = page(
        "api.html",
        title="The API",
        crumbs=[("Versant", f"{base}/")],
        links=links,
        information=document["info"],
        groups=_groups(document),
    )
    return answered(request, text, HTML, links=links, headers=page_headers())


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


def _text(app: FastAPI, form: Form) -> str:
    """The document's text, made once in an application's life."""
    if not hasattr(app.state, "openapi_texts"):
        app.state.openapi_texts = {}
    texts: dict[str, str] = app.state.openapi_texts
    if form.title not in texts:
        document = app.openapi()
        texts[form.title] = dumps(openapi_30(document) if form is OPENAPI_30 else document)
    return texts[form.title]


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
