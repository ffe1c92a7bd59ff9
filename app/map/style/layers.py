"""The layers of the map's style: which line is drawn where, how wide and in which colour; arrows and figures.

They are data in the language of MapLibre's style specification, version 8. Tiles bring a road's class, its slope, its
sigma and drives, and of segments the elevation model's slope, bridges and tunnels; everything is said with these.
Colour is one thing (``app.map.style.scale``); width is the road's class and, where measured slopes are shown, certainty
too, as on the service's own pictures. Bridges have rims, tunnels are dashed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain
from typing import Any

from app.map.picture import slope_map
from app.map.style.names import LABEL_FONTS, Names, labels, waters
from app.map.style.scale import SIGMA, ColourScale, Expression, Shown, linear
from app.map.style.signs import UPHILL

SOURCE, LAYER = "slopes", "segments"
"""Name of the tiles in the style, and of their layer of segments; at low zooms it holds merged roads."""

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
CAPS: Expression = ["step", ["zoom"], "butt", 14, "round"]
"""Round ends of many short lines are most of what a browser draws; where lines are thin nobody sees them."""
CASE_PX = (0.0, 0.0, 0.8, 1.6, 2.4)
"""By so much the ground shows on both sides of a line, so that crossing roads keep apart."""
FIRST_ZOOMS = {"major": 0, "middle": 0, "minor": 11, "lesser": 12}
"""From which zoom on roads of unknown slope are drawn; a driven road is drawn wherever tiles have it."""

FIGURES_FROM, SIGMAS_FROM = 15.5, 17.5
ARROW_STEEPNESS = (14, 4.0, 15, 2.0, 16, slope_map.ARROW_PERCENT)
"""Zoom and steepness from which on an arrow stands there, by turns."""


@dataclass(frozen=True)
class Theme:
    """Colours of all that is no measurement."""

    ground: str
    unknown: str
    ink: str
    rim: str
    arrow: str
    arrow_edge: str
    names: Names


LIGHT = Theme(
    ground="#f7f6f2",
    unknown="#bfc4c8",
    ink="#20262b",
    rim="#5d666d",
    arrow="#ffffff",
    arrow_edge="#20262b",
    names=Names(ground="#f7f6f2", place="#20262b", street="#454d54", water="#3b6d96", stream="#b5d0e4"),
)
DARK = Theme(
    ground="#15191d",
    unknown="#4b555d",
    ink="#e8ecef",
    rim="#98a3ab",
    arrow="#0c0f11",
    arrow_edge="#f4f6f7",
    names=Names(ground="#15191d", place="#e8ecef", street="#b4bdc4", water="#86b4da", stream="#27455e"),
)

RIM_PX = 1.5
"""Of a bridge, on both sides."""
RIMS_FROM = 13.5
"""Further out a rim would be as wide as the road."""
DASH = (1.4, 0.9)
"""What is not seen and what is seen of a tunnel, in widths of its line."""

_CLASS: Expression = ["get", "highway"]


def layers(theme: Theme, scale: ColourScale, shown: Shown, drawn: str = LAYER) -> list[dict[str, Any]]:
    """All layers, the lowest first; ``scale`` is that of ``shown``, ``drawn`` the tiles' layer."""
    grounds: list[dict[str, Any]] = [
        {"id": "ground", "type": "background", "paint": {"background-color": theme.ground}}
    ]
    kinds = ("lesser", "minor", "middle", "major")
    unknown = [_unknown(theme, shown, kind) for kind in kinds]
    cases = [_known(kind, "case", theme.ground, shown) for kind in kinds]
    known = [_known(kind, "slope", _stepped(scale, shown), shown) for kind in kinds]
    arrows = [] if shown.uphill is None else [_arrows(theme, shown, shown.uphill)]
    under, over = (_rims(theme, shown, known=one) for one in (False, True))
    roads = [under, *unknown, *cases, over, *known, _dashes(theme), *arrows, _figures(theme, shown)]
    slopes = [one | {"source-layer": drawn} for one in roads]
    # What is higher gets its place first. Names are few; where figures stand before them, steep streets have none.
    return [*grounds, waters(theme.names), *slopes, *labels(theme.names)]


def _line(name: str, conditions: list[Expression], paint: dict[str, Any], **more: Any) -> dict[str, Any]:
    layout = {"line-cap": CAPS, "line-join": "round"} | more.pop("layout", {})
    drawn = {"filter": ["all", *conditions], "layout": layout, "paint": paint}
    return {"id": name, "type": "line", "source": SOURCE, **more, **drawn}


def _unknown(theme: Theme, shown: Shown, kind: str) -> dict[str, Any]:
    first = {"minzoom": FIRST_ZOOMS[kind]} if FIRST_ZOOMS[kind] else {}
    paint = {"line-color": theme.unknown, "line-width": _by_zoom(_unknown_widths(kind))}
    return _line(f"unknown-{kind}", [["!", shown.known], _of_kind(kind)], paint, **first)


def _unknown_widths(kind: str) -> list[float]:
    return [max(round(UNKNOWN_SHARE * width, 2), LEAST_WIDTH_PX) for width in WIDTHS_PX[kind]]


def _known_widths(kind: str, shown: Shown) -> list[Expression]:
    share = _certainty() if shown.widths_tell else 1
    return [["max", ["*", width, share], LEAST_WIDTH_PX] for width in WIDTHS_PX[kind]]


def _known(kind: str, part: str, colour: Any, shown: Shown) -> dict[str, Any]:
    """Lines of one kind of road: the slope itself, or the ground around it."""
    more = CASE_PX if part == "case" else (0.0,) * len(ZOOMS)
    widths = [["+", width, case] for width, case in zip(_known_widths(kind, shown), more, strict=True)]
    layout = {"line-sort-key": shown.rank} | ({"line-cap": "butt"} if part == "case" else {})
    first = {"minzoom": 12} if part == "case" else {}
    paint = {"line-color": colour, "line-width": _by_zoom(widths)}
    return _line(f"{part}-{kind}", [shown.known, _of_kind(kind)], paint, layout=layout, **first)


def _rims(theme: Theme, shown: Shown, *, known: bool) -> dict[str, Any]:
    """Of bridges, below the road that they carry."""
    widths_of = [_known_widths(kind, shown) if known else _unknown_widths(kind) for kind in WIDTHS_PX]
    widths = [["+", _by_kind(*widths_at_zoom), 2 * RIM_PX] for widths_at_zoom in zip(*widths_of, strict=True)]
    name, mine = ("bridge", shown.known) if known else ("bridge-unknown", ["!", shown.known])
    paint = {"line-color": theme.rim, "line-width": _by_zoom(widths)}
    return _line(name, [["has", "bridge"], mine], paint, layout={"line-cap": "butt"}, minzoom=RIMS_FROM)


def _dashes(theme: Theme) -> dict[str, Any]:
    """Of tunnels, over the road, which is under the ground."""
    widths = [
        _by_kind(*(1.1 * width for width in at_zoom)) for at_zoom in zip(*WIDTHS_PX.values(), strict=True)
    ]
    paint = {"line-color": theme.ground, "line-width": _by_zoom(widths), "line-dasharray": list(DASH)}
    return _line("tunnel", [["has", "tunnel"]], paint, layout={"line-cap": "butt"}, minzoom=RIMS_FROM)


def _by_kind(major: Any, middle: Any, minor: Any, lesser: Any) -> Expression:
    return ["match", _CLASS, list(MAJOR), major, list(MIDDLE), middle, list(MINOR), minor, lesser]


def _arrows(theme: Theme, shown: Shown, slope: Expression) -> dict[str, Any]:
    """Uphill, where it is steep and the sign beyond doubt. A line runs from from_node, so downhill is turned round."""
    steepness: Expression = ["abs", slope]
    zoom, least, *later = ARROW_STEEPNESS
    steep: Expression = [">=", steepness, ["step", ["zoom"], least, *later]]
    return {
        "id": "uphill",
        "type": "symbol",
        "source": SOURCE,
        "minzoom": zoom,
        "filter": ["all", shown.known, shown.sure, steep],
        "layout": {
            "symbol-placement": "line-center",
            "symbol-sort-key": ["-", 0, steepness],
            "icon-image": UPHILL,
            "icon-size": _by_zoom([0.5, 0.5, 0.5, 0.75, 1.1]),
            "icon-rotate": ["case", ["<", slope, 0], 180, 0],
            "icon-rotation-alignment": "map",
            "icon-keep-upright": False,
            "icon-padding": _by_zoom([10, 10, 10, 3, 3]),
        },
        "paint": {"icon-color": theme.arrow, "icon-halo-color": theme.arrow_edge, "icon-halo-width": 1},
    }


def _figures(theme: Theme, shown: Shown) -> dict[str, Any]:
    """Percent beside the road; with its sigma where there is room."""
    value = _number(shown.figure, ["case", [">=", shown.figure, 9.95], 0, 1])
    text: Expression = ["concat", value, " %"]
    if shown.sigma is not None:
        sigma = _number(shown.sigma, ["case", [">=", shown.sigma, 0.095], 1, 2])
        text = ["step", ["zoom"], text, SIGMAS_FROM, ["concat", value, " ± ", sigma, " %"]]
    return {
        "id": "figures",
        "type": "symbol",
        "source": SOURCE,
        "minzoom": FIGURES_FROM,
        "filter": [
            "all",
            shown.known,
            [">=", shown.figure, ["step", ["zoom"], slope_map.ARROW_PERCENT, 17, 0]],
        ],
        "layout": {
            "symbol-placement": "line-center",
            "symbol-sort-key": ["-", 0, shown.figure],
            "text-field": text,
            "text-font": LABEL_FONTS,
            "text-size": linear(15, 10, 19, 14),
            # Beside the widest line, and clear of the arrow on it.
            "text-offset": linear(15, ["literal", [0, 1.6]], 19, ["literal", [0, 1.9]]),
            "text-padding": 4,
            "text-max-angle": 30,
        },
        "paint": {"text-color": theme.ink, "text-halo-color": theme.ground, "text-halo-width": 1.5},
    }


def _number(value: Expression, digits: Expression) -> Expression:
    return ["number-format", value, {"min-fraction-digits": digits, "max-fraction-digits": digits}]


def _stepped(scale: ColourScale, shown: Shown) -> Expression:
    """The colour of each class of the scale."""
    later = zip(scale.breaks_percent[1:], scale.colours[1:], strict=True)
    return ["step", shown.value, scale.colours[0], *chain(*later)]


def _certainty() -> Expression:
    """The share of its width that a line of this sigma has: that of ``app.map.picture.slope_map.line_widths``."""
    narrowest = slope_map.UNSURE_WIDTH_PT / slope_map.SURE_WIDTH_PT
    sure, unsure = math.log(slope_map.SURE_SIGMA_PERCENT), math.log(slope_map.UNSURE_SIGMA_PERCENT)
    return ["interpolate", ["linear"], ["ln", ["max", SIGMA, 1e-3]], sure, 1, unsure, narrowest]


def _by_zoom(values: list[Any]) -> Expression:
    return ["interpolate", ["exponential", 1.5], ["zoom"], *chain(*zip(ZOOMS, values, strict=True))]


def _of_kind(kind: str) -> Expression:
    named = {"major": MAJOR, "middle": MIDDLE, "minor": MINOR}.get(kind)
    return ["match", _CLASS, list(named or (*MAJOR, *MIDDLE, *MINOR)), named is not None, named is None]
