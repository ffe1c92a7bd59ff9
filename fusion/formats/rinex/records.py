"""Which lines of a navigation file make a record, of which satellite, and the numbers in it.

A record has a line with satellite, time and three numbers, and up to seven lines of four numbers. In version 2 and 3 a
record begins where a line is not indented; in version 4 after a line such as ``> EPH G01 LNAV``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.arrays import ColumnTable
from fusion.formats.base import Notes
from fusion.formats.rinex.header import Header
from fusion.formats.rinex.lines import Lines, numbers, seconds_of
from fusion.signals import GPS, SYSTEMS
from fusion.types import Floats, Ints

MOST_RECORD_LINES = 8
_WIDTH = 19
_DATE_2 = ((3, 2), (6, 2), (9, 2), (12, 2), (15, 2), (17, 5))
_DATE_2_LETTER = tuple((at + 1, width) for at, width in _DATE_2)
_DATE_3 = ((4, 4), (8, 3), (11, 3), (14, 3), (17, 3), (20, 3))
_READ_4 = {
    ("G", "LNAV"),
    ("J", "LNAV"),
    ("R", "FDMA"),
    ("E", "INAV"),
    ("E", "FNAV"),
    ("C", "D1"),
    ("C", "D2"),
}
"""Messages of version 4 with the layout of version 3; the CNAV ones are others'."""
MODERN_MESSAGE = "records of a kind that is not read (CNAV and the like)"


@dataclass(frozen=True)
class Records(ColumnTable):
    """Records as they stand in the file: ``system`` -1 where it is not read; ``time_s`` are seconds of the calendar.

    ``value`` (k, 8, 4) holds the numbers by line and place, NaN for blanks and missing lines; on the first line the
    places 1 to 3. ``line`` and ``count`` are the record's first line and how many it has.
    """

    system: Ints
    number: Ints
    time_s: Floats
    value: Floats
    line: Ints
    count: Ints


def find_records(lines: Lines, header: Header, notes: Notes) -> Records:
    """Find all records and read their numbers; what is no record, or of another kind, is counted."""
    body = np.arange(header.lines, len(lines))
    body = body[lines.end[body] > lines.start[body]]
    head, count = _heads_4(lines, body, notes) if header.version >= 4 else _heads(lines, body, header)
    count = np.minimum(count, MOST_RECORD_LINES)
    letter = lines.column(head, 0)
    lettered = (letter >= ord("A")) & (letter <= ord("Z"))
    where = np.array([SYSTEMS.find(chr(c)) for c in range(256)])
    system = np.where(lettered, where[letter], max(GPS, SYSTEMS.find(header.system)))
    number = np.where(lettered, lines.numbers(head, 1, 2), lines.numbers(head, 0, 2))
    modern = header.version >= 3
    time_s, good = seconds_of(lines, head, _DATE_3 if modern else _DATE_2)
    if not modern and lettered.any():  # mixed files of version 2 are in no standard, but they exist
        shifted, fine = seconds_of(lines, head, _DATE_2_LETTER)
        time_s, good = np.where(lettered, shifted, time_s), np.where(lettered, fine, good)
    good &= np.isfinite(number) & (number >= 1)
    bad = np.flatnonzero(~good)
    if len(bad):
        say = f"line {head[bad[0]] + 1}: {lines.line(int(head[bad[0]]))[:23]!r}"
        notes.skip("navigation records without satellite or time", len(bad), say)
    lead = (4 if modern else 3) + (lettered & (not modern))
    value = _values(lines, head, count, lead)
    number = np.where(good, number, 0).astype(np.int64)
    return Records(system, number, time_s, value, head, count).take(good)


def _heads(lines: Lines, body: Ints, header: Header) -> tuple[Ints, Ints]:
    """First lines of records, and how many lines each has."""
    opens = lines.column(body, 0) != ord(" ")
    if header.version < 3:
        opens |= lines.column(body, 1) != ord(" ")
    at = np.flatnonzero(opens)
    return body[at], np.diff(np.append(at, len(body)))


def _heads_4(lines: Lines, body: Ints, notes: Notes) -> tuple[Ints, Ints]:
    """As ``_heads``, of the ephemerides of version 4 that are read."""
    at = np.flatnonzero(lines.column(body, 0) == ord(">"))
    count = np.diff(np.append(at, len(body))) - 1
    kinds = [lines.line(int(i)).split() for i in body[at]]
    ephemeris = np.array([k[1:2] == ["EPH"] for k in kinds], bool)
    readable = np.array([len(k) > 3 and (k[2][:1], k[3]) in _READ_4 for k in kinds], bool)
    notes.skip(MODERN_MESSAGE, int((ephemeris & ~readable).sum()))
    keep = ephemeris & readable & (count > 0)
    return body[at[keep] + 1], count[keep]


def _values(lines: Lines, head: Ints, count: Ints, lead: Ints) -> Floats:
    """The numbers (k, 8, 4). One that does not end where its columns do was cut off: NaN, as it may miss digits."""
    row = head[:, None] + np.arange(MOST_RECORD_LINES)
    there = np.arange(MOST_RECORD_LINES) < count[:, None]
    row = np.where(there, row, 0)
    at = (lines.start[row] + lead[:, None])[:, :, None] + _WIDTH * np.arange(4)
    stop = at + _WIDTH
    complete = there[:, :, None] & (stop <= lines.end[row][:, :, None])
    value = numbers(lines.text, np.where(complete, at, 0).ravel(), np.where(complete, stop, 0).ravel())
    value = value.reshape(at.shape)
    value[:, 0, 0] = np.nan  # satellite and time
    return np.where(np.isfinite(value), value, np.nan)


def ionosphere_4(lines: Lines, header: Header) -> tuple[float, ...] | None:
    """Klobuchar's parameters of the first such message of GPS (else QZSS) in a file of version 4."""
    body = np.arange(header.lines, len(lines))
    at = body[(lines.column(body, 0) == ord(">")) & (lines.column(body, 2) == ord("I"))]
    coefficients: dict[str, tuple[float, ...]] = {}
    for i in at:
        words = lines.line(int(i)).split()
        if (
            words[1:2] == ["ION"]
            and words[3:4] == ["LNAV"]
            and words[2][0] in "GJ"
            and words[2][0] not in coefficients
        ):
            value = _values(lines, np.array([i + 1]), np.array([min(3, len(lines) - i - 1)]), np.array([4]))[
                0
            ]
            eight = (*value[0, 1:], *value[1], value[2, 0])
            if np.isfinite(eight).all() and any(eight):
                coefficients[words[2][0]] = tuple(float(v) for v in eight)
    return coefficients.get("G") or coefficients.get("J")
