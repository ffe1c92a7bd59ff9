"""The lines of a RINEX file and the numbers in their columns, read by compiled loops over the bytes.

Knows columns, not what stands in them. Column numbers count from 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.compiled import compiled
from fusion.errors import MalformedLogError
from fusion.messages import say
from fusion.types import Bools, Floats, Ints

MOST_LINES = 16_000_000
"""Two days at 1 Hz with a hundred satellites; the tables of more would not fit the memory of a small server."""

_BLANK, _PLUS, _MINUS, _POINT, _ZERO, _NINE = 32, 43, 45, 46, 48, 57
_EXACT_TENS = 10.0 ** np.arange(23)
"""Powers of ten that a double holds exactly."""
_MOST_DIGITS = 18
_EXPONENT_LETTERS = (68, 69, 100, 101)
"""D and E, d and e."""
_LARGEST_EXPONENT = 400

Text = NDArray[np.uint8]


@dataclass(frozen=True)
class Lines:
    """Line i is ``text[start[i]:end[i]]``, without its end."""

    text: Text
    start: Ints
    end: Ints

    def __len__(self) -> int:
        return len(self.start)

    def line(self, index: int) -> str:
        """As text; bytes that are no ASCII become question marks."""
        return self.text[self.start[index] : self.end[index]].tobytes().decode("ascii", "replace")

    def column(self, lines: Ints, column: int) -> NDArray[np.uint8]:
        """The byte in a column of each of the lines; a blank behind their ends."""
        at = self.start[lines] + column
        inside = at < self.end[lines]
        if not len(self.text):
            return np.full(len(lines), _BLANK, np.uint8)
        return np.where(inside, self.text[np.minimum(at, len(self.text) - 1)], _BLANK).astype(np.uint8)

    def numbers(self, lines: Ints, column: int, width: int) -> Floats:
        """The numbers in some columns of the lines (n,); NaN for blanks, infinite where there is no number."""
        at = self.start[lines] + column
        return numbers(self.text, at, np.minimum(at + width, self.end[lines]))


def split_lines(data: bytes) -> Lines:
    """Find the lines, ended by line feeds with or without carriage returns; raises ``MalformedLogError``."""
    if data.count(b"\n") > MOST_LINES:
        raise MalformedLogError(say("rinex.too_long", most=MOST_LINES))
    text = np.frombuffer(data, np.uint8)
    feeds = np.flatnonzero(text == 10).astype(np.int64)
    start = np.concatenate([np.zeros(1, np.int64), feeds + 1])
    end = np.append(feeds, len(text)).astype(np.int64)
    returned = end > start
    returned[returned] = text[end[returned] - 1] == 13
    end = end - returned
    if start[-1] == len(text):
        start, end = start[:-1], end[:-1]
    return Lines(text, start, end)


def seconds_of(lines: Lines, which: Ints, columns: tuple[tuple[int, int], ...]) -> tuple[Floats, Bools]:
    """Seconds (n,) since the GPS epoch of calendar times in the columns (start, width) of year to second.

    No leap seconds are looked at: the scale is that of the file. Two-digit years are those of 1980 to 2079. The mask
    says which are times at all, from 1980 to 2100; elsewhere the seconds are NaN.
    """
    year, month, day, hour, minute, second = (lines.numbers(which, at, width) for at, width in columns)
    year = np.where(year < 80, year + 2000, np.where(year < 100, year + 1900, year))
    good = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    good &= (hour >= 0) & (hour < 25) & (minute >= 0) & (minute < 60) & (second >= 0) & (second < 61)
    months = np.where(good, (year - 1970) * 12 + month - 1, 0).astype(np.int64)
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) + day - 1
    since = (days - 3657) * 86400.0 + hour * 3600 + minute * 60 + second  # 1980-01-06 is day 3657 of 1970
    return np.where(good, since, np.nan), good


@compiled
def number(text: Text, at: int, stop: int) -> float:
    """The number between two offsets, with an exponent after D or E or without; NaN if blank, infinite if none.

    Right to the last bit for up to 18 digits and powers of ten up to 22.
    """
    while at < stop and text[at] == _BLANK:
        at += 1
    while stop > at and text[stop - 1] == _BLANK:
        stop -= 1
    if at >= stop:
        return np.nan
    negative = text[at] == _MINUS
    if negative or text[at] == _PLUS:
        at += 1
    at, mantissa, power = _digits(text, at, stop)
    if mantissa < 0:
        return np.inf
    if at < stop:
        exponent = _exponent(text, at, stop)
        if exponent > _LARGEST_EXPONENT:
            return np.inf
        power += exponent
    value = _scaled(float(mantissa), power)
    return -value if negative else value


@compiled
def _digits(text: Text, at: int, stop: int) -> tuple[int, int, int]:
    """Read digits with a point among them: where they end, their whole number (-1 if there are none), power of ten."""
    digits, mantissa, power, pointed = 0, 0, 0, False
    while at < stop:
        c = text[at]
        if _ZERO <= c <= _NINE:
            digits += 1
            if digits <= _MOST_DIGITS:
                mantissa = mantissa * 10 + (c - _ZERO)
                power -= pointed
            else:
                power += not pointed
        elif c == _POINT and not pointed:
            pointed = True
        else:
            break
        at += 1
    return at, mantissa if digits else -1, power


@compiled
def _exponent(text: Text, at: int, stop: int) -> int:
    """The whole number behind a letter, with a sign or without; beyond ``_LARGEST_EXPONENT`` if there is none."""
    lettered = text[at] in _EXPONENT_LETTERS
    at += 1
    negative = at < stop and text[at] == _MINUS
    if negative or (at < stop and text[at] == _PLUS):
        at += 1
    value = 0 if lettered and at < stop else _LARGEST_EXPONENT + 1
    for i in range(at, stop):
        if not _ZERO <= text[i] <= _NINE or value > _LARGEST_EXPONENT:
            return _LARGEST_EXPONENT + 1
        value = value * 10 + (text[i] - _ZERO)
    return -value if negative and value <= _LARGEST_EXPONENT else value


@compiled
def _scaled(value: float, power: int) -> float:
    while power > 22:
        value *= 1e22
        power -= 22
    while power < -22:
        value /= 1e22
        power += 22
    tens = float(_EXACT_TENS[abs(power)])
    return value * tens if power >= 0 else value / tens


@compiled
def numbers(text: Text, at: Ints, stop: Ints) -> Floats:
    """``number`` between each pair of offsets, (n,)."""
    out = np.empty(len(at))
    for i in range(len(at)):
        out[i] = number(text, at[i], stop[i])
    return out
