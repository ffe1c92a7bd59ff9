"""When a RINEX file begins and ends, by its header and the times in its lines: no compiled code is loaded for that."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np

from fusion.formats.glance import Ends, Glance

_NUMBERS = rb"(\d{2,4}) +(\d\d?) +(\d\d?) +(\d\d?) +(\d\d?) +(\d\d?)"
_BEHIND = rb"(?:\.|[ \-]|$)"
_EPOCH = re.compile(rb"^(?:> ?| |&)" + _NUMBERS + _BEHIND, re.MULTILINE)
"""Of observations: version 3 and 4, version 2, compact."""
_OF_SATELLITE = re.compile(rb"^(?:[A-Z]\d\d|[ \d]\d) " + _NUMBERS + _BEHIND, re.MULTILINE)
_STATED = re.compile(rb"^ *" + _NUMBERS + rb"\.\d+[^\n]{0,20}?TIME OF (?:FIRST|LAST) OBS", re.MULTILINE)


def glance_of(ends: Ends, *, observations: bool) -> Glance:
    """Of a file of observations, or of navigation data. Seconds of the file's own scale: leap seconds do not matter."""
    start, end = ends.start, ends.end
    times = [
        seconds
        for text in (start, end)
        for seconds in _times(_EPOCH if observations else _OF_SATELLITE, text)
    ]
    if observations:
        times += _times(_STATED, start)
    known = np.array(times) if times else np.full(1, np.nan)
    return Glance(
        "rinex",
        float(known.min()),
        float(known.max()),
        has_signals=observations,
        has_navigation=not observations,
    )


def _times(pattern: re.Pattern[bytes], text: bytes) -> list[float]:
    out = []
    for match in pattern.finditer(text):
        year, month, day, hour, minute, second = map(int, match.groups())
        year += 0 if year > 99 else 2000 if year < 80 else 1900
        try:
            out.append(datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp())
        except ValueError:
            continue  # no time after all
    return out
