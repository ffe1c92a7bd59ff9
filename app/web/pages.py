"""Routes to the pages and to what they load. Knows what a page is called and nothing of what it shows."""

from __future__ import annotations

import gzip
import json
import mimetypes
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Annotated, NamedTuple
from urllib.parse import urlsplit

from fastapi import APIRouter, Request, Response
from fastapi import Path as PathParameter

from app.core.errors import NotFoundError
from app.core.http import REVALIDATE, ServiceDep, not_modified
from app.core.messages import say
from app.core.settings import Settings
from app.core.version import code_version

BUILT = (Path(__file__).parent / "built").resolve()
FOR_EVER = "public, max-age=31536000, immutable"
"""Files below ``assets/`` are named by what is in them."""
PLACE = '<meta name="versant" content="{}"'
"""The element of a page that holds the service's settings."""
WITHOUT_SCRIPTS = "</noscript>"
"""What is seen without scripts ends here."""
CONTENT = '<div id="page">'
"""What a page shows before its scripts run begins here."""

router = APIRouter(include_in_schema=False)


class File(NamedTuple):
    """A built file, ready to be sent: plain and compressed once for all."""

    content: bytes
    compressed: bytes
    media_type: str
    etag: str


@lru_cache(maxsize=256)
def built_file(name: str) -> File | None:
    """The file of that name below ``built``; None: there is none."""
    path = (BUILT / name).resolve()
    if not path.is_relative_to(BUILT) or not path.is_file():
        return None
    return file_of(path.read_bytes(), path.name)


def file_of(content: bytes, name: str) -> File:
    """A file of that content, its media type by the name."""
    kind = "text/javascript" if name.endswith((".js", ".mjs")) else mimetypes.guess_type(name)[0]
    etag = f'W/"{sha256(content).hexdigest()[:20]}"'
    return File(content, gzip.compress(content, 9, mtime=0), kind or "application/octet-stream", etag)


def policy(settings: Settings) -> str:
    """The pages' content security policy; hosts of background maps may be asked for style, tiles and letters."""
    addresses = (settings.map_background_url, *settings.backgrounds.values())
    beyond = "".join(dict.fromkeys(map(_origin, addresses)))
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            f"img-src 'self' data: blob:{beyond}",
            f"connect-src 'self'{beyond}",
            "worker-src 'self'",
            "form-action 'self'",
            "base-uri 'none'",
            "frame-ancestors 'none'",
        )
    )


def _origin(address: str | None) -> str:
    if address is None:
        return ""
    parts = urlsplit(address)
    return f" {parts.scheme}://{parts.netloc}" if parts.netloc else ""


@lru_cache(maxsize=128)
def _page(name: str, settings_shown: str, plainly: str, content: str) -> File:
    file = built_file(f"{name}.html")
    if file is None:
        raise NotFoundError(say("service.no_pages"))
    text = file.content.decode().replace(PLACE, f'<meta name="versant" content="{escape(settings_shown)}"', 1)
    text = text.replace(WITHOUT_SCRIPTS, plainly + WITHOUT_SCRIPTS, 1)
    return file_of(text.replace(CONTENT, CONTENT + content, 1).encode(), f"{name}.html")


def page_answer(
    request: Request, settings: Settings, name: str, plainly: str = "", content: str = ""
) -> Response:
    """A page as this service's settings make it.

    ``plainly`` is HTML for who runs no scripts, ``content`` HTML that everybody sees until the scripts run.
    """
    settings_shown = {
        "version": code_version(),
        "background_style_url": settings.map_background_url,
        "backgrounds": settings.backgrounds,
        "login_url": settings.login_url,
    }
    headers = {
        "Content-Security-Policy": policy(settings),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
        "Cache-Control": REVALIDATE,
    }
    return file_answer(request, _page(name, json.dumps(settings_shown), plainly, content), headers)


def file_answer(request: Request, file: File, headers: dict[str, str]) -> Response:
    """A file, compressed where the client takes that, or that it has not changed."""
    headers |= {"ETag": file.etag, "Vary": "Accept-Encoding"}
    if unchanged := not_modified(request, headers):
        return unchanged
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers |= {"Content-Encoding": "gzip"}
        return Response(file.compressed, media_type=file.media_type, headers=headers)
    return Response(file.content, media_type=file.media_type, headers=headers)


PAGES = {
    "/map": "map",
    "/upload": "upload",
    "/drives": "drives",
    "/drives/{drive_id}": "drive",
    "/admin": "admin",
    "/keys": "keys",
    "/owner": "owner",
    "/phones": "phones",
    "/record": "record",
    "/login": "login",
}
"""Address -> page; that of a drive itself says where there is none."""


def _route_of(name: str) -> Callable[[Request, ServiceDep], Response]:
    def page(request: Request, service: ServiceDep) -> Response:
        return page_answer(request, service.settings, name)

    return page


for _address, _name in PAGES.items():
    router.get(_address)(_route_of(_name))


@router.get("/web/{name:path}")
def web_file(request: Request, name: Annotated[str, PathParameter(max_length=200)]) -> Response:
    """What pages load."""
    file = None if name.endswith(".html") else built_file(name)
    if file is None:
        raise NotFoundError(say("service.no_page_file", name=name))
    caching = FOR_EVER if name.startswith("assets/") else REVALIDATE
    return file_answer(request, file, {"Cache-Control": caching, "X-Content-Type-Options": "nosniff"})
