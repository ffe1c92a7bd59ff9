"""Pages for people: the documents as HTML, by the templates beside this file. They load nothing from anywhere."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from functools import lru_cache
from hashlib import sha256
from importlib.resources import files
from typing import Any

from fastapi import Request, Response
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from app.core.http import Link, problems
from app.core.text import dumps
from app.map.items.negotiation import HTML, Wanted, answered

Crumbs = Sequence[tuple[str, str]]
"""The way to a page from the landing page: title and address of each page above it."""

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
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return escape(text)
    marked = [
        Markup("<code>{}</code>").format(part) if n % 2 else escape(part) for n, part in enumerate(parts)
    ]
    return Markup("").join(marked)


def _kind(schema: dict[str, Any]) -> str:
    """The type that a schema asks for, in a word or two."""
    kinds = schema.get("anyOf") or [schema]
    types = [str(kind.get("type", "any")) for kind in kinds]
    return " or ".join(type_ for type_ in types if type_ != "null")


def page(template: str, *, title: str, crumbs: Crumbs, links: Sequence[Link], **values: Any) -> str:
    """The page; ``links`` gives its other forms. What ``values`` hold is shown as text, whatever characters it has."""
    return _templates().get_template(template).render(title=title, crumbs=crumbs, links=links, **values)


def described(description: str, contents: dict[str, Any], *statuses: int) -> dict[int | str, dict[str, Any]]:
    """What the API's document says of a route's answers: an example of each media type, a page, 304, problems."""
    content: dict[str, Any] = {
        media_type: {
            "schema": {"type": "string" if isinstance(example, str) else "object"},
            "example": example,
        }
        for media_type, example in {**contents, HTML: "<!doctype html>"}.items()
    }
    unchanged = {"description": "Unchanged since the ETag."}
    return {200: {"description": description, "content": content}, 304: unchanged, **problems(*statuses)}


def document_answer(
    request: Request,
    form: Wanted,
    document: dict[str, Any],
    links: Sequence[Link],
    *,
    template: str,
    title: str,
    crumbs: Crumbs = (),
    **values: Any,
) -> Response:
    """A document in the form that is wanted: as it is, or as a page."""
    if not form.html:
        return answered(request, dumps(document), form.media_type, links=links)
    text = page(template, title=title, crumbs=crumbs, links=links, document=document, **values)
    return answered(request, text, HTML, links=links, headers=page_headers())
