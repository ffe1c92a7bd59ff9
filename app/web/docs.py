"""The documentation: the guides, and the API's description for people. Without scripts it is a list of all routes."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from markupsafe import Markup

from app.core.http import BaseUrl, ServiceDep, link
from app.core.query import refuse_unknown
from app.map.items.api import OPENAPI_30, OPENAPI_31
from app.map.items.negotiation import AS_HTML, HTML, FormatQuery, link_header, wanted
from app.map.items.pages import described
from app.web.pages import page_answer

PLAIN = "/openapi.json?f=html"
_LINE = Markup('<li><a href="{}">{} {}</a>: {}</li>')
_PLAINLY = Markup('<p><a href="{}">The same without scripts</a></p><ul>{}</ul>')

router = APIRouter(tags=["map"])


@router.get(
    "/docs",
    summary="The documentation, for people",
    response_class=Response,
    responses=described("A page that loads nothing from elsewhere.", {}, 400, 406),
)
def docs(
    request: Request,
    base: BaseUrl,
    service: ServiceDep,
    f: FormatQuery = None,
    lang: Annotated[str | None, Query(description="The page's language, `en` or `de`.")] = None,
) -> Response:
    """The guides, and all routes with their parameters and answers."""
    refuse_unknown(request, {"f", "lang"})
    wanted(request, f, AS_HTML)
    answer = page_answer(request, service.settings, "docs", _plainly(request.app.openapi()))
    links = [
        link(f"{base}/docs", "self", HTML),
        link(f"{base}/openapi.json", "alternate", OPENAPI_31.media_types[0]),
        link(f"{base}/openapi.json?f=openapi-3.0", "alternate", OPENAPI_30.media_types[0]),
        link(base + PLAIN, "alternate", HTML),
    ]
    answer.headers["Link"] = link_header(links)
    return answer


@router.get("/docs/{name}", include_in_schema=False)
def guide(request: Request, service: ServiceDep, name: str) -> Response:
    """One guide; the page itself says where there is none."""
    return page_answer(request, service.settings, "docs")


def _plainly(document: dict[str, Any]) -> str:
    """Every route in a line, for whoever reads the page without running its scripts."""
    lines = [
        _LINE.format(f"{PLAIN}#{operation['tags'][0]}", method.upper(), path, operation["summary"])
        for path, item in document["paths"].items()
        for method, operation in item.items()
    ]
    return str(_PLAINLY.format(PLAIN, Markup("").join(lines)))
