"""In which form a document is wanted, and what every answer says of itself; its page for people.

``f=`` or the Accept header choose the form. Every answer has an ETag, made of what it says, links in its header, and
``Vary: Accept``. Pages are made by the templates beside this file, and load nothing from anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from importlib.resources import files
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import Depends, Query, Request, Response
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from app.core.errors import BadQueryError, NotAcceptableError
from app.core.http import JSON, REVALIDATE, Link, link, problems, unless_known
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.text import GEO_JSON, dumps, preferred

HTML = "text/html"
SCHEMA_JSON = "application/schema+json"
XML = "application/xml"
CSV = "text/csv"

MOST_IN_HEADER = 2000
"""Characters of links in a header. Proxies take headers of 4 kB; the document has all links."""


@dataclass(frozen=True)
class Form:
    """One form of a document."""

    names: tuple[str, ...]
    """What ``f`` may say; links write the first."""
    media_types: tuple[str, ...]
    """What Accept may say; links announce the first."""
    title: str


AS_JSON = Form(("json",), (JSON,), "JSON")
AS_GEOJSON = Form(("geojson", "json"), (GEO_JSON, JSON), "GeoJSON")
AS_SCHEMA = Form(("json",), (SCHEMA_JSON, JSON), "JSON Schema")
AS_XSD = Form(("xsd",), (XML, "text/xml"), "XML Schema")
AS_CSV = Form(("csv",), (CSV,), "CSV")
AS_HTML = Form(("html",), (HTML,), "HTML")

FormatQuery = Annotated[
    str | None,
    Query(description="The form of the answer, where the Accept header cannot say it: `json`, `html` ..."),
]


@dataclass(frozen=True)
class Wanted:
    """The form of an answer, and which other forms there are."""

    form: Form
    media_type: str
    forms: tuple[Form, ...]
    asked: str | None
    """What ``f`` said: links that lead on repeat it."""

    @property
    def html(self) -> bool:
        """Whether it is a page for people."""
        return self.form is AS_HTML

    def links(self, address: str, pairs: Iterable[tuple[str, str]] = ()) -> list[Link]:
        """``self``, and ``alternate`` for each other form of what is at ``address`` with these parameters."""
        other_pairs = [(name, text) for name, text in pairs if name != "f"]

        def here(f: str | None) -> str:
            return with_pairs(address, [*other_pairs, ("f", f)] if f else other_pairs)

        own = link(here(self.asked), "self", self.media_type, "This document")
        others = [
            link(here(form.names[0]), "alternate", form.media_types[0], f"This document as {form.title}")
            for form in self.forms
            if form is not self.form
        ]
        return [own, *others]


def with_pairs(address: str, pairs: Sequence[tuple[str, str]]) -> str:
    """``address`` with these parameters, in their order."""
    return f"{address}?{urlencode(pairs, safe=',:/')}" if pairs else address


def wanted(request: Request, f: str | None, *forms: Form) -> Wanted:
    """The form that ``f`` names, else the one that the Accept header likes best, the first of equals.

    Raises ``BadQueryError`` for an unknown ``f``, ``NotAcceptableError`` where none is acceptable.
    """
    if f is not None:
        for form in forms:
            if f in form.names:
                return Wanted(form, form.media_types[0], forms, f)
        known = ", ".join(dict.fromkeys(name for form in forms for name in form.names))
        raise BadQueryError(say("items.no_format", name=f, names=known), field="f")
    offered = [media_type for form in forms for media_type in form.media_types]
    media_type = preferred(request.headers.get("accept"), offered)
    if media_type is None:
        raise NotAcceptableError(say("items.no_form", names=", ".join(offered)))
    form = next(form for form in forms if media_type in form.media_types)
    return Wanted(form, media_type, forms, None)


async def _json_or_html(request: Request, f: FormatQuery = None) -> Wanted:
    refuse_unknown(request, {"f"})
    return wanted(request, f, AS_JSON, AS_HTML)


FormDep = Annotated[Wanted, Depends(_json_or_html)]
"""The form of a document that is there as JSON and as a page, whose route takes no other parameter."""


def answered(
    request: Request,
    body: str | bytes,
    media_type: str,
    *,
    links: Iterable[Link] = (),
    headers: Mapping[str, str] | None = None,
    etag: str | None = None,
    longest_links: int = MOST_IN_HEADER,
) -> Response:
    """The answer, or 304 where the client has it; ``etag`` where what it says does not tell, such as with a clock."""
    content = body.encode() if isinstance(body, str) else body
    tag = etag or f'W/"{hashlib.blake2b(content, digest_size=12).hexdigest()}"'
    own = {"ETag": tag, "Cache-Control": REVALIDATE, "Vary": "Accept", **(headers or {})}
    in_header = link_header(list(links), longest_links)
    return unless_known(request, content, media_type, own, more={"Link": in_header} if in_header else {})


def link_header(links: Sequence[Link], most: int = MOST_IN_HEADER) -> str:
    """As many of the links as fit (RFC 8288); titles, which may be in any script, are left to the document."""
    parts: list[str] = []
    length = 0
    for one in links:
        part = f'<{one.href}>; rel="{one.rel}"' + (f'; type="{one.type}"' if one.type else "")
        if length + len(part) + 2 <= most and part.isascii():
            length += len(part) + 2
            parts.append(part)
    return ", ".join(parts)


def content_crs(uri: str) -> dict[str, str]:
    """Which reference system the answer has."""
    return {"Content-Crs": f"<{uri}>"}


Crumbs = Sequence[tuple[str, str]]
"""The way to a page from the landing page: title and address of each page above it."""


def crumbs(base: str, *above: tuple[str, str]) -> Crumbs:
    """The way through these pages below the landing page: title and path of each."""
    return [("Versant", f"{base}/"), *((title, f"{base}/{path}") for title, path in above)]


STYLE = "plain.css"


@lru_cache
def page_headers() -> dict[str, str]:
    """Of every page: nothing runs in it, and it has the one style that stands in it."""
    style = base64.b64encode(sha256(_style().encode()).digest()).decode()
    policy = (
        f"default-src 'none'; style-src 'sha256-{style}'; img-src 'self'; form-action 'self'; base-uri 'none'; "
        "frame-ancestors 'none'"
    )
    return {"Content-Security-Policy": policy, "X-Content-Type-Options": "nosniff"}


def _style() -> str:
    return (files("app.map.items") / "templates" / STYLE).read_text(encoding="utf-8")


@lru_cache
def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("app.map.items"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(shown=_shown, prose=_prose, kind=_kind)
    environment.globals["style"] = Markup(_style())  # ours, not a visitor's  # noqa: S704
    return environment


def _shown(value: Any) -> str:
    """A value of a property; unknown is a dash."""
    if value is None:
        return "–"
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _prose(text: str) -> Markup:
    """Text with `names` between backquotes."""
    escaped = str(escape(text))
    if text.count("`") % 2 == 0:
        escaped = re.sub("`([^`]*)`", r"<code>\1</code>", escaped)
    return Markup(escaped)  # escaped above  # noqa: S704


def _kind(schema: dict[str, Any]) -> str:
    """The type that a schema asks for, in a word or two."""
    kinds = schema.get("anyOf") or [schema]
    types = [str(kind.get("type", "any")) for kind in kinds]
    return " or ".join(type_ for type_ in types if type_ != "null")


def page(template: str, *, title: str, crumbs: Crumbs, links: Sequence[Link], **values: Any) -> str:
    """The page; ``links`` gives its other forms. What ``values`` hold is shown as text, whatever characters it has."""
    return _templates().get_template(template).render(title=title, crumbs=crumbs, links=links, **values)


def page_answer(
    request: Request, template: str, title: str, crumbs: Crumbs, links: Sequence[Link], **values: Any
) -> Response:
    """A document as a page."""
    text = page(template, title=title, crumbs=crumbs, links=links, **values)
    return answered(request, text, HTML, links=links, headers=page_headers())


def described(description: str, contents: dict[str, Any], *statuses: int) -> dict[int | str, dict[str, Any]]:
    """What the API's document says of a route's answers: an example of each media type, a page, 304, problems."""
    content: dict[str, Any] = {
        kind: {"schema": {"type": "string" if isinstance(example, str) else "object"}, "example": example}
        for kind, example in {**contents, HTML: "<!doctype html>"}.items()
    }
    unchanged = {"description": "Unchanged since the ETag."}
    return {200: {"description": description, "content": content}, 304: unchanged, **problems(*statuses)}


def document_answer(
    request: Request,
    form: Wanted,
    document: dict[str, Any],
    links: Sequence[Link],
    template: str,
    title: str,
    crumbs: Crumbs,
    **values: Any,
) -> Response:
    """A document in the form that is wanted: as it is, or as a page."""
    if form.html:
        return page_answer(request, template, title, crumbs, links, document=document, **values)
    return answered(request, dumps(document), form.media_type, links=links)
