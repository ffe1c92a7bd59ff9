"""The map's labels beside figures: names of places, waters and streets, and numbers of roads, from tiles of their own.

Slopes are what the map is for: names stand beside the roads, on the other side than figures and clear of arrows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.map.style.scale import Expression, linear

NAMES = "names"
"""The source in the style."""
LABEL_FONTS = ["DejaVu Sans"]
"""One for all labels: each more costs a map another 50 kB of letters."""
PLACE_RANKS = {"city": 0, "town": 1, "village": 2, "suburb": 3, "hamlet": 4}
_HALO_PX = 1.5
_ROADS_FROM = {"motorway": 9, "trunk": 10, "primary": 11, "secondary": 12, "tertiary": 13}
"""Numbers of roads; tiles have them a little earlier than a map needs them."""


@dataclass(frozen=True)
class Names:
    """Colours."""

    ground: str
    """Around letters"""
    place: str
    street: str
    water: str
    """Of its letters"""
    stream: str
    """Of its line"""


def waters(colours: Names) -> dict[str, Any]:
    """Lines of waters with a name, below all roads."""
    wide: Expression = ["match", ["get", "kind"], "river", 2.0, "canal", 1.4, 1.0]
    widths = linear(9, ["*", 0.5, wide], 13, wide, 18, ["*", 4, wide])
    paint = {"line-color": colours.stream, "line-width": widths}
    return _layer("water", "line", "water", {"line-cap": "round", "line-join": "round"}, paint, minzoom=9)


def labels(colours: Names) -> list[dict[str, Any]]:
    """Names along lines and of places, lowest first."""
    return [_water_names(colours), _street_names(colours), _numbers(colours), _places(colours)]


def _street_names(colours: Names) -> dict[str, Any]:
    layout = {
        "symbol-placement": "line",
        "symbol-spacing": 300,
        "symbol-sort-key": ["get", "rank"],
        "text-field": ["get", "name"],
        "text-size": linear(13, 10, 16, 11.5, 19, 14),
        "text-offset": linear(
            13, ["literal", [0, -0.9]], 16, ["literal", [0, -1.3]], 19, ["literal", [0, -1.6]]
        ),
        "text-padding": 3,
    }
    most: Expression = ["step", ["zoom"], 1, 14, 2, 15.5, 3]
    shown: Expression = ["<=", ["get", "rank"], most]
    return _label("street-names", "streets", layout, colours.street, colours, minzoom=13, filter=shown)


def _numbers(colours: Names) -> dict[str, Any]:
    layout = {
        "symbol-placement": "line",
        "symbol-spacing": 400,
        "text-field": ["get", "ref"],
        "text-size": linear(9, 9.5, 16, 12),
        "text-rotation-alignment": "viewport",
        "text-padding": 10,
    }
    first = [part for kind, zoom in _ROADS_FROM.items() for part in (kind, zoom)]
    shown: Expression = ["step", ["zoom"], False]
    for zoom in range(min(_ROADS_FROM.values()), max(_ROADS_FROM.values()) + 1):
        shown += [zoom, ["<=", ["match", ["get", "kind"], *first, 99], zoom]]
    return _label("road-numbers", "roads", layout, colours.place, colours, minzoom=9, filter=shown)


def _water_names(colours: Names) -> dict[str, Any]:
    layout = {
        "symbol-placement": "line",
        "symbol-spacing": 350,
        "text-field": ["get", "name"],
        "text-size": linear(11, 9.5, 16, 12),
        "text-letter-spacing": 0.08,
        "text-max-angle": 30,
    }
    return _label("water-names", "water", layout, colours.water, colours, minzoom=11)


def _places(colours: Names) -> dict[str, Any]:
    ranks = [part for kind, rank in PLACE_RANKS.items() for part in (kind, rank)]
    rank: Expression = ["match", ["get", "kind"], *ranks, 9]
    sizes = {4: (12, 10, 10, 10), 10: (16, 13, 10, 10), 14: (20, 16, 13, 11)}
    size = linear(
        *(
            part
            for zoom, (city, town, village, rest) in sizes.items()
            for part in (zoom, ["match", rank, 0, city, 1, town, 2, village, rest])
        )
    )
    layout = {
        # Of equals the one with more people.
        "symbol-sort-key": ["-", ["*", rank, 1e9], ["coalesce", ["get", "population"], 0]],
        "text-field": ["get", "name"],
        "text-size": size,
        "text-max-width": 8,
        "text-padding": 6,
    }
    # A town's name in the middle of its streets says nothing new.
    shown: Expression = ["step", ["zoom"], True, 15, [">=", rank, 2], 17, False]
    return _label("places", "places", layout, colours.place, colours, filter=shown)


def _label(
    name: str, of: str, layout: dict[str, Any], ink: str, colours: Names, **more: Any
) -> dict[str, Any]:
    paint = {"text-color": ink, "text-halo-color": colours.ground, "text-halo-width": _HALO_PX}
    return _layer(name, "symbol", of, {"text-font": LABEL_FONTS, **layout}, paint, **more)


def _layer(
    name: str, kind: str, of: str, layout: dict[str, Any], paint: dict[str, Any], **more: Any
) -> dict[str, Any]:
    where = {"id": name, "type": kind, "source": NAMES, "source-layer": of}
    return {**where, **more, "layout": layout, "paint": paint}
