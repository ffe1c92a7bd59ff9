"""NMEA 0183 sentences: finding them, their checksums, and the numbers of RMC, GGA, VTG, GST and ZDA."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date
from math import isfinite, radians

import numpy as np

from fusion.formats.base import Notes, Place
from fusion.types import Floats

SENTENCE = re.compile(rb"\$([A-Z][A-Z0-9]{3,9},[^\r\n$*]{0,400})(?:\*([0-9A-Fa-f]{2}))?")
CHECKED = re.compile(rb"\$([A-Z]{2}(?:RMC|GGA|VTG|GST|ZDA|GLL|GSA|GSV),[^\r\n$*]{0,400})\*([0-9A-Fa-f]{2})")
BEGINS = re.compile(rb"\s*\$[A-Z]{2}[A-Z]{3},")
KNOT_MPS = 1852 / 3600
KMH_MPS = 1 / 3.6
UNIX_ORDINAL = date(1970, 1, 1).toordinal()
NAN = float("nan")
WRONG_CHECKSUM = "NMEA sentences with a wrong checksum"


def looks_like_nmea(head: bytes) -> bool:
    """A sentence with the right checksum somewhere, or the beginning of one at the very start."""
    if BEGINS.match(head):
        return True
    return any(_xor(m.group(1)) == int(m.group(2), 16) for m in CHECKED.finditer(head))


def _xor(body: bytes) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)))


@dataclass
class Rows:
    """Sentences of one type: one row of numbers each, and where they begin."""

    offset: list[int] = field(default_factory=list)
    values: list[tuple[float, ...]] = field(default_factory=list)

    def columns(self, count: int) -> list[Floats]:
        """The numbers column by column, ``count`` arrays of (n,)."""
        return list(np.array(self.values, float).reshape(-1, count).T)


def checked_sentences(text: bytes, notes: Notes, place: Place) -> list[tuple[bytes, int]]:
    """Bodies and offsets of the sentences whose checksum is right.

    If no sentence at all has a checksum they are taken as they are; otherwise one without is a torn one.
    """
    matches = [(m.start(1), m.end(1), m.group(2)) for m in SENTENCE.finditer(text)]
    summed = [(a, b, int(c, 16)) for a, b, c in matches if c]
    if not summed:
        if matches:
            notes.warn("No NMEA sentence has a checksum: damage to them cannot be noticed.")
        return [(text[a:b], a - 1) for a, b, _ in matches]
    start, end, want = (np.array(c) for c in zip(*summed, strict=True))
    running = np.concatenate([[0], np.bitwise_xor.accumulate(np.frombuffer(text, np.uint8))]).astype(np.uint8)
    right = (running[end] ^ running[start]) == want
    for reason, wrong in (
        (WRONG_CHECKSUM, start[~right].tolist()),
        ("NMEA sentences cut short", [a for a, _, c in matches if not c]),
    ):
        if wrong:
            notes.skip(reason, len(wrong), place(wrong[0] - 1))
    return [(text[a:b], a - 1) for (a, b, _), ok in zip(summed, right.tolist(), strict=True) if ok]


def _number(cell: bytes) -> float:
    try:
        return float(cell)
    except ValueError:
        return NAN


def _get(cells: list[bytes], index: int) -> bytes:
    return cells[index] if index < len(cells) else b""


def _time_of_day(cell: bytes) -> float:
    """hhmmss(.sss) in seconds."""
    if not cell[:6].isdigit() or len(cell) < 6:
        return NAN
    hours, minutes, seconds = int(cell[:2]), int(cell[2:4]), _number(cell[4:])
    return hours * 3600 + minutes * 60 + seconds if hours < 24 and minutes < 60 and seconds < 61 else NAN


def _angle(cell: bytes, side: bytes, negative: bytes) -> float:
    """(d)ddmm.mmmm and its hemisphere in degrees."""
    value = _number(cell)
    if not value >= 0:
        return NAN
    degrees = value // 100
    minutes = value - 100 * degrees
    out = degrees + minutes / 60 if minutes <= 60 else NAN  # 59.99999 may be rounded up to 60
    return -out if side == negative else out


def _day(day: float, month: float, year: float) -> float:
    """Days since 1970-01-01."""
    try:
        return date(int(year), int(month), int(day)).toordinal() - UNIX_ORDINAL
    except (ValueError, OverflowError):
        return NAN


def _rmc(c: list[bytes]) -> tuple[float, ...]:
    mode = _get(c, 11)
    valid = _get(c, 1) == b"A" and mode not in (b"N", b"E", b"M")
    digits, day = _get(c, 8), NAN
    if len(digits) == 6 and digits.isdigit():
        year = int(digits[4:])
        day = _day(int(digits[:2]), int(digits[2:4]), year + (2000 if year < 80 else 1900))
    lat, lon = _angle(_get(c, 2), _get(c, 3), b"S"), _angle(_get(c, 4), _get(c, 5), b"W")
    speed, course = _number(_get(c, 6)) * KNOT_MPS, radians(_number(_get(c, 7)))
    return _time_of_day(_get(c, 0)), day, float(_get(c, 1) == b"A"), float(valid), lat, lon, speed, course


def _gga(c: list[bytes]) -> tuple[float, ...]:
    lat, lon = _angle(_get(c, 1), _get(c, 2), b"S"), _angle(_get(c, 3), _get(c, 4), b"W")
    return _time_of_day(_get(c, 0)), _number(_get(c, 5)), lat, lon, _number(_get(c, 8)), _number(_get(c, 10))


def _vtg(c: list[bytes]) -> tuple[float, ...]:
    knots, kmh = _number(_get(c, 4)), _number(_get(c, 6))
    speed = kmh * KMH_MPS if isfinite(kmh) else knots * KNOT_MPS
    valid = _get(c, 8) not in (b"N", b"E", b"M")
    return radians(_number(_get(c, 0))), speed if valid else NAN


def _gst(c: list[bytes]) -> tuple[float, ...]:
    return _time_of_day(_get(c, 0)), *(_number(_get(c, i)) for i in (5, 6, 7))


def _zda(c: list[bytes]) -> tuple[float, ...]:
    day, month, year = (_number(_get(c, i)) for i in (1, 2, 3))
    dated = isfinite(day + month + year)
    return _time_of_day(_get(c, 0)), _day(day, month, year) if dated else NAN


PARSERS: dict[str, Callable[[list[bytes]], tuple[float, ...]]] = {
    "RMC": _rmc, "GGA": _gga, "VTG": _vtg, "GST": _gst, "ZDA": _zda
}  # fmt: skip
WIDTH = {"RMC": 8, "GGA": 6, "VTG": 2, "GST": 4, "ZDA": 2}
