"""NMEA 0183 sentences: finding and checking them, numbers of RMC, GGA, VTG, GST and ZDA, and epochs made of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date
from math import isfinite, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import (
    DAY_S,
    Notes,
    Place,
    ground_velocity,
    number_or_nan,
    positive,
    usable_positions,
)
from fusion.formats.receiver.time_tags import Marks
from fusion.messages import say
from fusion.signals import GPS_EPOCH_S
from fusion.types import Floats, GnssFix, GnssVelocity, Ints, SensorTable

SENTENCE = re.compile(rb"\$([A-Z][A-Z0-9]{3,9},[^\r\n$*]{0,400})(?:\*([0-9A-Fa-f]{2}))?")
CHECKED = re.compile(rb"\$([A-Z]{2}(?:RMC|GGA|VTG|GST|ZDA|GLL|GSA|GSV),[^\r\n$*]{0,400})\*([0-9A-Fa-f]{2})")
BEGINS = re.compile(rb"\s*\$[A-Z]{2}[A-Z]{3},")
KNOT_MPS = 1852 / 3600
KMH_MPS = 1 / 3.6
UNIX_ORDINAL = date(1970, 1, 1).toordinal()
WRONG_CHECKSUM = "NMEA sentences with a wrong checksum"


def looks_like_nmea(head: bytes) -> bool:
    """A sentence with the right checksum somewhere, or the beginning of one at the very start."""
    if BEGINS.match(head):
        return True
    return any(_xor(m.group(1)) == int(m.group(2), 16) for m in CHECKED.finditer(head))


def _xor(body: bytes) -> int:
    return int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)))


def checked_sentences(text: bytes, notes: Notes, place: Place) -> list[tuple[bytes, int]]:
    """Bodies and offsets of the sentences whose checksum is right.

    If no sentence at all has a checksum they are taken as they are; otherwise one without is a torn one.
    """
    matches = [(m.start(1), m.end(1), m.group(2)) for m in SENTENCE.finditer(text)]
    summed = [(a, b, int(c, 16)) for a, b, c in matches if c]
    if not summed:
        if matches:
            notes.warn(say("nmea.no_checksums"))
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


def _time_of_day(cell: bytes) -> float:
    """hhmmss(.sss) in seconds."""
    if not cell[:6].isdigit() or len(cell) < 6:
        return np.nan
    hours, minutes, seconds = int(cell[:2]), int(cell[2:4]), number_or_nan(cell[4:])
    return hours * 3600 + minutes * 60 + seconds if hours < 24 and minutes < 60 and seconds < 61 else np.nan


def _angle(cell: bytes, side: bytes, negative: bytes) -> float:
    """(d)ddmm.mmmm and its hemisphere in degrees."""
    value = number_or_nan(cell)
    if not value >= 0:
        return np.nan
    degrees = value // 100
    minutes = value - 100 * degrees
    out = degrees + minutes / 60 if minutes <= 60 else np.nan  # 59.99999 may be rounded up to 60
    return -out if side == negative else out


def _day(day: float, month: float, year: float) -> float:
    """Days since 1970-01-01."""
    try:
        return date(int(year), int(month), int(day)).toordinal() - UNIX_ORDINAL
    except (ValueError, OverflowError):
        return np.nan


def _rmc(c: list[bytes]) -> tuple[float, ...]:
    active = c[1] == b"A"
    valid = active and c[11] not in _UNFIXED_MODES
    digits, day = c[8], np.nan
    if len(digits) == 6 and digits.isdigit():
        year = int(digits[4:])
        day = _day(int(digits[:2]), int(digits[2:4]), year + (2000 if year < 80 else 1900))
    lat, lon = _angle(c[2], c[3], b"S"), _angle(c[4], c[5], b"W")
    speed, course = number_or_nan(c[6]) * KNOT_MPS, radians(number_or_nan(c[7]))
    return _time_of_day(c[0]), day, float(active), float(valid), lat, lon, speed, course


def _gga(c: list[bytes]) -> tuple[float, ...]:
    lat, lon = _angle(c[1], c[2], b"S"), _angle(c[3], c[4], b"W")
    return _time_of_day(c[0]), number_or_nan(c[5]), lat, lon, number_or_nan(c[8]), number_or_nan(c[10])


def _vtg(c: list[bytes]) -> tuple[float, ...]:
    knots, kmh = number_or_nan(c[4]), number_or_nan(c[6])
    speed = kmh * KMH_MPS if isfinite(kmh) else knots * KNOT_MPS
    return radians(number_or_nan(c[0])), speed if c[8] not in _UNFIXED_MODES else np.nan


def _gst(c: list[bytes]) -> tuple[float, ...]:
    return _time_of_day(c[0]), *map(number_or_nan, c[5:8])


def _zda(c: list[bytes]) -> tuple[float, ...]:
    day, month, year = map(number_or_nan, c[1:4])
    dated = isfinite(day + month + year)
    return _time_of_day(c[0]), _day(day, month, year) if dated else np.nan


_UNFIXED_MODES = (b"N", b"E", b"M")
"""Not valid, estimated (by dead reckoning), typed in by hand."""
_ABSENT = [b""] * 12
"""What follows the cells of a sentence, so that one that ends early has empty ones."""
PARSERS: dict[str, tuple[Callable[[list[bytes]], tuple[float, ...]], tuple[str, ...]]] = {
    "RMC": (_rmc, ("clock_s", "day", "active", "valid", "lat_deg", "lon_deg", "speed_mps", "course_rad")),
    "GGA": (_gga, ("clock_s", "quality", "lat_deg", "lon_deg", "alt_msl_m", "separation_m")),
    "VTG": (_vtg, ("course_rad", "speed_mps")),
    "GST": (_gst, ("clock_s", "north_m", "east_m", "up_m")),
    "ZDA": (_zda, ("clock_s", "day")),
}
"""By type of sentence: what makes numbers of its cells, and what these are."""
_TIMED = ("RMC", "GGA", "GST", "ZDA")
Sentences = dict[str, dict[str, NDArray[Any]]]
"""By type: the numbers (n,) by name, ``offset``, where they begin, and ``time_s`` of those that have a time."""


GEOID = "the receiver's own (NMEA GGA)"
PROGRESS_EVERY = 1 << 15


@dataclass(frozen=True)
class NmeaContent:
    """What the sentences say: tables, and time marks for sensors in the same stream."""

    tables: dict[str, SensorTable] = field(default_factory=dict)
    marks: Marks = field(default_factory=Marks)
    sentences: int = 0
    dated: bool = False


def read_sentences(text: bytes, notes: Notes, place: Place, tick: Callable[[float], None]) -> NmeaContent:
    """Parse all sentences of a byte stream; ``place`` words a byte offset, ``tick`` hears the share done."""
    rows = {name: list[tuple[float, ...]]() for name in PARSERS}
    count = 0
    for body, offset in checked_sentences(text, notes, place):
        count += 1
        if count % PROGRESS_EVERY == 0:
            tick(offset / len(text))
        name = body[2:5].decode("latin-1")
        if body[:1] != b"P" and name in rows and body[5:6] == b",":
            rows[name].append((offset, *PARSERS[name][0](body[6:].split(b",") + _ABSENT)))
    return _assemble(rows, count, notes, place)


def _assemble(
    rows: dict[str, list[tuple[float, ...]]], count: int, notes: Notes, place: Place
) -> NmeaContent:
    sentences: Sentences = {}
    for kind, (_, names) in PARSERS.items():
        offset, *columns = np.array(rows[kind], float).reshape(-1, 1 + len(names)).T
        sentences[kind] = {"offset": offset.astype(np.int64), **dict(zip(names, columns, strict=True))}
    _date(sentences, notes)
    marks = Marks(
        *(np.concatenate([sentences[kind][name] for kind in _TIMED]) for name in ("offset", "time_s"))
    )
    marks = marks.of_epochs()
    tables: dict[str, SensorTable] = {
        "fix": _fix(sentences, notes, place),
        "velocity": _velocity(sentences, marks),
    }
    dated = any(bool(np.isfinite(sentences[kind]["day"]).any()) for kind in ("RMC", "ZDA"))
    return NmeaContent({n: t for n, t in tables.items() if len(t)}, marks, count, dated)


def _date(sentences: Sentences, notes: Notes) -> None:
    """Give every timed sentence its Unix time.

    Only RMC and ZDA carry a date. Any other sentence takes the day that puts it nearest in time to the dated
    sentence before or after it, whichever is closer by the clock: that carries it across midnight, and
    before the first date.
    """
    timed = [sentences[kind] for kind in _TIMED]
    offset = np.concatenate([one["offset"] for one in timed])
    clock = np.concatenate([one["clock_s"] for one in timed])
    trusted = sentences["RMC"]["active"] > 0
    days = [one.get("day", np.full(len(one["offset"]), np.nan)) for one in timed]
    days[0] = np.where(trusted | ~trusted.any(), days[0], np.nan)  # of RMC
    order = np.argsort(offset, kind="stable")
    time_s = np.empty(len(offset))
    time_s[order] = _spread_dates(clock[order], np.concatenate(days)[order], notes)
    edges = np.cumsum([len(one["offset"]) for one in timed])[:-1]
    for one, own_s in zip(timed, np.split(time_s, edges), strict=True):
        one["time_s"] = own_s


def _spread_dates(clock: Floats, day: Floats, notes: Notes) -> Floats:
    dated = np.flatnonzero(np.isfinite(day) & np.isfinite(clock))
    if not len(dated):
        if np.isfinite(clock).any():
            notes.undated()
        return GPS_EPOCH_S + _unwrapped(clock)
    index = np.arange(len(clock))
    after = np.searchsorted(dated, index)
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(dated) - 1)
    absolute = day[dated] * DAY_S + clock[dated]

    def apart(reference: Ints) -> Floats:
        d = np.abs(clock - clock[dated[reference]])
        return np.minimum(d, DAY_S - d)

    nearest = np.where(apart(after) <= apart(before), after, before)
    return clock + DAY_S * np.round((absolute[nearest] - clock) / DAY_S)


def _unwrapped(clock: Floats) -> Floats:
    """Times of day made continuous over midnight."""
    timed = np.flatnonzero(np.isfinite(clock))
    step = np.diff(clock[timed])
    turns = np.cumsum(np.where(step < -DAY_S / 2, 1, np.where(step > DAY_S / 2, -1, 0)))
    out = np.full(len(clock), np.nan)
    out[timed] = clock[timed] + DAY_S * np.append(0, turns)[: len(timed)]
    return out


def _fix(sentences: Sentences, notes: Notes, place: Place) -> GnssFix:
    gga, rmc, gst = (sentences[kind] for kind in ("GGA", "RMC", "GST"))
    gga_good = np.isin(gga["quality"], (1, 2, 3, 4, 5, 8, 9))
    void = {"GGA": gga["offset"][~gga_good], "RMC": rmc["offset"][rmc["valid"] < 1]}
    for kind, at in sorted(void.items(), key=lambda item: item[1][:1].tolist()):
        if len(at):
            example = say("nmea.no_fix", place=place(int(at[0])))
            notes.skip(f"{kind} sentences without a satellite fix", len(at), example, position=True)
    rmc_good = (rmc["valid"] > 0) & ~np.isin(rmc["time_s"], gga["time_s"][gga_good])
    gga["height_ell_m"] = gga["alt_msl_m"] + gga["separation_m"]
    unknown = np.full(len(rmc_good), np.nan)
    table = {
        name: np.concatenate([gga[name][gga_good], rmc.get(name, unknown)[rmc_good]])
        for name in ("offset", "time_s", "lat_deg", "lon_deg", "alt_msl_m", "height_ell_m")
    }
    order = np.argsort(table["offset"], kind="stable")
    table = {name: column[order] for name, column in table.items()}
    offset, time_s = table.pop("offset"), table.pop("time_s")
    good = usable_positions(
        time_s, table["lat_deg"], table["lon_deg"], notes, lambda i: place(int(offset[i]))
    )
    at_time = {t: i for i, t in enumerate(gst["time_s"].tolist())}
    row = np.array([at_time.get(t, -1) for t in time_s.tolist()], np.int64)
    for name, sigma in (("h_acc_m", np.hypot(gst["north_m"], gst["east_m"])), ("v_acc_m", gst["up_m"])):
        table[name] = positive(np.append(sigma, np.nan)[row])
    return GnssFix.assemble(time_s[good], notes.repaired, **{n: c[good] for n, c in table.items()})


def _velocity(sentences: Sentences, marks: Marks) -> GnssVelocity:
    """RMC's speed and course; VTG's, which has no time of its own, for epochs where RMC has none."""
    rmc, vtg = sentences["RMC"], sentences["VTG"]
    use = (rmc["valid"] > 0) & np.isfinite(rmc["speed_mps"])
    time_s, speed, course = (rmc[name][use] for name in ("time_s", "speed_mps", "course_rad"))
    if len(marks.time_s):
        burst = np.maximum(np.searchsorted(marks.offset, vtg["offset"]) - 1, 0)
        vtg_time = marks.time_s[burst]
        extra = ~np.isin(vtg_time, time_s)
        time_s = np.concatenate([time_s, vtg_time[extra]])
        speed = np.concatenate([speed, vtg["speed_mps"][extra]])
        course = np.concatenate([course, vtg["course_rad"][extra]])
    north, east = ground_velocity(speed, course)
    return GnssVelocity.assemble(time_s, vel_n_mps=north, vel_e_mps=east)
