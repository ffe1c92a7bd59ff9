"""Times as programs write them into text: ISO 8601, numbers since an epoch, and forms with months by name.

Where all times of a column are of the form of nearly all logs, ``2018-05-04T15:34:20.25Z``, they are read at once.
"""

from __future__ import annotations

import re
from calendar import timegm
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from fusion.types import Bools, Floats, Ints


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
_FEWEST_ALIKE = 8
"""From so many times of one form on, they are read together."""
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
    unread = [int(k) for k in np.flatnonzero(np.isnan(out)) if texts[k]]
    by_length: dict[int, list[int]] = {}
    for k in unread:
        by_length.setdefault(len(texts[k] or ""), []).append(k)
    for rows in by_length.values():
        _read_alike([texts[k] or "" for k in rows], np.array(rows), out, bare)
    return out, bare


def _read_alike(texts: list[str], rows: Ints, out: Floats, bare: Bools) -> None:
    """Times of one length, into ``out`` and ``bare`` at ``rows``: together as far as they are like the first."""
    is_read = np.zeros(len(texts), bool)
    model = _match(texts[0]) if len(texts) >= _FEWEST_ALIKE else None
    if model is not None and all(text.isascii() for text in texts):
        seconds, zoned, is_read = _columns_of(np.array(texts, f"S{len(texts[0])}"), model)
        out[rows[is_read]], bare[rows[is_read]] = seconds[is_read], ~zoned[is_read]
    for k in np.flatnonzero(~is_read):
        out[rows[k]], bare[rows[k]] = _worded(texts[k])


def _columns_of(texts: NDArray[np.bytes_], match: re.Match[str]) -> tuple[Floats, Bools, Bools]:
    """Unix seconds, whether a zone is named, and which of the texts have digits, letters and signs where the first has.

    ``match`` is the first text's match; all have its length.
    """
    letters = texts.view(np.uint8).reshape(len(texts), -1)
    model = np.frombuffer(match.string.encode(), np.uint8)
    digit, word = _is_digit(letters), _is_letter(letters)
    alike = (letters == model) | (digit & _is_digit(model)) | (word & _is_letter(model))
    zone_at = [c for name in ("zone", "offset") for c in range(*match.span(name))]
    alike[:, zone_at] = True
    is_read = alike.all(axis=1)

    def number(name: str) -> Ints:
        begin, end = match.span(name)
        powers = 10 ** np.arange(end - begin - 1, -1, -1)
        return np.asarray((letters[:, begin:end].astype(np.int64) - ord("0")) @ powers)

    def each(begin: int, end: int, value: Callable[[str], float]) -> Floats:
        if end <= begin:
            return np.full(len(texts), value(""))
        cells = np.ascontiguousarray(letters[:, begin:end]).view(f"S{end - begin}").ravel()
        distinct, which = np.unique(cells, return_inverse=True)
        return np.array([value(one.decode("ascii", "replace")) for one in distinct], float)[which]

    by_name = "name" in match.groupdict()
    month = each(*match.span("name"), _month) if by_name else number("month").astype(float)
    days = np.stack([number("year"), month.astype(np.int64), number("day")], axis=1)
    code, which = np.unique(days @ np.array([10_000, 100, 1]), return_inverse=True)
    day_s = np.array([_day_s(int(c) // 10_000, int(c) // 100 % 100, int(c) % 100) for c in code])[which]
    hour, minute, second = number("hour"), number("minute"), number("second")
    begin, end = match.span("part")
    share = number("part") / 10.0 ** (end - begin) if end > begin else 0.0
    zone, zoned = match.span("zone"), np.zeros(len(texts))
    offset = match.span("offset")
    shift = each(*offset, lambda text: _offset_s(None, text or None)[0])
    if offset[1] <= offset[0]:
        shift = each(*zone, lambda text: _offset_s(text or None, None)[0])
        zoned = each(*zone, lambda text: float(_offset_s(text or None, None)[1]))
    else:
        signs = np.isin(letters[:, offset[0]], (ord("+"), ord("-")))
        inside = _is_digit(letters[:, offset[0] + 1 : offset[1]]) | (
            letters[:, offset[0] + 1 : offset[1]] == ord(":")
        )
        is_read &= (
            signs & inside.all(axis=1) & (letters[:, range(*zone)] == model[list(range(*zone))]).all(axis=1)
        )
        zoned = np.ones(len(texts))
    sane = (hour < 24) & (minute < 60) & (second < 61)
    seconds = day_s + hour * 3600 + minute * 60 + second + share - shift
    return np.where(sane, seconds, np.nan), zoned > 0, is_read


def _is_digit(letters: NDArray[np.uint8]) -> Bools:
    return np.asarray((letters >= ord("0")) & (letters <= ord("9")))


def _is_letter(letters: NDArray[np.uint8]) -> Bools:
    small = letters | 0x20
    return np.asarray((small >= ord("a")) & (small <= ord("z")))


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


def _match(text: str) -> re.Match[str] | None:
    return next((match for form in _FORMS if (match := form.fullmatch(text[:60]))), None)


def _month(name: str) -> int:
    return _MONTHS.get(name.lower()[:4], _MONTHS.get(name.lower()[:3], 0))


def _worded(text: str) -> tuple[float, bool]:
    """Unix seconds of a time in one of the forms, and whether it names no zone."""
    match = _match(text)
    if match is None:
        return float("nan"), False
    part = match.groupdict()
    month = int(part["month"]) if part.get("month") else _month(part.get("name") or "")
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
        if not (digits.isascii() and digits.isdecimal()):
            # texts that are read together need not all be sound
            return float("nan"), True
        return sign * (int(digits[:2]) * 3600 + int(digits[2:]) * 60), True
    return (_ZONES_H[zone] * 3600.0, True) if zone in _ZONES_H else (0.0, False)
