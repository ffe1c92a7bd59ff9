"""From NMEA sentences to tables: dating them, and joining those of one epoch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusion.formats.base import DAY_S, GPS_EPOCH_S, Notes, Place, ground_velocity, usable_positions
from fusion.formats.receiver.nmea_sentences import PARSERS, WIDTH, Rows, checked_sentences
from fusion.formats.receiver.time_tags import Marks
from fusion.types import Floats, GnssFix, GnssVelocity, Ints, SensorTable

GEOID = "the receiver's own (NMEA GGA)"
PROGRESS_EVERY = 1 << 15


@dataclass(frozen=True)
class NmeaContent:
    """What the sentences say: tables, and time marks for sensors in the same stream."""

    tables: dict[str, SensorTable]
    marks: Marks
    sentences: int
    dated: bool

    @classmethod
    def none(cls) -> NmeaContent:
        """Nothing said."""
        return cls({}, Marks(np.empty(0, np.int64), np.empty(0)), 0, False)


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
