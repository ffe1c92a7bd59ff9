"""The layers of the map's style: which line is drawn where, how wide and in which colour; arrows and figures.

They are data in the language of MapLibre's style specification, version 8. Tiles bring a road's class, its slope, its
sigma and drives; everything is said with these. Colour is one thing, steepness or certainty; width is the road's class
and, in the map of steepness, certainty too, as on the service's own pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from app.map.slope_map import (
    ARROW_PERCENT,
    DOUBT,
    SURE_SIGMA_PERCENT,
    SURE_WIDTH_PT,
    UNSURE_SIGMA_PERCENT,
    UNSURE_WIDTH_PT,
)
from app.map.style.scale import ColourScale
from app.map.style.sprites import UPHILL

Expression = list[Any]

SOURCE, LAYER = "slopes", "segments"
"""Name of the tiles in the style, and of their layer of segments; at low zooms it holds merged roads."""
LABEL_FONTS = ["DejaVu Sans"]

MAJOR = ("motorway", "motorway_link", "trunk", "trunk_link", "primary", "primary_link")
MIDDLE = ("secondary", "secondary_link", "tertiary", "tertiary_link")
MINOR = ("residential", "unclassified", "living_street", "road")
"""Classes of roads; what is in none of them is lesser: service roads, tracks."""

ZOOMS = (6, 10, 13, 16, 19)
WIDTHS_PX = {
    "major": (1.6, 2.4, 4.2, 9.0, 22.0),
    "middle": (1.3, 2.0, 3.4, 8.0, 18.0),
    "minor": (1.0, 1.5, 2.4, 6.5, 15.0),
    "lesser": (0.8, 1.2, 1.8, 5.0, 11.0),
}
"""Of lines of known and sure slope at ``ZOOMS``."""
UNKNOWN_SHARE = 0.4
"""Of that width, how much a road of unknown slope has."""
LEAST_WIDTH_PX = 0.7
CASE_PX = (0.0, 0.0, 0.8, 1.6, 2.4)
"""By so much the ground shows on both sides of a line, so that crossing roads keep apart."""
FIRST_ZOOMS = {"major": 0, "middle": 0, "minor": 11, "lesser": 12}
"""From which zoom on roads of unknown slope are drawn; a driven road is drawn wherever tiles have it."""

ARROWS_FROM, FIGURES_FROM, SIGMAS_FROM = 14, 15.5, 17.5
ARROW_STEEPNESS = (14, 4.0, 15, 2.0, 16, ARROW_PERCENT)
"""Zoom and steepness from which on an arrow stands there, by turns."""


@dataclass(frozen=True)
class Theme:
    """Colours of all that is no measurement."""

    ground: str
    unknown: str
    ink: str
    arrow: str
    arrow_edge: str


LIGHT = Theme(ground="#f7f6f2", unknown="#bfc4c8", ink="#20262b", arrow="#ffffff", arrow_edge="#20262b")
DARK = Theme(ground="#15191d", unknown="#4b555d", ink="#e8ecef", arrow="#0c0f11", arrow_edge="#f4f6f7")

_SLOPE: Expression = ["get", "slope_percent"]
_STEEPNESS: Expression = ["abs", _SLOPE]
_SIGMA: Expression = ["coalesce", ["get", "slope_sigma_percent"], UNSURE_SIGMA_PERCENT]
_KNOWN: Expression = ["has", "slope_percent"]
_CLASS: Expression = ["get", "highway"]


def layers(theme: Theme, scale: ColourScale, colour: str) -> list[dict[str, Any]]:
    """All layers, the lowest first; ``scale`` is that of ``colour``."""
    grounds: list[dict[str, Any]] = [
        {"id": "ground", "type": "background", "paint": {"background-color": theme.ground}}
    ]
    kinds = ("lesser", "minor", "middle", "major")
    unknown = [_unknown(theme, kind) for kind in kinds]
    cases = [_known(kind, "case", theme.ground, colour) for kind in kinds]
    known = [_known(kind, "slope", _stepped(scale, colour), colour) for kind in kinds]
    return [*grounds, *unknown, *cases, *known, _arrows(theme), _figures(theme)]


def _line(name: str, conditions: list[Expression], paint: dict[str, Any], **more: Any) -> dict[str, Any]:
    layout = {"line-cap": "round", "line-join": "round"} | more.pop("layout", {})
    return {
        "id": name,
        "type": "line",
        "source": SOURCE,
        "source-layer": LAYER,
        **more,
        "filter": ["all", *conditions],
        "layout": layout,
        "paint": paint,
    }


def _unknown(theme: Theme, kind: str) -> dict[str, Any]:
    widths = [max(round(UNKNOWN_SHARE * width, 2), LEAST_WIDTH_PX) for width in WIDTHS_PX[kind]]
    first = {"minzoom": FIRST_ZOOMS[kind]} if FIRST_ZOOMS[kind] else {}
    paint = {"line-color": theme.unknown, "line-width": _by_zoom(widths)}
    return _line(f"unknown-{kind}", [["!", _KNOWN], _of_kind(kind)], paint, **first)


def _known(kind: str, part: str, colour: Any, shown: str) -> dict[str, Any]:
    """Lines of one kind of road: the slope itself, or the ground around it."""
    share = _certainty() if shown == "steepness" else 1
    more = CASE_PX if part == "case" else (0.0,) * len(ZOOMS)
    widths = [
        ["+", ["max", ["*", width, share], LEAST_WIDTH_PX], case]
        for width, case in zip(WIDTHS_PX[kind], more, strict=True)
    ]
    # What matters most lies on top where roads meet.
    rank = _STEEPNESS if shown == "steepness" else ["-", 0, _SIGMA]
    layout = {"line-sort-key": rank} | ({"line-cap": "butt"} if part == "case" else {})
    first = {"minzoom": 12} if part == "case" else {}
    paint = {"line-color": colour, "line-width": _by_zoom(widths)}
    return _line(f"{part}-{kind}", [_KNOWN, _of_kind(kind)], paint, layout=layout, **first)


def _arrows(theme: Theme) -> dict[str, Any]:
    """Uphill, where it is steep and the sign beyond doubt. A line runs from from_node, so downhill is turned round."""
    sure: Expression = [">", _STEEPNESS, ["*", DOUBT, _SIGMA]]
    zoom, least, *later = ARROW_STEEPNESS
    steep: Expression = [">=", _STEEPNESS, ["step", ["zoom"], least, *later]]
    return {
        "id": "uphill",
        "type": "symbol",
        "source": SOURCE,
        "source-layer": LAYER,
        "minzoom": zoom,
        "filter": ["all", _KNOWN, sure, steep],
        "layout": {
            "symbol-placement": "line-center",
            "symbol-sort-key": ["-", 0, _STEEPNESS],
            "icon-image": UPHILL,
            "icon-size": _by_zoom([0.5, 0.5, 0.5, 0.75, 1.1]),
            "icon-rotate": ["case", ["<", _SLOPE, 0], 180, 0],
            "icon-rotation-alignment": "map",
            "icon-keep-upright": False,
            "icon-padding": _by_zoom([10, 10, 10, 3, 3]),
        },
        "paint": {
            "icon-color": theme.arrow,
            "icon-halo-color": theme.arrow_edge,
            "icon-halo-width": 1,
        },
    }


def _figures(theme: Theme) -> dict[str, Any]:
    """Steepness in percent beside the road; with its sigma where there is room."""
    value = _number(_STEEPNESS, ["case", [">=", _STEEPNESS, 9.95], 0, 1])
    both: Expression = ["concat", value, " ± ", _number(_SIGMA, ["case", [">=", _SIGMA, 0.095], 1, 2]), " %"]
    return {
        "id": "figures",
        "type": "symbol",
        "source": SOURCE,
        "source-layer": LAYER,
        "minzoom": FIGURES_FROM,
        "filter": ["all", _KNOWN, [">=", _STEEPNESS, ["step", ["zoom"], ARROW_PERCENT, 17, 0]]],
        "layout": {
            "symbol-placement": "line-center",
            "symbol-sort-key": ["-", 0, _STEEPNESS],
            "text-field": ["step", ["zoom"], ["concat", value, " %"], SIGMAS_FROM, both],
            "text-font": LABEL_FONTS,
            "text-size": ["interpolate", ["linear"], ["zoom"], 15, 10, 19, 14],
            # Beside the widest line, and clear of the arrow on it.
            "text-offset": [
                "interpolate",
                ["linear"],
                ["zoom"],
                15,
                ["literal", [0, 1.6]],
                19,
                ["literal", [0, 1.9]],
            ],
            "text-padding": 4,
            "text-max-angle": 30,
        },
        "paint": {"text-color": theme.ink, "text-halo-color": theme.ground, "text-halo-width": 1.5},
    }


def _number(value: Expression, digits: Expression) -> Expression:
    return ["number-format", value, {"min-fraction-digits": digits, "max-fraction-digits": digits}]


def _stepped(scale: ColourScale, colour: str) -> Expression:
    """The colour of each class of the scale."""
    value = _STEEPNESS if colour == "steepness" else _SIGMA
    out: Expression = ["step", value, scale.colours[0]]
    for lower, shade in zip(scale.breaks_percent[1:], scale.colours[1:], strict=True):
        out += [lower, shade]
    return out


def _certainty() -> Expression:
    """The share of its width that a line of this sigma has: that of ``app.map.slope_map.line_widths``."""
    return [
        "interpolate", ["linear"], ["ln", ["max", _SIGMA, 1e-3]],
        math.log(SURE_SIGMA_PERCENT), 1, math.log(UNSURE_SIGMA_PERCENT), UNSURE_WIDTH_PT / SURE_WIDTH_PT,
    ]  # fmt: skip


def _by_zoom(values: list[Any]) -> Expression:
    out: Expression = ["interpolate", ["exponential", 1.5], ["zoom"]]
    for zoom, value in zip(ZOOMS, values, strict=True):
        out += [zoom, value]
    return out


def _of_kind(kind: str) -> Expression:
    named = {"major": MAJOR, "middle": MIDDLE, "minor": MINOR}
    if kind in named:
        return ["match", _CLASS, list(named[kind]), True, False]
    return ["match", _CLASS, [*MAJOR, *MIDDLE, *MINOR], False, True]
