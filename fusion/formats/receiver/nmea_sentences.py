"""NMEA 0183 sentences: finding and checking them, numbers of RMC, GGA, VTG, GST and ZDA, and epochs made of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date
from math import isfinite, radians

import numpy as np

from fusion.formats.base import DAY_S, GPS_EPOCH_S, Notes, Place, ground_velocity, usable_positions
from fusion.formats.receiver.time_tags import Marks
from fusion.types import Floats, GnssFix, GnssVelocity, Ints, SensorTable

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
    rows = {name: Rows() for name in WIDTH}
    count = 0
    for body, offset in checked_sentences(text, notes, place):
        count += 1
        if count % PROGRESS_EVERY == 0:
            tick(offset / len(text))
        name = body[2:5].decode("latin-1")
        if body[:1] != b"P" and name in rows and body[5:6] == b",":
            rows[name].offset.append(offset)
            rows[name].values.append(PARSERS[name](body[6:].split(b",")))
    return _assemble(rows, count, notes, place)


def _assemble(rows: dict[str, Rows], count: int, notes: Notes, place: Place) -> NmeaContent:
    columns = {name: rows[name].columns(width) for name, width in WIDTH.items()}
    offsets = {name: np.array(rows[name].offset, np.int64) for name in WIDTH}
    times = _dated(columns, offsets, notes)
    marks = _marks(times, offsets)
    fix = _fix(columns, offsets, times, notes, place)
    velocity = _velocity(columns, offsets, times, marks)
    tables: dict[str, SensorTable] = {"fix": fix, "velocity": velocity}
    dated = bool(np.isfinite(columns["RMC"][1]).any() or np.isfinite(columns["ZDA"][1]).any())
    return NmeaContent({n: t for n, t in tables.items() if len(t)}, marks, count, dated)


def _dated(columns: dict[str, list[Floats]], offsets: dict[str, Ints], notes: Notes) -> dict[str, Floats]:
    """Unix time of every timed sentence (RMC, GGA, GST, ZDA), by type.

    Only RMC and ZDA carry a date. Any other sentence takes the day that puts it nearest in time to the dated
    sentence before or after it, whichever is closer by the clock: that carries it across midnight, and
    before the first date.
    """
    timed = ("RMC", "GGA", "GST", "ZDA")
    size = {n: len(offsets[n]) for n in timed}
    offset = np.concatenate([offsets[n] for n in timed])
    clock = np.concatenate([columns[n][0] for n in timed])
    trusted = columns["RMC"][2] > 0
    day = np.concatenate(
        [
            np.where(trusted | ~trusted.any(), columns["RMC"][1], np.nan),
            np.full(size["GGA"] + size["GST"], np.nan),
            columns["ZDA"][1],
        ]
    )
    order = np.argsort(offset, kind="stable")
    out = np.empty(len(offset))
    out[order] = _spread_dates(clock[order], day[order], notes)
    edges = np.cumsum([size[n] for n in timed])[:-1]
    return dict(zip(timed, np.split(out, edges), strict=True))


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

    with np.errstate(invalid="ignore"):
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


def _marks(times: dict[str, Floats], offsets: dict[str, Ints]) -> Marks:
    """The first sentence of each epoch."""
    offset = np.concatenate([offsets[n] for n in times])
    time_s = np.concatenate(list(times.values()))
    timed = np.isfinite(time_s)
    offset, time_s = offset[timed], time_s[timed]
    order = np.argsort(offset, kind="stable")
    offset, time_s = offset[order], time_s[order]
    first = np.diff(time_s, prepend=-np.inf) != 0
    return Marks(offset[first], time_s[first])


def _fix(
    columns: dict[str, list[Floats]],
    offsets: dict[str, Ints],
    times: dict[str, Floats],
    notes: Notes,
    place: Place,
) -> GnssFix:
    _, quality, lat, lon, alt, separation = columns["GGA"]
    _, _, _, valid, rmc_lat, rmc_lon, _, _ = columns["RMC"]
    with np.errstate(invalid="ignore"):
        gga_good = np.isin(quality, (1, 2, 3, 4, 5, 8, 9))
    void = {"GGA": offsets["GGA"][~gga_good], "RMC": offsets["RMC"][valid < 1]}
    for kind, at in sorted(void.items(), key=lambda item: item[1][:1].tolist()):
        if len(at):
            example = f"{place(int(at[0]))}: the receiver had no fix"
            notes.skip(f"{kind} sentences without a satellite fix", len(at), example, position=True)
    rmc_good = (valid > 0) & ~np.isin(times["RMC"], times["GGA"][gga_good])
    unknown = np.full(int(rmc_good.sum()), np.nan)
    offset = np.concatenate([offsets["GGA"][gga_good], offsets["RMC"][rmc_good]])
    time_s = np.concatenate([times["GGA"][gga_good], times["RMC"][rmc_good]])
    table = {
        "lat_deg": np.concatenate([lat[gga_good], rmc_lat[rmc_good]]),
        "lon_deg": np.concatenate([lon[gga_good], rmc_lon[rmc_good]]),
        "alt_msl_m": np.concatenate([alt[gga_good], unknown]),
        "height_ell_m": np.concatenate([(alt + separation)[gga_good], unknown]),
    }
    order = np.argsort(offset, kind="stable")
    offset, time_s, table = offset[order], time_s[order], {n: c[order] for n, c in table.items()}
    good = usable_positions(
        time_s, table["lat_deg"], table["lon_deg"], notes, lambda i: place(int(offset[i]))
    )
    north, east, up = columns["GST"][1:]
    h_acc, v_acc = np.hypot(north, east), up
    at_time = {t: i for i, t in enumerate(times["GST"].tolist())}
    gst = np.array([at_time.get(t, -1) for t in time_s.tolist()], np.int64)
    for name, sigma in (("h_acc_m", h_acc), ("v_acc_m", v_acc)):
        table[name] = np.where((gst >= 0), np.append(sigma, np.nan)[gst], np.nan)
        table[name][~(table[name] > 0)] = np.nan
    return GnssFix.assemble(time_s[good], notes.repaired, **{n: c[good] for n, c in table.items()})


def _velocity(
    columns: dict[str, list[Floats]], offsets: dict[str, Ints], times: dict[str, Floats], marks: Marks
) -> GnssVelocity:
    """RMC's speed and course; VTG's, which has no time of its own, for epochs where RMC has none."""
    valid, speed, course = columns["RMC"][3], columns["RMC"][6], columns["RMC"][7]
    use = (valid > 0) & np.isfinite(speed)
    time_s, speed, course = times["RMC"][use], speed[use], course[use]
    if len(marks.time_s):
        burst = np.maximum(np.searchsorted(marks.offset, offsets["VTG"]) - 1, 0)
        vtg_time = marks.time_s[burst]
        extra = ~np.isin(vtg_time, time_s)
        time_s = np.concatenate([time_s, vtg_time[extra]])
        speed = np.concatenate([speed, columns["VTG"][1][extra]])
        course = np.concatenate([course, columns["VTG"][0][extra]])
    north, east = ground_velocity(speed, course)
    return GnssVelocity.assemble(time_s, vel_n_mps=north, vel_e_mps=east)
