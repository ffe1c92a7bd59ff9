"""Times as programs write them into text: ISO 8601, numbers since an epoch, and forms with months by name."""

from __future__ import annotations

import re
from calendar import timegm
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from fusion.formats.base import unix_seconds
from fusion.types import Bools, Floats

_MONTHS = {
    name: number
    for number, names in enumerate(
        ("jan janv", "feb fev févr fév", "mar mär mrz mars", "apr avr", "may mai", "jun juin", "jul juil",
         "aug août aou", "sep sept", "oct okt", "nov", "dec dez déc"), 1)
    for name in names.split()
}  # fmt: skip
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<part>\d{1,9}))?"
_ZONE = r"(?:\s*(?P<zone>Z|[A-Z]{2,5})?\s*(?P<offset>[+-]\d{1,2}:?\d{2})?)"
_NAME, _DAY, _YEAR = r"(?P<name>[^\W\d]{3,9})", r"(?P<day>\d{1,2})", r"(?P<year>\d{4})"
_FORMS = (
    # Mon Mar 05 10:11:12 GMT+01:00 2018
    re.compile(rf"[^\W\d]{{2,9}}\.?,? {_NAME}\.? {_DAY},? {_CLOCK}{_ZONE} {_YEAR}"),
    # 05-Mar-2018 10:11:12.123
    re.compile(rf"{_DAY}[-. /]{_NAME}\.?[-. /]{_YEAR},?[ T]{_CLOCK}{_ZONE}"),
    # 2018/03/05 10:11:12
    re.compile(rf"{_YEAR}[/.-](?P<month>\d{{1,2}})[/.-]{_DAY}[ T]+{_CLOCK}{_ZONE}"),
    # 05.03.2018 10:11:12
    re.compile(rf"{_DAY}\.(?P<month>\d{{1,2}})\.{_YEAR},?[ T]+{_CLOCK}{_ZONE}"),
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
    bare = np.array([bool(t) and not _ISO_ZONE.search(t or "") for t in texts], bool) & np.isfinite(out)
    for k in np.flatnonzero(np.isnan(out)):
        text = texts[k]
        if text:
            out[k], bare[k] = _worded(text)
    return out, bare


def of_epoch(value: Floats, seconds: float | None = None) -> Floats:
    """Unix seconds of numbers since 1970, in units of ``seconds``, or in what their size tells."""
    if seconds is not None:
        return value * seconds
    known = value[np.isfinite(value)]
    size = float(np.median(np.abs(known))) if len(known) else 0.0
    return value * next(unit for limit, unit in _EPOCH_STEPS if size < limit)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _worded(text: str) -> tuple[float, bool]:
    """Unix seconds of a time in one of the forms, and whether it names no zone."""
    found = next((match for form in _FORMS if (match := form.fullmatch(text[:60]))), None)
    if found is None:
        return float("nan"), False
    part = found.groupdict()
    name = (part.get("name") or "").lower()
    month = int(part["month"]) if part.get("month") else _MONTHS.get(name[:4], _MONTHS.get(name[:3], 0))
    hour, minute, second = int(part["hour"]), int(part["minute"]), int(part["second"])
    if hour > 23 or minute > 59 or second > 60:
        return float("nan"), False
    offset_s, zoned = _offset_s(part["zone"], part["offset"])
    day_s = _day_s(int(part["year"]), month, int(part["day"]))
    share = float(f"0.{part['part']}") if part["part"] else 0.0
    return day_s + hour * 3600 + minute * 60 + second + share - offset_s, not zoned


@lru_cache(maxsize=512)
def _day_s(year: int, month: int, day: int) -> float:
    if not (1 <= month <= 12 and 1 <= day <= 31 and 1970 <= year <= 2100):
        return float("nan")
    return float(timegm((year, month, day, 0, 0, 0)))


@lru_cache(maxsize=512)
def _offset_s(zone: str | None, offset: str | None) -> tuple[float, bool]:
    if offset:
        sign, digits = (-1 if offset[0] == "-" else 1), offset[1:].replace(":", "").zfill(4)
        return sign * (int(digits[:2]) * 3600 + int(digits[2:]) * 60), True
    return (_ZONES_H[zone] * 3600.0, True) if zone in _ZONES_H else (0.0, False)
