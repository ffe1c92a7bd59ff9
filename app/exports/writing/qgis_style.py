"""The style that QGIS draws segments with, as the map of slopes draws them: colour is steepness, width is certainty.

QGIS reads it from a GeoPackage's table ``layer_styles``, or from the ``.qml`` beside a file of the same name.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from app.map.style.scale import BREAKS_PERCENT, COLOURS, UNKNOWN_COLOUR

STYLE_NAME = "Slopes"
STYLE_DESCRIPTION = "Colour is steepness, width is certainty, dashed grey is unknown"
MARK = "Written by Versant with its exports, which renew it. Without this line it is left as it is."
"""A comment in the file: QGIS leaves it out where a person saves a style of their own."""

STEEPEST_PERCENT = 1000.0
UNKNOWN = -1.0
"""What the expression yields for a slope that is not known, since NULL would not be drawn."""
STEEPNESS = f'coalesce(abs("slope_percent"), {UNKNOWN:g})'
WIDEST_MM, NARROWEST_MM, UNKNOWN_MM = 1.8, 0.42, 0.26
WIDTH_MM = (
    f'coalesce(scale_linear(ln(max("slope_sigma_percent", 0.3)), ln(0.3), ln(3), {WIDEST_MM}, {NARROWEST_MM}), '
    f"{NARROWEST_MM})"
)
"""As ``app.map.picture.slope_map.line_widths``, in QGIS's language."""

_DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


def qml() -> str:
    """The style as QGIS's XML: a graduated renderer over the absolute slope."""
    root = Element("qgis", {"version": "3.28.0", "styleCategories": "Symbology"})
    renderer = SubElement(
        root,
        "renderer-v2",
        {
            "type": "graduatedSymbol",
            "attr": STEEPNESS,
            "graduatedMethod": "GraduatedColor",
            "forceraster": "0",
            "symbollevels": "0",
            "enableorderby": "0",
            "referencescale": "-1",
        },
    )
    ranges, symbols = SubElement(renderer, "ranges"), SubElement(renderer, "symbols")
    for number, (lower, upper, label) in enumerate(classes()):
        span = {"lower": f"{lower:.15f}", "upper": f"{upper:.15f}", "symbol": str(number), "label": label}
        key = f"{{{uuid5(NAMESPACE_URL, label)}}}"  # the same in every file, so that files can be compared
        SubElement(ranges, "range", {**span, "render": "true", "uuid": key})
        unknown = number == len(COLOURS)
        _symbol(symbols, str(number), UNKNOWN_COLOUR if unknown else COLOURS[number], dashed=unknown)
    _symbol(SubElement(renderer, "source-symbol"), "0", COLOURS[0], dashed=False)
    SubElement(root, "blendMode").text = "0"
    SubElement(root, "featureBlendMode").text = "0"
    SubElement(root, "layerGeometryType").text = "1"  # lines
    indent(root)
    return f"{_DOCTYPE}<!-- {MARK} -->\n{tostring(root, encoding='unicode')}\n"


def classes() -> list[tuple[float, float, str]]:
    """(lower, upper, label) of each class in the order of ``COLOURS``, then of the unknown."""
    steep = [(low, high, f"{low:g} to {high:g} %") for low, high in pairwise(BREAKS_PERCENT)]
    last = BREAKS_PERCENT[-1]
    return [*steep, (last, STEEPEST_PERCENT, f"{last:g} % and steeper"), (UNKNOWN, UNKNOWN / 2, "unknown")]


def style_beside(path: Path) -> dict[Path, str]:
    """The style under the name by which QGIS looks for one, with its text; nothing where a person's own is there."""
    place = path.with_suffix(".qml")
    try:
        ours = MARK in place.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        ours = True
    return {place: qml()} if ours else {}


def _symbol(parent: Element, name: str, colour: str, *, dashed: bool) -> None:
    facts = {"type": "line", "name": name, "alpha": "1", "clip_to_extent": "1", "force_rhr": "0"}
    symbol = SubElement(parent, "symbol", facts)
    layer = SubElement(symbol, "layer", {"class": "SimpleLine", "enabled": "1", "locked": "0", "pass": "0"})
    _options(
        layer,
        {
            "capstyle": "flat" if dashed else "round",
            "customdash": "2;1.6",
            "customdash_unit": "MM",
            "joinstyle": "round",
            "line_color": ",".join(str(int(colour[k : k + 2], 16)) for k in (1, 3, 5)) + ",255",
            "line_style": "solid",
            "line_width": f"{UNKNOWN_MM if dashed else WIDEST_MM}",
            "line_width_unit": "MM",
            "use_custom_dash": str(int(dashed)),
        },
    )
    by_data = SubElement(SubElement(layer, "data_defined_properties"), "Option", {"type": "Map"})
    SubElement(by_data, "Option", {"name": "name", "type": "QString", "value": ""})
    if dashed:
        SubElement(by_data, "Option", {"name": "properties"})
    else:
        properties = SubElement(by_data, "Option", {"name": "properties", "type": "Map"})
        width = SubElement(properties, "Option", {"name": "outlineWidth", "type": "Map"})
        SubElement(width, "Option", {"name": "active", "type": "bool", "value": "true"})
        SubElement(width, "Option", {"name": "expression", "type": "QString", "value": WIDTH_MM})
        SubElement(width, "Option", {"name": "type", "type": "int", "value": "3"})  # an expression
    SubElement(by_data, "Option", {"name": "type", "type": "QString", "value": "collection"})


def _options(layer: Element, values: dict[str, str]) -> None:
    options = SubElement(layer, "Option", {"type": "Map"})
    for name, value in values.items():
        SubElement(options, "Option", {"name": name, "type": "QString", "value": value})
