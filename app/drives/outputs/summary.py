"""The result of a drive in one line, after its log was given: the same for files and for a service.

Loads nothing but words, since clients say it, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.core.messages import say
from fusion.messages import joined


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
    facts = joined(parts, ", ")
    return say("summary.facts", name=name, facts=facts) if facts else say("summary.processed", name=name)


def _length(distance_m: float | None) -> str:
    if distance_m is None:
        return ""
    return f"{distance_m / 1000:.1f} km" if distance_m >= 1000 else f"{distance_m:.0f} m"


def _segments(count: int | None) -> str:
    if count is None:
        return ""
    return say("summary.segments", n=count) if count else say("summary.no_slope")


def _sigma(sigma_percent: float | None) -> str:
    return "" if sigma_percent is None else say("summary.sigma", percent=sigma_percent)


def _terrain(report: Mapping[str, Any]) -> str:
    if "dem_share" not in report:
        return ""
    share = report["dem_share"]
    if share is None:
        return say("summary.no_model")
    if report.get("dem_only"):
        return say("summary.model_alone")
    return "" if share else say("summary.no_model_there")
