"""The map's style for MapLibre and what belongs to it: `/style.json`, `/sprites/...`, `/glyphs/...`.

All of it comes from this service, so a map needs no other host.
"""

from __future__ import annotations

import math
from hashlib import sha256
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from app.core.db import Bounds
from app.core.errors import BadQueryError
from app.core.http import JSON, REVALIDATE, BaseUrl, ServiceDep, json_answer, problems, unless_known
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.standby.use import MapRoute
from app.core.text import dumps
from app.map.coverage import cached_crowd
from app.map.style.layers import DARK, LIGHT, SOURCE, layers
from app.map.style.names import NAMES
from app.map.style.scale import COLOUR_NAMES, SHOWN, ColourScale, scale_of
from app.map.style.signs import FILES, FONT_CREDIT, FONTS, SHEET, first_of_range, fonts_of, glyphs, sheet
from app.map.tiles.store import SEGMENTS, WAYS

PROTOBUF = "application/x-protobuf"
KEPT = "public, max-age=86400, stale-while-revalidate=604800"
"""Signs and letters change with the program only."""
THEMES = {"light": LIGHT, "dark": DARK}
FIRST_TILES, LARGEST_FIRST_ZOOM = 1.5, 14.0
"""A map opens with the whole network over so many tiles' width or height, and no nearer than that zoom."""
FARTHEST_DEG = 85.0
"""From the equator: there web maps end."""
PARAMETERS = frozenset({"theme", "colour", "layer"})
LAYERS = {SEGMENTS: "/tiles.json", WAYS: f"/collections/{WAYS}/tiles/WebMercatorQuad?f=tilejson"}
"""What can be drawn, and which tiles it is in."""
EXAMPLE = {
    "version": 8,
    "sources": {SOURCE: {"type": "vector", "url": "http://127.0.0.1:8000/tiles.json"}},
    "layers": [{"id": "ground", "type": "background"}],
}

ThemeQuery = Annotated[
    str, Query(description="Ground of the map.", json_schema_extra={"enum": [*THEMES]}, examples=["dark"])
]
ColourQuery = Annotated[
    str,
    Query(
        description="What colours stand for: how steep roads are, how sure that is, how steep they are by the "
        "elevation model alone, or how far that is from what was measured. The last two are known of segments only.",
        json_schema_extra={"enum": [*COLOUR_NAMES]},
        examples=["steepness"],
    ),
]
LayerQuery = Annotated[
    str,
    Query(
        description="What is drawn: segments, or ways.",
        json_schema_extra={"enum": [*LAYERS]},
        examples=[SEGMENTS],
    ),
]
StackPath = Annotated[
    str, Path(description=f"Fonts, separated by commas: {', '.join(FONTS)}.", examples=["DejaVu Sans"])
]
RangePath = Annotated[str, Path(description="256 characters, by number.", examples=["0-255"])]
FilePath = Annotated[str, Path(description=f"One of {', '.join(FILES)}.", examples=["versant.json"])]

router = APIRouter(tags=["tiles"], route_class=MapRoute)

_UNCHANGED: dict[int | str, dict[str, Any]] = {304: {"description": "Unchanged since the ETag."}}


@router.get(
    "/style.json",
    summary="Style of the map",
    responses={200: json_answer("A MapLibre style, version 8.", EXAMPLE), **_UNCHANGED, **problems(400, 503)},
)
def style(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    theme: ThemeQuery = "light",
    colour: ColourQuery = "steepness",
    layer: LayerQuery = SEGMENTS,
) -> Response:
    """How a map draws the tiles: give this address to MapLibre.

    Arrows point uphill; roads of unknown slope are thin and grey; bridges have rims and tunnels are dashed. Letters and
    signs come from the service as well. `metadata` says what a legend shows.
    """
    refuse_unknown(request, PARAMETERS)
    _check_choice("theme", theme, THEMES)
    _check_choice("colour", colour, COLOUR_NAMES)
    _check_choice("layer", layer, LAYERS)
    if layer == WAYS and SHOWN[colour].singles_only:
        raise BadQueryError.about("colour", say("style.segments_only", colour=colour))
    with service.reading() as session:
        bounds = cached_crowd(service, session)
        note = service.edition_note(session)
    document = style_document(base, theme, colour, layer)
    document["metadata"]["versant:segments_from_zoom"] = service.settings.tile_full_zoom
    document["metadata"] |= {f"versant:{name}": value for name, value in note.items()}
    if bounds is not None:
        document |= first_view(bounds)
    return _conditional(request, dumps(document).encode(), JSON, REVALIDATE)


@router.get(
    "/sprites/{file}",
    summary="Signs of the map",
    response_class=Response,
    responses={
        200: {
            "description": "A picture, or what is where in it.",
            "content": {
                "image/png": {"schema": {"type": "string", "format": "binary"}},
                JSON: {"schema": {"type": "object"}, "example": {"uphill": {"x": 0, "y": 0, "sdf": True}}},
            },
        },
        **_UNCHANGED,
        **problems(404),
    },
)
def sprite(file: FilePath, request: Request) -> Response:
    """Signs that the style shows, as MapLibre asks for them by the style's `sprite`."""
    content, media_type = sheet(file)
    return _conditional(request, content, media_type, KEPT)


@router.get(
    "/glyphs/{fontstack}/{range}.pbf",
    summary="Letters of the map",
    response_class=Response,
    responses={
        200: {
            "description": "Signed distance fields of 256 characters, 24 pixels to the em.",
            "content": {PROTOBUF: {"schema": {"type": "string", "format": "binary"}, "example": "(binary)"}},
        },
        **_UNCHANGED,
        **problems(404),
    },
)
def letters(fontstack: StackPath, range: RangePath, request: Request) -> Response:  # noqa: A002 - named by MapLibre
    """Letters as MapLibre asks for them by the style's `glyphs`. What no font has is left out."""
    fonts, first = fonts_of(fontstack), first_of_range(range)
    return _conditional(request, glyphs(fonts, first), PROTOBUF, KEPT)


def style_document(base: str, theme: str, colour: str, layer: str = SEGMENTS) -> dict[str, Any]:
    """The style with links under ``base``; theme, colour and layer are among those that there are."""
    scale, shown = scale_of(colour, dark=theme == "dark"), SHOWN[colour]
    return {
        "version": 8,
        "name": f"Versant: {colour}, {theme}",
        "metadata": {
            "versant:legend": {
                "title": scale.title,
                "classes": _classes(scale),
                "unknown": THEMES[theme].unknown,
                "known": shown.known,
                "value": shown.value,
            },
            "versant:fonts": FONT_CREDIT,
        },
        "sprite": f"{base}/sprites/{SHEET}",
        "glyphs": f"{base}/glyphs/{{fontstack}}/{{range}}.pbf",
        "sources": {
            SOURCE: {"type": "vector", "url": base + LAYERS[layer]},
            NAMES: {"type": "vector", "url": f"{base}/names.json"},
        },
        "layers": layers(THEMES[theme], scale, shown, layer),
    }


def _classes(scale: ColourScale) -> list[dict[str, Any]]:
    """What a legend shows: each class with where it begins and, if it does, ends."""
    ends = (*scale.breaks_percent[1:], None)
    return [
        {"label": label, "colour": shade, "from_percent": low, "to_percent": high}
        for (label, shade), low, high in zip(scale.classes(), scale.breaks_percent, ends, strict=True)
    ]


def first_view(bounds: Bounds) -> dict[str, Any]:
    """Centre and zoom that show all of a box in degrees; ``west`` may not exceed ``east``."""
    west, south, east, north = bounds
    ends = (min(max(lat, -FARTHEST_DEG), FARTHEST_DEG) for lat in (south, north))
    lower, upper = (math.asinh(math.tan(math.radians(lat))) / math.tau for lat in ends)
    share = max((east - west) / 360, upper - lower, 2.0**-LARGEST_FIRST_ZOOM)
    middle = math.degrees(math.atan(math.sinh((lower + upper) / 2 * math.tau)))
    zoom = min(max(math.log2(FIRST_TILES / share), 0.0), LARGEST_FIRST_ZOOM)
    return {"center": [round((west + east) / 2, 6), round(middle, 6)], "zoom": round(zoom, 2)}


def _check_choice(name: str, value: str, known: Any) -> None:
    if value not in known:
        raise BadQueryError.about(name, say("style.no_such", name=value[:100], names=", ".join(known)))


def _conditional(request: Request, content: bytes, media_type: str, caching: str) -> Response:
    etag = f'W/"{sha256(content).hexdigest()[:20]}"'
    return unless_known(request, content, media_type, {"ETag": etag, "Cache-Control": caching})
