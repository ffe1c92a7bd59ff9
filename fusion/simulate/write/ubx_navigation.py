"""Ephemerides as the navigation messages that satellites send, in the words in which receivers hand them on.

The places and scales of the fields are those of ``fusion.formats.receiver.subframes``, which names the documents.
Parity bits of GPS and BeiDou are left 0, as receivers check them; the checksums of Galileo and GLONASS are right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import DAY_S
from fusion.formats.receiver.subframes import beidou, glonass, inav, lnav
from fusion.formats.receiver.subframes.bits import Bits, Layout, user_range_accuracy_m, words_of, write
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    BEIDOU_WEEK_0,
    GALILEO,
    GLONASS,
    GLONASS_AHEAD_S,
    GPS,
    GPS_EPOCH_S,
    QZSS,
    WEEK_S,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    Signals,
    unix_from_gps,
)
from fusion.types import Bools, Floats, Ints

FRAME_S = 30.0
_GALILEO_PAGE_S = _STRING_S = 2.0
_TOE_STEP_S = {GPS: 16.0, QZSS: 16.0, GALILEO: 60.0, BEIDOU: 8.0}
Part = tuple[float, NDArray[np.uint32]]
"""How long after its frame's beginning a part is over, and its words (n, words)."""
Encode = Callable[[KeplerEphemerides, Floats], Iterator[Part]]


@dataclass(frozen=True)
class Sending:
    """One part of a message, from several satellites or at several times: (n,) rows, ``words`` (n, words).

    ``signal`` is u-blox's number of the signal, ``channel`` GLONASS's (-7 for others, which have none).
    """

    system: int
    number: Ints
    signal: int
    channel: Ints
    sent_s: Floats
    words: NDArray[np.uint32]


def sendings(navigation: Navigation, signals: Signals) -> Iterator[Sending]:
    """All that is sent in the frames that touch the log, by each satellite that is measured in it."""
    kepler, states = navigation.kepler, navigation.glonass
    far = beidou.geostationary(kepler.number)
    kinds: list[tuple[int, int, Bools | bool, float, Encode]] = [
        (GPS, 0, True, 0.0, lnav_parts),
        (QZSS, 0, True, 0.0, lnav_parts),
        (GALILEO, 1, True, 0.0, inav_parts),
        (BEIDOU, 0, ~far, BEIDOU_LATE_S, d1_parts),
        (BEIDOU, 1, far, BEIDOU_LATE_S, d2_parts),
    ]
    for system, signal, some, late_s, encode in kinds:
        received = np.isin(kepler.number, signals.number[signals.system == system])
        rows = np.flatnonzero((kepler.system == system) & some & received)
        row, begin_s = _schedule(kepler.number, kepler.toe_s, rows, _frames_s(signals, late_s))
        records = kepler.take(row)
        for over_s, words in encode(records, begin_s):
            channel = np.full(len(row), -7)
            yield Sending(system, records.number, signal, channel, begin_s + over_s, words)
    if navigation.klobuchar is not None:
        yield _ionosphere(navigation.klobuchar, signals)
    received = np.isin(states.number, signals.number[signals.system == GLONASS])
    leap_s = float(np.round(signals.gps_s[0] + GPS_EPOCH_S - signals.time_s[0]))
    frame_s = _frames_s(signals, leap_s % FRAME_S)
    row, begin_s = _schedule(states.number, states.toe_s, np.flatnonzero(received), frame_s)
    moved = states.take(row)
    for over_s, words in string_parts(moved, begin_s):
        yield Sending(GLONASS, moved.number, 0, moved.channel, begin_s + over_s, words)


def _frames_s(signals: Signals, late_s: float) -> Floats:
    """When frames begin that touch the log, ``late_s`` after those of GPS."""
    first = np.floor((signals.gps_s[0] - late_s) / FRAME_S)
    last = np.floor((signals.gps_s[-1] - late_s) / FRAME_S)
    return np.arange(first, last + 1) * FRAME_S + late_s


def _schedule(number: Ints, toe_s: Floats, rows: Ints, frame_s: Floats) -> tuple[Ints, Floats]:
    """For every satellite of ``rows`` and every frame: the record whose time is nearest, and the frame's beginning."""
    chosen = [np.empty(0, np.int64)]
    for satellite in np.unique(number[rows]):
        mine = rows[number[rows] == satellite]
        chosen.append(mine[np.abs(toe_s[mine][:, None] - frame_s).argmin(axis=0)])
    return np.concatenate(chosen), np.tile(frame_s, len(chosen) - 1)


def _values(records: KeplerEphemerides, late_s: float = 0.0) -> dict[str, Floats]:
    """The records' fields by name; times as they are sent: seconds of the week of the system's own time."""
    out = {name: np.nan_to_num(np.asarray(column, float)) for name, column in vars(records).items()}
    out["toe"], out["toc"] = ((out[name] - late_s) % WEEK_S for name in ("toe_s", "toc_s"))
    step_s = np.array([_TOE_STEP_S.get(system, 1.0) for system in records.system.tolist()])
    if np.any(np.abs(out["toe"] - step_s * np.round(out["toe"] / step_s)) > 1e-3):
        raise ValueError(
            "messages state times of ephemerides in whole steps of 8 (BeiDou), 16 or 60 s (Galileo)"
        )
    out["health"] = np.where(records.healthy, 0.0, 1.0)
    return out


def _nearest_index(metres: Floats, table_m: Floats, unknown: int) -> Floats:
    """The index whose metres are nearest; ``unknown`` where there are none."""
    index = np.nanargmin(np.abs(table_m - np.nan_to_num(metres)[:, None]), axis=1)
    return np.where(np.isfinite(metres), index, unknown).astype(float)


def _fill(bits: Bits, layout: Layout, **values: float | Floats) -> None:
    columns = {name: np.broadcast_to(value, len(bits)).astype(float) for name, value in values.items()}
    write(bits, layout, columns)


def lnav_parts(records: KeplerEphemerides, begin_s: Floats) -> Iterator[Part]:
    """Subframes 1 to 3 of GPS and QZSS, of frames that begin at GPS seconds (n,)."""
    values = _values(records)
    values["week"] = begin_s // WEEK_S % 1024
    values["issue"] %= 256
    values["issue_of_clock"] = values["issue"]
    values["accuracy_index"] = _nearest_index(records.accuracy_m, user_range_accuracy_m(np.arange(15)), 15)
    for part, layout in lnav.PARTS.items():
        yield lnav.SUBFRAME_S * part, _subframe(part, begin_s, layout, values)


def _subframe(part: int, begin_s: Floats, layout: Layout, values: Mapping[str, Floats]) -> NDArray[np.uint32]:
    bits = np.zeros((len(begin_s), lnav.BITS), np.uint8)
    count = (begin_s / lnav.SUBFRAME_S + part) % (WEEK_S / lnav.SUBFRAME_S)
    _fill(bits, lnav.HEAD, preamble=lnav.PREAMBLE, count=count, subframe=part)
    write(bits, layout, values)
    return words_of(bits, 30)


def _ionosphere(klobuchar: tuple[float, ...], signals: Signals) -> Sending:
    """Page 18 of subframe 4, from the GPS satellite that is received first; more often than real ones send it."""
    begin_s = _frames_s(signals, 0.0)
    names = ["page", *(f"{kind}{k}" for kind in ("alpha", "beta") for k in range(4))]
    values = dict(zip(names, np.array([lnav.IONOSPHERE_PAGE, *klobuchar])[:, None], strict=True))
    words = _subframe(4, begin_s, lnav.IONOSPHERE, {n: np.repeat(v, len(begin_s)) for n, v in values.items()})
    received = signals.number[signals.system == GPS]
    number = np.full(len(begin_s), received[0] if len(received) else 1)
    return Sending(GPS, number, 0, np.full(len(begin_s), -7), begin_s + 4 * lnav.SUBFRAME_S, words)


def inav_parts(records: KeplerEphemerides, begin_s: Floats) -> Iterator[Part]:
    """Words 1 to 5 of Galileo, one page after another."""
    values = _values(records)
    values["satellite"] = values["number"]
    values["accuracy_index"] = _nearest_index(
        records.accuracy_m, inav.signal_accuracy_m(np.arange(126.0)), 255
    )
    for part, layout in inav.PARTS.items():
        page_s = begin_s + _GALILEO_PAGE_S * (part - 1)
        values["week"], values["tow"] = (page_s // WEEK_S - inav.WEEK_0) % 4096, page_s % WEEK_S
        word = np.zeros((len(records), inav.WORD_BITS), np.uint8)
        _fill(word, {"kind": inav.KIND}, kind=part)
        write(word, layout, values)
        yield _GALILEO_PAGE_S * part, words_of(inav.pages_of(word))


def d1_parts(records: KeplerEphemerides, begin_s: Floats) -> Iterator[Part]:
    """Subframes 1 to 3 of BeiDou's D1."""
    values = _beidou_values(records, begin_s)
    high = beidou.D1[2]["toe_high"].scale
    values["toe_high"], values["toe_low"] = np.floor(values["toe"] / high) * high, values["toe"] % high
    for part, layout in beidou.D1.items():
        bits = np.zeros((len(records), beidou.BITS), np.uint8)
        sow = (begin_s - BEIDOU_LATE_S + beidou.SUBFRAME_S * (part - 1)) % WEEK_S
        _fill(bits, beidou.HEAD, preamble=beidou.PREAMBLE, subframe=part, sow=sow)
        write(bits, layout, values)
        yield beidou.SUBFRAME_S * part, words_of(bits, 30)


def d2_parts(records: KeplerEphemerides, begin_s: Floats) -> Iterator[Part]:
    """The ten pages of subframe 1 of BeiDou's D2."""
    together = np.zeros((len(records), 10 * beidou.BITS), np.uint8)
    write(together, beidou.D2, _beidou_values(records, begin_s))
    for page in range(1, 11):
        bits = together[:, beidou.BITS * (page - 1) : beidou.BITS * page]
        sow = (begin_s - BEIDOU_LATE_S + beidou.PAGE_S * (page - 1)) % WEEK_S
        _fill(bits, beidou.HEAD, preamble=beidou.PREAMBLE, subframe=1, sow=sow)
        _fill(bits, {"page": beidou.PAGE}, page=page)
        yield beidou.PAGE_S * (page - 1) + beidou.D2_SUBFRAME_S, words_of(bits, 30)


def _beidou_values(records: KeplerEphemerides, begin_s: Floats) -> dict[str, Floats]:
    values = _values(records, BEIDOU_LATE_S)
    values["week"] = ((begin_s - BEIDOU_LATE_S) // WEEK_S - BEIDOU_WEEK_0) % 8192
    values["issue"] %= 32
    values["accuracy_index"] = _nearest_index(records.accuracy_m, user_range_accuracy_m(np.arange(15)), 15)
    return values


def string_parts(states: GlonassEphemerides, begin_s: Floats) -> Iterator[Part]:
    """Strings 1 to 4 of GLONASS."""
    moscow_s = unix_from_gps(begin_s) + GLONASS_AHEAD_S
    clock_s = moscow_s % DAY_S
    state_s = unix_from_gps(states.toe_s) + GLONASS_AHEAD_S
    unhealthy = np.where(states.healthy, 0.0, 1.0)
    values = {
        "hour": clock_s // 3600,
        "minute": clock_s % 3600 // 60,
        "half": clock_s % 60 // 30,
        "quarter": state_s % DAY_S / glonass.QUARTER_S,
        "day": glonass.day_of_four_years(state_s),
        "slot": states.number.astype(float),
        "delay": -states.clock_s,
        "clock_rate": states.clock_rate,
        "unhealthy": unhealthy,
        "unhealthy_too": unhealthy,
    }
    for part, layout in glonass.PARTS.items():
        if part < 4:
            for name in ("position_m", "velocity_mps", "acceleration_mps2"):
                values[name.split("_")[0]] = getattr(states, name)[:, part - 1]
        bits = np.zeros((len(states), glonass.BITS), np.uint8)
        _fill(bits, {"string": glonass.STRING}, string=part)
        write(bits, layout, values)
        bits[:, 77 : glonass.STRING_BITS] = glonass.check_bits(bits)
        _fill(bits, {"frame": glonass.FRAME}, frame=1 + moscow_s % DAY_S // FRAME_S)
        yield _STRING_S * part, words_of(bits)
