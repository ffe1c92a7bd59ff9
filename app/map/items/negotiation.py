"""In which form a document is wanted, by ``f=`` or by the Accept header, and what every answer says of itself.

Every answer has an ETag, made of what it says, links in its header, and ``Vary: Accept``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlencode

from fastapi import Query, Request, Response

from app.core.errors import BadQueryError, NotAcceptableError
from app.core.http import JSON, REVALIDATE, Link, link, preferred, unless_known
from app.core.text import GEO_JSON

HTML = "text/html"
SCHEMA_JSON = "application/schema+json"
XML = "application/xml"

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
        others_pairs = [(name, text) for name, text in pairs if name != "f"]
        own_pairs = [*others_pairs, *([("f", self.asked)] if self.asked else [])]
        own = link(with_pairs(address, own_pairs), "self", self.media_type, "This document")
        others = [
            link(
                with_pairs(address, [*others_pairs, ("f", form.names[0])]),
                "alternate",
                form.media_types[0],
                f"This document as {form.title}",
            )
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
        raise BadQueryError(f"There is no format {f!r} here. There are: {known}.", field="f")
    offered = [media_type for form in forms for media_type in form.media_types]
    media_type = preferred(request.headers.get("accept"), offered)
    if media_type is None:
        raise NotAcceptableError(f"There is no such form of this document. There are: {', '.join(offered)}.")
    form = next(form for form in forms if media_type in form.media_types)
    return Wanted(form, media_type, forms, None)


def answered(
    request: Request,
    body: str | bytes,
    media_type: str,
    *,
    links: Iterable[Link] = (),
    headers: Mapping[str, str] | None = None,
    etag: str | None = None,
) -> Response:
    """The answer, or 304 where the client has it; ``etag`` where what it says does not tell, such as with a clock."""
    content = body.encode() if isinstance(body, str) else body
    tag = etag or f'W/"{hashlib.blake2b(content, digest_size=12).hexdigest()}"'
    own = {"ETag": tag, "Cache-Control": REVALIDATE, "Vary": "Accept", **(headers or {})}
    in_header = link_header(list(links))
    return unless_known(request, content, media_type, own, more={"Link": in_header} if in_header else {})


def link_header(links: Sequence[Link]) -> str:
    """As many of the links as fit (RFC 8288); titles, which may be in any script, are left to the document."""
    parts: list[str] = []
    length = 0
    for one in links:
        part = f'<{one.href}>; rel="{one.rel}"' + (f'; type="{one.type}"' if one.type else "")
        if length + len(part) + 2 <= MOST_IN_HEADER and part.isascii():
            length += len(part) + 2
            parts.append(part)
    return ", ".join(parts)
