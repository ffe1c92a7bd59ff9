"""Times as programs write them into text: ISO 8601, numbers since an epoch, and forms with months by name.

Where all times of a column are of the form of nearly all logs, ``2018-05-04T15:34:20.25Z``, they are read at once.
"""

from __future__ import annotations

import re
from calendar import timegm
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pyarrow as pa

from fusion.types import Bools, Floats


def unix_seconds(texts: Sequence[str | None]) -> Floats:
    """Unix seconds (n,) of RFC 3339 / ISO 8601 times; without offset taken as UTC; NaN where unreadable."""
    try:
        parsed = pa.array(texts, pa.string()).cast(pa.timestamp("ns", "UTC"))
        micros = parsed.to_numpy(zero_copy_only=False).astype("datetime64[us]")
    except pa.ArrowInvalid:  # one of them at least has no offset, or is no time
        import pandas as pd  # noqa: PLC0415 - it takes longer to load than most logs to read

        series = pd.Series(list(texts), dtype="object")
        times = pd.to_datetime(series, utc=True, format="ISO8601", errors="coerce")
        micros = times.dt.tz_localize(None).to_numpy().astype("datetime64[us]")
    return np.where(np.isnat(micros), np.nan, micros.astype(np.int64) / 1e6)


_MONTHS = {
    name: number
    for number, names in enumerate(
        ("jan janv", "feb fev févr fév", "mar mär mrz mars", "apr avr", "may mai", "jun juin", "jul juil",
         "aug août aou", "sep sept", "oct okt", "nov", "dec dez déc"), 1)
    for name in names.split()
}  # fmt: skip
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<part>\d{1,9}))?"
_ZONE = r"(?:\s*(?P<zone>Z|[A-Z]{2,5})?\s*(?P<offset>[+-]\d{1,2}:?\d{2})?)"
_NAME, _MONTH = r"(?P<month>[^\W\d]{3,9})", r"(?P<month>\d{1,2})"
_DAY, _YEAR = r"(?P<day>\d{1,2})", r"(?P<year>\d{4})"
_FORMS = (
    # Mon Mar 05 10:11:12 GMT+01:00 2018
    re.compile(rf"[^\W\d]{{2,9}}\.?,? {_NAME}\.? {_DAY},? {_CLOCK}{_ZONE} {_YEAR}"),
    # 05-Mar-2018 10:11:12.123
    re.compile(rf"{_DAY}[-. /]{_NAME}\.?[-. /]{_YEAR},?[ T]{_CLOCK}{_ZONE}"),
    # 2018/03/05 10:11:12
    re.compile(rf"{_YEAR}[/.-]{_MONTH}[/.-]{_DAY}[ T]+{_CLOCK}{_ZONE}"),
    # 05.03.2018 10:11:12
    re.compile(rf"{_DAY}\.{_MONTH}\.{_YEAR},?[ T]+{_CLOCK}{_ZONE}"),
)
"""Forms whose order of day and month is certain."""
_ZONES_H = {
    "Z": 0, "UTC": 0, "GMT": 0, "WET": 0, "CET": 1, "MEZ": 1, "CEST": 2, "MESZ": 2, "EET": 2, "EEST": 3, "MSK": 3,
    "EST": -5, "EDT": -4, "CDT": -5, "MST": -7, "MDT": -6, "PST": -8, "PDT": -7, "JST": 9,
}  # fmt: skip
"""Abbreviations that mean one thing."""
_ISO_ZONE = re.compile(r"(?:[zZ]|[+-]\d\d:?\d\d|[+-]\d\d)\s*\"?\s*$")
_EPOCH_STEPS = ((1e11, 1.0), (1e14, 1e-3), (1e17, 1e-6), (np.inf, 1e-9))
"""Numbers below the first are seconds, and so on: 1980 to 2100 in one unit is out of reach in the others."""


def times_of(texts: Sequence[str | None], seconds: float | None = None) -> tuple[Floats, Bools]:
    """Unix seconds (n,) of texts, NaN where unreadable, and which of them name no offset from UTC and are taken as UTC.

    Numbers are since 1970, in units of ``seconds``, or of what their size tells.
    """
    texts = [text.strip().strip('"').strip() if text else None for text in texts]
    first = next((text for text in texts if text), "")
    if _number(first) is not None:
        value = np.array([_number(text) if text else None for text in texts], float)
        return of_epoch(value, seconds), np.zeros(len(texts), bool)
    out = unix_seconds(texts)
    bare = np.zeros(len(texts), bool)
    for row in np.flatnonzero(np.isfinite(out)):
        end = (texts[row] or "")[-8:]
        bare[row] = end[-1:] not in "zZ" and not _ISO_ZONE.search(end)
    for row in np.flatnonzero(np.isnan(out)):
        if text := texts[row]:
            out[row], bare[row] = _worded(text)
    return out, bare


def of_epoch(value: Floats, seconds: float | None = None) -> Floats:
    """Unix seconds of numbers since 1970, in units of ``seconds``, or in what their size tells."""
    if seconds is not None:
        return value * seconds
    finite = value[np.isfinite(value)]
    size = float(np.median(np.abs(finite))) if len(finite) else 0.0
    return value * next(unit for limit, unit in _EPOCH_STEPS if size < limit)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _worded(text: str) -> tuple[float, bool]:
    """Unix seconds of a time in one of the forms, and whether it names no zone."""
    match = next((match for form in _FORMS if (match := form.fullmatch(text[:60]))), None)
    if match is None:
        return np.nan, False
    hour, minute, second = map(int, match.group("hour", "minute", "second"))
    if hour > 23 or minute > 59 or second > 60:
        return np.nan, False
    day_s = _day_s(*match.group("year", "month", "day"))
    part, zone, offset = match.group("part", "zone", "offset")
    offset_s, zoned = _offset_s(zone, offset)
    share = float(f"0.{part}") if part else 0.0
    return day_s + hour * 3600 + minute * 60 + second + share - offset_s, not zoned


@lru_cache(maxsize=512)
def _day_s(year: str, month: str, day: str) -> float:
    name = month.lower()
    number = int(month) if month.isdecimal() else _MONTHS.get(name[:4], _MONTHS.get(name[:3], 0))
    if not (1 <= number <= 12 and 1 <= int(day) <= 31 and 1970 <= int(year) <= 2100):
        return np.nan
    return float(timegm((int(year), number, int(day), 0, 0, 0)))


@lru_cache(maxsize=512)
def _offset_s(zone: str | None, offset: str | None) -> tuple[float, bool]:
    if offset:
        sign, digits = (-1 if offset[0] == "-" else 1), offset[1:].replace(":", "").zfill(4)
        return sign * (int(digits[:2]) * 3600 + int(digits[2:]) * 60), True
    return (_ZONES_H[zone] * 3600.0, True) if zone in _ZONES_H else (0.0, False)
