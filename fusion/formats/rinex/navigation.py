"""Navigation files of versions 2, 3 and 4: broadcast ephemerides of GPS, GLONASS, Galileo, BeiDou and QZSS.

Fields as in RINEX 3.05, tables A5 to A14, and 2.11, tables A3 to A10; those of version 4 lie alike. A record has a line
with satellite, time and three numbers, and up to seven lines of four numbers. In version 2 and 3 a record begins where
a line is not indented; in version 4 after a line such as ``> EPH G01 LNAV``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.arrays import ColumnTable
from fusion.formats.base import Notes
from fusion.formats.rinex.header import Header
from fusion.formats.rinex.lines import Lines, numbers, seconds_of
from fusion.messages import say
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    GALILEO,
    GLONASS,
    GPS,
    GPS_EPOCH_S,
    QZSS,
    SBAS,
    SYSTEMS,
    WEEK_S,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    gps_from_unix,
)
from fusion.types import Bools, Floats, Ints

MOST_RECORD_LINES = 8
_WIDTH = 19
_DATE_2 = ((3, 2), (6, 2), (9, 2), (12, 2), (15, 2), (17, 5))
_DATE_2_LETTER = tuple((at + 1, width) for at, width in _DATE_2)
_DATE_3 = ((4, 4), (8, 3), (11, 3), (14, 3), (17, 3), (20, 3))
_READ_4 = {"G LNAV", "J LNAV", "R FDMA", "E INAV", "E FNAV", "C D1", "C D2"}
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

    def place(self, row: int) -> str:
        """Where a record stands, in words."""
        return say("place.line", n=self.line[row] + 1)


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

    def tell(row: int) -> str:
        return say("place.line_text", n=head[row] + 1, text=lines.line(int(head[row]))[:23])

    good = notes.sift((("navigation records without satellite or time", ~good),), tell)
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
    readable = np.array([len(k) > 3 and f"{k[2][:1]} {k[3]}" in _READ_4 for k in kinds], bool)
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
        system = "".join(words[2:3])[:1]
        if words[1:2] + words[3:4] != ["ION", "LNAV"] or system in coefficients:
            continue
        value = _values(lines, np.array([i + 1]), np.array([min(3, len(lines) - i - 1)]), np.array([4]))
        eight = value[0].ravel()[1:9]
        if np.isfinite(eight).all() and eight.any():
            coefficients[system] = tuple(eight.tolist())
    return coefficients.get("G") or coefficients.get("J")


_KEPLER_LINES, _GLONASS_LINES = 7, 4
_PLACES = {
    "af0_s": (0, 1), "af1": (0, 2), "af2_per_s": (0, 3),
    "crs_m": (1, 1), "delta_n_radps": (1, 2), "m0_rad": (1, 3),
    "cuc_rad": (2, 0), "eccentricity": (2, 1), "cus_rad": (2, 2), "root_a": (2, 3),
    "cic_rad": (3, 1), "omega0_rad": (3, 2), "cis_rad": (3, 3),
    "i0_rad": (4, 0), "crc_m": (4, 1), "omega_rad": (4, 2), "omega_dot_radps": (4, 3),
    "i_dot_radps": (5, 0),
}  # fmt: skip
_ISSUE, _TOE, _SOURCES, _ACCURACY, _HEALTH, _SENT = (1, 0), (3, 0), (5, 1), (6, 0), (6, 1), (7, 0)
_GROUP_DELAY, _GROUP_DELAY_E5B = (6, 2), (6, 3)

_FNAV_CLOCK, _INAV_CLOCK, _FNAV_SOURCE = 1 << 8, 1 << 9, 1 << 1
"""Data sources of Galileo: whether clock and accuracy are for the pair E1/E5a or E1/E5b; message from E5a."""
_E1_BAD, _E5A_BAD = 0b111, 0b111 << 3
"""Bits of Galileo's health: data validity and status of E1-B, and of E5a."""
_LEX_HEALTH = 1
"""QZSS's lowest health bit is that of LEX, which has nothing to do with L1."""
_NO_TIME_S = 9e8
_LARGEST_FIELD = 1e9
_PLAUSIBLE_ROOT_A = (4500.0, 7500.0)
_LARGEST_ECCENTRICITY = 0.5
_LARGEST_CLOCK_S = 1.0
_GLONASS_RADIUS_M = (2.3e7, 2.8e7)
_FASTEST_MPS = 1e4
_CHANNELS = (-7, 13)


def read_navigation(lines: Lines, header: Header, notes: Notes) -> Navigation:
    """All ephemerides after the header; records that are not whole or cannot be are counted in ``notes``."""
    records = find_records(lines, header, notes)
    other = (records.system < 0) | (records.system == SBAS)
    notes.skip("navigation records of systems that are not read", int(other.sum()))
    is_glonass = records.system == GLONASS
    ionosphere = header.klobuchar
    if header.version >= 4:
        ionosphere = ionosphere_4(lines, header) or ionosphere
    return Navigation(
        _kepler(_complete(records.take(~other & ~is_glonass), _KEPLER_LINES, notes), notes),
        _glonass(_complete(records.take(is_glonass), _GLONASS_LINES, notes), notes),
        ionosphere,
    )


def _complete(records: Records, least: int, notes: Notes) -> Records:
    """Those that have all their lines."""
    short = records.count < least
    return records.take(notes.sift((("navigation records with lines missing", short),), records.place))


def _possible(records: Records, fine: Bools, notes: Notes) -> Bools:
    return notes.sift((("navigation records with numbers that cannot be", ~fine),), records.place)


def _kepler(records: Records, notes: Notes) -> KeplerEphemerides:
    column = {name: records.value[:, line, place] for name, (line, place) in _PLACES.items()}
    toe, toc = records.value[:, *_TOE], records.time_s
    fine = np.all([np.isfinite(c) for c in column.values()], axis=0) & (toe >= 0) & (toe <= WEEK_S)
    low, high = _PLAUSIBLE_ROOT_A
    fine &= (column["root_a"] > low) & (column["root_a"] < high)
    fine &= (column["eccentricity"] >= 0) & (column["eccentricity"] < _LARGEST_ECCENTRICITY)
    fine &= np.abs(column["af0_s"]) < _LARGEST_CLOCK_S
    fine = _possible(records, fine, notes)
    records, column = records.take(fine), {name: c[fine] for name, c in column.items()}
    toe, toc = toe[fine], toc[fine]
    late = np.where(records.system == BEIDOU, BEIDOU_LATE_S, 0.0)
    sent = records.value[:, *_SENT]
    sent = np.where(np.abs(sent) < _NO_TIME_S, sent, np.nan)
    delay, is_fnav = _group_delay(records, notes)
    accuracy = records.value[:, *_ACCURACY]
    out = KeplerEphemerides(
        system=records.system,
        number=records.number,
        toe_s=_near(toe, toc) + late,
        toc_s=toc + late,
        sent_s=_near(sent, toc) + late,
        healthy=_healthy(records, is_fnav),
        accuracy_m=np.where(accuracy > 0, accuracy, np.nan),
        issue=_whole_numbers(records.value[:, *_ISSUE], -1),
        group_delay_s=delay,
        **column,
    )
    return out.take(~_doubled(out, is_fnav))


def _near(of_week_s: Floats, near_s: Floats) -> Floats:
    """The time of a second of the week in the week that brings it nearest to another time.

    So that neither a week's end between the two nor a week counted modulo 1024 does harm.
    """
    return of_week_s + WEEK_S * np.round((near_s - of_week_s) / WEEK_S)


def _whole_numbers(value: Floats, missing: int) -> Ints:
    """Values as whole numbers; ``missing`` for blanks, and for what is too large to be one of the fields read so."""
    return np.where(np.abs(value) < _LARGEST_FIELD, value, missing).astype(np.int64)


def _group_delay(records: Records, notes: Notes) -> tuple[Floats, Bools]:
    """What belongs to the L1 band, and which records are Galileo's F/NAV: their clock is that of the pair E1/E5a."""
    sources = _whole_numbers(records.value[:, *_SOURCES], 0)
    stated = (sources & (_FNAV_CLOCK | _INAV_CLOCK)) != 0
    is_fnav = np.where(stated, (sources & _INAV_CLOCK) == 0, (sources & _FNAV_SOURCE) != 0)
    is_fnav &= records.system == GALILEO
    by_e5b = (records.system == GALILEO) & ~is_fnav
    delay = np.where(by_e5b, records.value[:, *_GROUP_DELAY_E5B], records.value[:, *_GROUP_DELAY])
    blank = np.isnan(delay)
    if blank.any():
        notes.repaired["group delays left blank, taken as 0"] += int(blank.sum())
    return np.where(blank, 0.0, delay), is_fnav


def _healthy(records: Records, is_fnav: Bools) -> Bools:
    health = _whole_numbers(records.value[:, *_HEALTH], -1)
    relevant = np.full(len(health), -1, np.int64)
    relevant[records.system == GALILEO] = _E1_BAD
    relevant[is_fnav] = _E1_BAD | _E5A_BAD
    relevant[records.system == QZSS] = ~_LEX_HEALTH
    usable: Bools = (health & relevant) == 0
    return usable


def _doubled(kepler: KeplerEphemerides, is_fnav: Bools) -> Bools:
    """Records of Galileo's F/NAV beside which there is one of I/NAV for the same satellite and time."""
    better = (kepler.system == GALILEO) & ~is_fnav
    better_ones = set(zip(kepler.number[better].tolist(), kepler.toe_s[better].tolist(), strict=True))
    rows = zip(is_fnav.tolist(), kepler.number.tolist(), kepler.toe_s.tolist(), strict=True)
    return np.array([fnav and (number, toe) in better_ones for fnav, number, toe in rows], bool)


def _glonass(records: Records, notes: Notes) -> GlonassEphemerides:
    states = records.value[:, 1:4, :3] * 1000.0  # km, km/s and km/s2, by axis
    clock, rate = records.value[:, 0, 1], records.value[:, 0, 2]
    health, channel = records.value[:, 1, 3], records.value[:, 2, 3]
    channel = np.where(channel > 128, channel - 256, channel)  # written as an unsigned byte
    with np.errstate(invalid="ignore", over="ignore"):
        fine = np.isfinite(clock) & np.isfinite(rate) & (np.abs(clock) < _LARGEST_CLOCK_S)
        radius, speed = np.linalg.norm(states[:, :, 0], axis=1), np.linalg.norm(states[:, :, 1], axis=1)
        fine &= (radius > _GLONASS_RADIUS_M[0]) & (radius < _GLONASS_RADIUS_M[1]) & (speed < _FASTEST_MPS)
        fine &= np.isfinite(states).all(axis=(1, 2)) & (channel >= _CHANNELS[0]) & (channel <= _CHANNELS[1])
    fine = _possible(records, fine, notes)
    return GlonassEphemerides(
        number=records.number[fine],
        channel=channel[fine].astype(np.int64),
        toe_s=gps_from_unix(records.time_s[fine] + GPS_EPOCH_S),
        healthy=health[fine] == 0,
        clock_s=clock[fine],
        clock_rate=rate[fine],
        position_m=states[fine, :, 0],
        velocity_mps=states[fine, :, 1],
        acceleration_mps2=states[fine, :, 2],
    )
