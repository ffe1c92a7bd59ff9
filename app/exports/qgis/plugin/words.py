"""Sentences of the plug-in in the language of QGIS. Those of the service come from it as they are."""

from __future__ import annotations

from qgis.core import QgsApplication


def language() -> str:
    """``de`` or ``en``: what QGIS speaks, as far as the plug-in speaks it."""
    return "de" if QgsApplication.locale().startswith("de") else "en"


def either(english: str, german: str) -> str:
    """One of the two."""
    return german if language() == "de" else english
