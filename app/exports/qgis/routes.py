"""Routes to the plug-in for QGIS: the list that its manager reads, the zip, the style. They tell nothing of anybody."""

from __future__ import annotations

from hashlib import sha256
from typing import Any

from fastapi import APIRouter, Request, Response

from app.core.http import REVALIDATE, BaseUrl, unless_known
from app.exports.qgis.package import LIST, STYLE, ZIP, plugin_list, plugin_zip
from app.exports.writing.qgis_style import qml

XML = "application/xml"
ZIPPED = "application/zip"

router = APIRouter(prefix="/qgis", tags=["exports"])


def _described(
    media_type: str, description: str, example: str, schema: dict[str, Any]
) -> dict[int | str, Any]:
    content = {media_type: {"schema": schema, "example": example}}
    return {
        200: {"description": description, "content": content},
        304: {"description": "Unchanged since the ETag."},
    }


_TEXT = {"type": "string"}
_BYTES = {"type": "string", "format": "binary"}


@router.get(
    f"/{LIST}",
    summary="List of plug-ins for QGIS",
    response_class=Response,
    responses=_described(XML, "The list, with the one plug-in.", "<plugins/>", _TEXT),
)
def listed(request: Request, base: BaseUrl) -> Response:
    """Give this address to QGIS (Plugins, Settings, Add): its manager installs the plug-in and keeps it up to date."""
    return _answer(request, plugin_list(base), XML)


@router.get(
    f"/{ZIP}",
    summary="Plug-in for QGIS",
    response_class=Response,
    responses=_described(ZIPPED, "The plug-in.", "(the bytes of versant.zip)", _BYTES),
)
def zipped(request: Request, base: BaseUrl) -> Response:
    """The plug-in, to be installed from a file: upload drives, newest slopes of an area, profile along a line."""
    return _answer(request, plugin_zip(base), ZIPPED)


@router.get(
    f"/{STYLE}",
    summary="Style of segments for QGIS",
    response_class=Response,
    responses=_described(XML, "The style.", "<qgis/>", _TEXT),
)
def style(request: Request) -> Response:
    """Colour is steepness, width is certainty: for segments that came into QGIS without their style."""
    return _answer(request, qml().encode(), XML)


def _answer(request: Request, content: bytes, media_type: str) -> Response:
    etag = f'W/"{sha256(content).hexdigest()[:20]}"'
    return unless_known(request, content, media_type, {"ETag": etag, "Cache-Control": REVALIDATE})
