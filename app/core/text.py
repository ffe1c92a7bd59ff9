"""How values are written in every answer and every file: digits, times, compact JSON. Knows no document."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import PlainSerializer

GEO_JSON = "application/geo+json"

# Digits after the point
COORDINATE_DIGITS = 7  # degrees: OpenStreetMap's own resolution, about 1 cm
LENGTH_DIGITS = 3  # metres: a millimetre
SLOPE_DIGITS = 4  # percent: 1 mm per kilometre, far below any sigma


def rounded(value: float | None, digits: int) -> float | None:
    """``value`` rounded; None where it is None, NaN or infinite."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits) + 0.0  # -0.0 would print as such


def utc_text(moment: datetime | None) -> str | None:
    """RFC 3339 in UTC, to the millisecond, with a Z; ValueError for a naive time."""
    if moment is None:
        return None
    if moment.tzinfo is None:
        raise ValueError("a time without its zone cannot be written as UTC")
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def dumps(value: Any) -> str:
    """Compact JSON; ValueError for a NaN, which JSON does not have."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


Moment = Annotated[datetime, PlainSerializer(utc_text, return_type=str, when_used="json-unless-none")]
"""A time in a model of pydantic, written by ``utc_text``."""
