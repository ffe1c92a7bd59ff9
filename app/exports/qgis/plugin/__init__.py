"""Versant's plug-in for QGIS: a Processing provider. It runs in QGIS's own Python, and imports nothing of ours."""

from __future__ import annotations

from typing import Any


def classFactory(_iface: Any) -> Any:
    """What QGIS asks a plug-in for."""
    from .provider import VersantPlugin  # noqa: PLC0415 - the service counts this file among its own, without QGIS

    return VersantPlugin()
