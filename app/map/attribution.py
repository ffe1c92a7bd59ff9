"""Whose data the outputs derive from. OpenStreetMap's licence wants it said wherever the data goes."""

from __future__ import annotations

from collections.abc import Iterable

OSM_ATTRIBUTION = "© OpenStreetMap contributors"
OSM_LICENSE = "Open Database License (ODbL) 1.0"
OSM_LICENSE_URL = "https://opendatacommons.org/licenses/odbl/1-0/"
OSM_COPYRIGHT_URL = "https://www.openstreetmap.org/copyright"


def attribution(dem_names: Iterable[str] = ()) -> str:
    """One line of plain text: OpenStreetMap and its licence, then the elevation rasters by name."""
    roads = f"Roads {OSM_ATTRIBUTION}, {OSM_LICENSE}"
    names = sorted(set(dem_names))
    return f"{roads}; elevation from {_shortened(names)}" if names else roads


def attribution_html(dem_names: Iterable[str] = ()) -> str:
    """The same for a map's corner, with a link."""
    roads = f'<a href="{OSM_COPYRIGHT_URL}">{OSM_ATTRIBUTION}</a>'
    names = sorted(set(dem_names))
    return f"{roads}, elevation from {_escaped(_shortened(names))}" if names else roads


def _shortened(names: list[str], most: int = 4) -> str:
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more rasters" if rest > 0 else "")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
