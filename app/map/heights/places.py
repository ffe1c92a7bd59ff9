"""Places as clients send them: pairs of numbers, or a polyline in which each place is the step from the one before.

The polyline is Google's encoding (five decimals) and Valhalla's of it (six); see the documents of either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.core.errors import BadRequestError
from app.core.messages import say
from fusion.types import Floats

ENCODED = "enc:"
"""What Google's service has before a polyline."""
MOST_PLACES = 10_000
MEAN_RADIUS_M = 6_371_008.8
_OFFSET, _MORE, _BITS = 63, 0x20, 5
_LONGEST = 7
"""Characters of a number: 35 bits hold 180 degrees in millionths."""


def from_pairs(lat_lon_deg: Sequence[tuple[float, float]] | Floats, field: str) -> Floats:
    """Rows of longitude and latitude, degrees, shape (n, 2); ``BadRequestError`` where one is none on Earth."""
    places = np.array(lat_lon_deg, float).reshape(-1, 2)[:, ::-1].copy()
    if not len(places):
        raise BadRequestError.about(field, say("heights.no_place"))
    bad = np.flatnonzero(~((np.abs(places[:, 0]) <= 180) & (np.abs(places[:, 1]) <= 90)))
    if len(bad):
        raise BadRequestError.about(
            field,
            say("heights.not_on_earth", n=bad[0] + 1),
        )
    return places


def from_text(text: str, field: str, most: int) -> Floats:
    """Places written ``lat,lon|lat,lon`` or ``enc:`` and a polyline of five decimals."""
    if text.startswith(ENCODED):
        return from_polyline(text.removeprefix(ENCODED), 5, field, most)
    parts = text.split("|")
    check_number(len(parts), field, most)
    pairs: list[tuple[float, float]] = []
    for n, part in enumerate(parts, 1):
        try:
            lat, lon = (float(number) for number in part.split(","))
        except ValueError:
            raise BadRequestError.about(field, say("heights.no_pair", n=n, text=part[:40])) from None
        pairs.append((lat, lon))
    return from_pairs(pairs, field)


def from_polyline(text: str, digits: int, field: str, most: int) -> Floats:
    """The places of an encoded polyline of so many decimals."""
    numbers: list[int] = []
    value, shift = 0, 0
    for character in text:
        bits = ord(character) - _OFFSET
        if not 0 <= bits < 2 * _MORE or shift >= _LONGEST * _BITS:
            raise _malformed(field, character)
        value |= (bits % _MORE) << shift
        shift += _BITS
        if bits < _MORE:
            numbers.append(~(value >> 1) if value & 1 else value >> 1)
            value, shift = 0, 0
    if shift or len(numbers) % 2:
        raise _malformed(field, "its end")
    check_number(len(numbers) // 2, field, most)
    steps = np.array(numbers, float).reshape(-1, 2).cumsum(axis=0) / 10**digits
    return from_pairs(steps, field)


def check_number(places: int, field: str, most: int) -> None:
    """``BadRequestError`` for more places than one request may ask for."""
    if places > most:
        raise BadRequestError.about(field, say("heights.many", n=places, most=most))


def spread(places: Floats, count: int) -> Floats:
    """``count`` places at equal distances along the line through ``places``, its ends among them."""
    along_m = distances_along_m(places)
    targets_m = np.linspace(0, along_m[-1], count)
    return np.column_stack([np.interp(targets_m, along_m, places[:, axis]) for axis in (0, 1)])


def distances_along_m(places: Floats) -> Floats:
    """Metres from the first place along the line through all of them, shape (n,); on a sphere."""
    lon, lat = np.radians(places).T
    half = np.sin(np.diff(lat) / 2) ** 2 + np.cos(lat[:-1]) * np.cos(lat[1:]) * np.sin(np.diff(lon) / 2) ** 2
    return np.concatenate([[0.0], np.cumsum(2 * MEAN_RADIUS_M * np.arcsin(np.sqrt(half)))])


def _malformed(field: str, where: str) -> BadRequestError:
    return BadRequestError.about(field, say("heights.no_polyline", where=where))
