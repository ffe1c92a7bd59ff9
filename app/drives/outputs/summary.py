"""The result of a drive in one line, after its log was given: the same for files and for a service.

Loads nothing, since clients say it, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def summary(name: str, report: Mapping[str, Any]) -> str:
    """One line of a drive's report: kilometres, segments, median sigma, and whether an elevation model took part.

    What the report of an older version does not know is left out.
    """
    parts = [
        _length(report.get("distance_m")),
        _segments(report.get("segments_estimated")),
        _sigma(report.get("median_slope_sigma_percent")),
        _terrain(report),
    ]
    facts = ", ".join(part for part in parts if part)
    return f"{name}: {facts}." if facts else f"{name}: processed."


def _length(distance_m: float | None) -> str:
    if distance_m is None:
        return ""
    return f"{distance_m / 1000:.1f} km" if distance_m >= 1000 else f"{distance_m:.0f} m"


def _segments(count: int | None) -> str:
    if count is None:
        return ""
    return {0: "no segment got a slope", 1: "1 segment"}.get(count, f"{count:,} segments")


def _sigma(sigma_percent: float | None) -> str:
    return "" if sigma_percent is None else f"median sigma {sigma_percent:.2g} %"


def _terrain(report: Mapping[str, Any]) -> str:
    if "dem_share" not in report:
        return ""
    share = report["dem_share"]
    if share is None:
        return "no elevation model"
    if report.get("dem_only"):
        return "by the elevation model alone"
    return "" if share else "no elevation model there"
