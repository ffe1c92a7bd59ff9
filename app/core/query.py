"""Query parameters: as the OGC standards define them, and where the next page of a list begins.

Knows no route and no database.
"""

from __future__ import annotations

import base64
import math
import re
import struct
from collections.abc import Collection
from datetime import UTC, datetime, timedelta

from fastapi import Request

from app.core.db import Bounds
from app.core.errors import BadQueryError, BadRequestError
from app.core.messages import say

THIN_DEG = 1e-9
"""0.1 mm, a hundredth of the resolution of coordinates."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_PLACE = struct.Struct(">q16s")  # microseconds since the epoch, a number of up to 128 bits
_CURSOR = re.compile(r"[A-Za-z0-9_-]{32}")


def cursor_of(moment: datetime, number: int) -> str:
    """The text that ``parse_cursor`` takes, of a place in a list that is ordered by a time and a number.

    Microseconds, the database's resolution, are kept; an id may be the number.
    """
    moment_us = (moment - _EPOCH) // timedelta(microseconds=1)
    return base64.urlsafe_b64encode(_PLACE.pack(moment_us, number.to_bytes(16))).decode("ascii")


def parse_cursor(text: str, most: int = 2**128 - 1) -> tuple[datetime, int]:
    """The time and the number, at most ``most``; ``BadRequestError`` for a text that ``cursor_of`` did not make."""
    try:
        if not _CURSOR.fullmatch(text):
            raise ValueError(text)
        moment_us, number = _PLACE.unpack(base64.urlsafe_b64decode(text))
        if (value := int.from_bytes(number)) > most:
            raise ValueError(text)
        return _EPOCH + timedelta(microseconds=moment_us), value
    except (ValueError, OverflowError):
        raise BadRequestError(
            say("query.after"),
            field="after",
        ) from None


def refuse_unknown(
    request: Request, known: Collection[str], error: type[BadRequestError] = BadQueryError
) -> None:
    """Raise ``error`` for a parameter that the route does not have (OGC 17-069, query-param-unknown).

    A filter that is misspelt and ignored would answer with everything.
    """
    for name in request.query_params:
        if name not in known:
            raise error(say("query.no_parameter", name=name, names=", ".join(sorted(known))), field=name)


def parse_bbox(text: str | None) -> Bounds | None:
    """West, south, east, north in degrees; of six numbers (with heights) the heights are dropped.

    West may exceed east: the box crosses the antimeridian. Raises ``BadQueryError``.
    """
    return None if text is None else box_of(*bbox_numbers(text))


def bbox_numbers(text: str) -> Bounds:
    """The four numbers of a box in the order in which they stand; of six the third and the last, heights, are dropped.

    Raises ``BadQueryError``.
    """
    numbers = [_number(part) for part in text.split(",")]
    if len(numbers) == 6:
        numbers = [*numbers[:2], *numbers[3:5]]
    if len(numbers) != 4:
        raise _bad_bbox(say("bbox.four"))
    first, second, third, fourth = numbers
    return first, second, third, fourth


def box_of(west: float, south: float, east: float, north: float) -> Bounds:
    """The box, with a width and a height; ``BadQueryError`` for one that reaches beyond the world."""
    if not (-180 <= west <= 180 and -180 <= east <= 180):
        raise _bad_bbox(say("bbox.west_east"))
    if not (-90 <= south <= north <= 90):
        raise _bad_bbox(say("bbox.south_north"))
    # A box without width or height is a line or a point to a person, but an invalid polygon to PostGIS.
    west, east = _with_width(west, east, 180)
    south, north = _with_width(south, north, 90)
    return west, south, east, north


def _with_width(low: float, high: float, most: float) -> tuple[float, float]:
    return (max(low - THIN_DEG, -most), min(high + THIN_DEG, most)) if low == high else (low, high)


def _number(part: str) -> float:
    text = part.strip(" ")
    # float() alone also takes 1_0, digits of other scripts, nan and inf.
    if not _NUMBER.fullmatch(text) or not math.isfinite(value := float(text)):
        raise _bad_bbox(say("bbox.no_number", text=part))
    return value


def _bad_bbox(reason: str) -> BadQueryError:
    return BadQueryError(say("bbox.wrong", reason=reason), field="bbox")
