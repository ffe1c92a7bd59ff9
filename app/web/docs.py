"""The documentation: the pages of ``docs/``, and the API's description for people.

Pages are text in the answer, readable without scripts; of the API there is a list of all routes then.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi import Path as PathParameter
from fastapi.responses import RedirectResponse
from markupsafe import Markup

from app.core.http import REVALIDATE, BaseUrl, ServiceDep, link
from app.core.query import refuse_unknown
from app.map.items.landing import OPENAPI_30, OPENAPI_31
from app.map.items.pages import AS_HTML, HTML, FormatQuery, described, link_header, wanted
from app.web import guides
from app.web.pages import file_answer, file_of, page_answer

PLAIN = "/openapi.json?f=html"
FILE_HEADERS = {"Cache-Control": REVALIDATE, "X-Content-Type-Options": "nosniff"}
MOVED = {
    "architecture": "contributing/plan-of-the-house",
    "changes": "how-to/follow-changes",
    "cheap_filter": "published/particle-speed",
    "clients": "how-to/connect-programs",
    "experiments": "published/index",
    "exports": "how-to/export-files",
    "handover": "how-to/feed-routers-and-editors",
    "items": "reference/queries",
    "methods": "reference/methods",
    "network": "explanation/network",
    "operation": "reference/monitoring",
    "pages": "contributing/pages",
    "particle": "published/particle-speed",
    "positioning": "explanation/positioning",
    "recording": "how-to/record",
    "threats": "explanation/security",
}
"""Where the pages of version 0.1 are now."""
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
    q: Annotated[
        str | None, Query(description="Words that the page searches its guides and routes for.")
    ] = None,
) -> Response:
    """The guides, and all routes with their parameters and answers."""
    refuse_unknown(request, {"f", "lang", "q"})
    wanted(request, f, AS_HTML)
    content = _content(guides.guide(guides.INDEX))
    answer = page_answer(request, service.settings, "docs", _plainly(request.app.openapi()), content)
    links = [
        link(f"{base}/docs", "self", HTML),
        link(f"{base}/openapi.json", "alternate", OPENAPI_31.media_types[0]),
        link(f"{base}/openapi.json?f=openapi-3.0", "alternate", OPENAPI_30.media_types[0]),
        link(base + PLAIN, "alternate", HTML),
    ]
    answer.headers["Link"] = link_header(links)
    return answer


@router.get("/docs/contents.json", include_in_schema=False)
def contents(request: Request) -> Response:
    """What pages there are, for the list beside each of them and for the search."""
    listed = [
        {"title": section.title, "pages": [_entry(name, sentence) for name, sentence in section.pages]}
        for section in guides.sections()
    ]
    file = file_of(json.dumps(listed).encode(), "contents.json")
    return file_answer(request, file, {"Cache-Control": REVALIDATE})


@router.get("/docs/{path:path}", include_in_schema=False)
def document(
    request: Request, service: ServiceDep, path: Annotated[str, PathParameter(max_length=200)]
) -> Response:
    """A page of the documentation, or a file that one shows or leads to."""
    if path in MOVED:
        return RedirectResponse(f"{guides.ADDRESS}/{MOVED[path]}", 301)
    file = None if path.endswith(".md") else guides.files().get(path)
    if file is not None:
        return file_answer(request, file_of(file.read_bytes(), file.name), dict(FILE_HEADERS))
    page = guides.guide(path.removesuffix(".md"))
    answer = page_answer(request, service.settings, "docs", content=_content(page))
    if page is None:
        answer.status_code = 404
    return answer


def _entry(name: str, sentence: str) -> dict[str, Any]:
    page = guides.guide(name)
    headings = [heading._asdict() for heading in page.headings] if page else []
    return {"name": name, "title": page.title if page else name, "summary": sentence, "headings": headings}


def _content(page: guides.Guide | None) -> str:
    """A page's text as the scripts find it."""
    return f'<article lang="en" class="guide">{page.html}</article>' if page else ""


def _plainly(document: dict[str, Any]) -> str:
    """Every route in a line, for whoever reads the page without running its scripts."""
    lines = [
        _LINE.format(f"{PLAIN}#{operation['tags'][0]}", method.upper(), path, operation["summary"])
        for path, item in document["paths"].items()
        for method, operation in item.items()
    ]
    return str(_PLAINLY.format(PLAIN, Markup("").join(lines)))
