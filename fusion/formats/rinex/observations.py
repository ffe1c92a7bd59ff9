"""Observation files of versions 2, 3 and 4: pseudorange, Doppler and C/N0 of one L1-band signal a satellite.

The receiver clock's offset in epoch lines is not applied: RINEX wants epochs, pseudoranges and phases to agree with or
without it, and whoever computes positions estimates it anyway.

Which of a satellite's signals on the L1 band is taken: the codes of each system in order of preference. Codes as in
RINEX 3.05, tables 4 to 10 (band and attribute); those of version 2 as in 2.11, table A1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes, is_possible_time
from fusion.formats.rinex import scan
from fusion.formats.rinex.header import Header
from fusion.formats.rinex.lines import Lines, seconds_of
from fusion.messages import say
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    CARRIER_HZ,
    GLONASS,
    GLONASS_STEP_HZ,
    GPS,
    GPS_EPOCH_S,
    LIGHT_MPS,
    SYSTEMS,
    Signals,
    gps_from_unix,
    unix_from_gps,
)
from fusion.types import Bools, Floats, Ints, Progress

# The open code that most receivers track comes first; those that need a guess at an encrypted one last.
_PREFERRED: dict[str, tuple[str, ...]] = {
    "G": ("1C", "1S", "1X", "1L", "1P", "1W", "1Y", "1M"),
    "R": ("1C", "1P"),
    "E": ("1C", "1X", "1B", "1A", "1Z"),
    "C": ("2I", "2X", "2Q", "1I", "1Q", "1P", "1X", "1D"),
    "J": ("1C", "1S", "1X", "1L", "1E", "1B", "1Z"),
    "S": ("1C",),
}
_PREFERRED_2: dict[str, tuple[str, ...]] = {
    "G": ("C1", "P1"),
    "R": ("C1", "P1"),
    "E": ("C1",),
    "C": ("C2", "C1"),
    "J": ("C1",),
    "S": ("C1",),
}
MOST_CODES = 8
MOST_SLOTS = 100
B1_AS_BAND_1 = 3.03
"""Before this version, the attributes I, Q and X of BeiDou's band 1 mean B1I (RINEX 3.03, table 9, note)."""


def columns_of(header: Header) -> tuple[Ints, Floats]:
    """Where the candidates of every system stand among the types of the header: ``place`` and ``factor`` of ``Codes``,
    (6, MOST_CODES, 3) each."""
    index = np.full((len(SYSTEMS), MOST_CODES, 3), -1, np.int64)
    factor = np.ones(index.shape)
    for system, letter in enumerate(SYSTEMS):
        types = header.types.get(letter, []) if header.version >= 3 else header.types.get(" ", [])
        for place, code in enumerate(_candidates(header.version)[letter]):
            for quantity, name in enumerate(_names(header.version, code)):
                if name in types:
                    index[system, place, quantity] = types.index(name)
                    factor[system, place, quantity] = header.scale_factor.get((letter, name), 1.0)
    return index, factor


def _candidates(version: float) -> dict[str, tuple[str, ...]]:
    return _PREFERRED if version >= 3 else _PREFERRED_2


def _names(version: float, code: str) -> tuple[str, str, str]:
    """The names of pseudorange, Doppler and C/N0; Doppler and C/N0 of version 2 go by band alone."""
    return (code, f"D{code[1]}", f"S{code[1]}") if version < 3 else (f"C{code}", f"D{code}", f"S{code}")


def frequencies_hz(
    version: float, system: NDArray[np.int64], number: NDArray[np.int64], place: NDArray[np.int64],
    channel: dict[int, int],
) -> NDArray[np.float64]:  # fmt: skip
    """The carriers (n,) of the candidates at ``place``; NaN for GLONASS satellites without a known channel."""
    slots = np.full(MOST_SLOTS, np.nan)
    for slot, k in channel.items():
        if slot < MOST_SLOTS:
            slots[slot] = CARRIER_HZ[GLONASS] + k * GLONASS_STEP_HZ
    out = np.full(len(system), CARRIER_HZ[GPS])
    out[system == GLONASS] = slots[number[system == GLONASS]]
    codes = _candidates(version)["C"]
    is_b1i = np.array([_is_b1i(version, code) for code in codes] + [False] * (MOST_CODES - len(codes)))
    out[(system == BEIDOU) & is_b1i[place]] = CARRIER_HZ[BEIDOU]
    return out


def _is_b1i(version: float, code: str) -> bool:
    return version < 3 or code[0] == "2" or code in ("1I", "1Q") or (version < B1_AS_BAND_1 and code == "1X")


MOST_EVENTS = 20_000
"""Headers in mid-file; a survey has some dozens."""
_ALL_IN_ONE_LINE = 1 << 30
_DATE_3 = ((2, 4), (6, 3), (9, 3), (12, 3), (15, 3), (18, 11))
_DATE_2 = ((1, 2), (3, 3), (6, 3), (9, 3), (12, 3), (15, 11))
_FLAG_AT = {3: 31, 2: 28}
_USUAL_SHARE = 0.9
"""A code is taken if its satellite has it in this share of the epochs that it has any in: else another fits better."""


@dataclass
class _Rows:
    """What a walk over the file found; rows and epochs as in ``scan``, ``part`` counts the stretches between events."""

    epoch_line: Ints
    line: Ints
    epoch: Ints
    name: Ints
    part: Ints
    columns: list[tuple[Ints, Floats]]
    state: Ints = field(default_factory=lambda: np.zeros(5, np.int64))


def read_observations(
    lines: Lines, header: Header, notes: Notes, progress: Progress, channels: Mapping[int, int]
) -> tuple[Signals, Floats]:
    """Read the rows after the header; gives the signals, and times (UTC) before which the receiver had lost power.

    ``channels`` are those of GLONASS slots from elsewhere; the header's own are preferred.
    """
    rows = _walk(lines, header, notes)
    progress("read observations", 0.4)
    gps_s, good = _epochs(lines, header, rows, notes)
    modern = header.version >= 3
    lead, per = (3, _ALL_IN_ONE_LINE) if modern else (0, scan.PER_LINE_2)
    place, factor = (np.array(column) for column in zip(*rows.columns, strict=True))
    codes = scan.Codes(place, factor, lead, per)
    counts = np.zeros((len(SYSTEMS) * scan.MOST_NUMBERS, MOST_CODES), np.int64)
    satellite = np.empty(len(rows.line), np.int64)
    places = (lines.text, lines.start, lines.end, rows.line)
    otherwise = max(GPS, SYSTEMS.find(header.system))  # a name without a letter, in version 2
    scan.count_codes(*places, rows.name, rows.part, codes, otherwise, counts, satellite)
    progress("read observations", 0.7)
    chosen = np.argmax(counts >= _USUAL_SHARE * counts.max(axis=1, keepdims=True), axis=1)
    values = scan.take_values(*places, rows.part, codes, satellite, chosen)
    _count_rows(lines, rows, satellite, values, notes)
    keep = (satellite >= 0) & np.isfinite(values[:, 0]) & good[rows.epoch]
    satellite, values = satellite[keep], values[keep]
    system, number = satellite // scan.MOST_NUMBERS, satellite % scan.MOST_NUMBERS
    channel = {**channels, **header.channel}
    carrier = frequencies_hz(header.version, system, number, chosen[satellite], channel)
    signals = Signals.assemble(
        gps_s[rows.epoch[keep]], system, number, pseudorange_m=values[:, 0],
        range_rate_mps=-LIGHT_MPS / carrier * values[:, 1], cn0_dbhz=values[:, 2], frequency_hz=carrier,
    )  # fmt: skip
    _say_of_channels(signals, notes)
    repeated = len(values) - len(signals.system)
    notes.skip("repeated rows of one satellite and time", repeated)
    return signals, _power_failures(lines, header, rows, gps_s, good, notes)


def _walk(lines: Lines, header: Header, notes: Notes) -> _Rows:
    """Find epochs and rows, and take what events say into the header."""
    n = len(lines)  # no more rows nor epochs than lines
    tables = {name: np.empty(n, np.int64) for name in ("epoch_line", "line", "epoch", "name", "part")}
    rows = _Rows(**tables, columns=[columns_of(header)])
    rows.state[scan.LINE] = header.lines
    for _event in range(MOST_EVENTS):
        before = rows.state[scan.ROWS]
        count = _scan(lines, header, rows)
        rows.part[before : rows.state[scan.ROWS]] = len(rows.columns) - 1
        if count < 0:
            break
        _take_event(lines, header, rows, count)
    else:
        raise MalformedLogError(
            say("rinex.too_many_headers", most=MOST_EVENTS),
            where=say("place.line", n=rows.state[scan.LINE] + 1),
        )
    row_count = rows.state[scan.ROWS]
    rows.epoch_line = rows.epoch_line[: rows.state[scan.EPOCHS]]
    for name in ("line", "epoch", "name", "part"):
        setattr(rows, name, getattr(rows, name)[:row_count])
    if header.version >= 3:
        rows.name = lines.start[rows.line]
    notes.skip("lines of no epoch", int(rows.state[scan.STRAY]))
    notes.skip("epochs with fewer lines than they announce", int(rows.state[scan.SHORT]))
    if rows.state[scan.SHORT]:
        notes.warn(say("rinex.short_epochs"))
    return rows


def _scan(lines: Lines, header: Header, rows: _Rows) -> int:
    places = (lines.text, lines.start, lines.end, rows.state)
    if header.version >= 3:
        return int(scan.scan_3(*places, rows.epoch_line, rows.line, rows.epoch))
    per = max(1, -(-len(header.types.get(" ", [])) // scan.PER_LINE_2))
    return int(scan.scan_2(*places, per, rows.epoch_line, rows.line, rows.epoch, rows.name))


def _take_event(lines: Lines, header: Header, rows: _Rows, count: int) -> None:
    """Read the header lines of an event, and go on behind them; another epoch among them ends them."""
    at = int(rows.state[scan.LINE]) + 1
    stop = min(at + count, len(lines))
    before = {system: list(types) for system, types in header.types.items()}
    while at < stop and not (header.version >= 3 and lines.line(at).startswith(">")):
        header.take(lines.line(at))
        at += 1
    rows.state[scan.LINE] = at
    if header.types != before:
        rows.columns.append(columns_of(header))


def _epochs(lines: Lines, header: Header, rows: _Rows, notes: Notes) -> tuple[Floats, Bools]:
    """GPS seconds of the epochs, and which are times at all."""
    seconds, good = seconds_of(lines, rows.epoch_line, _DATE_3 if header.version >= 3 else _DATE_2)
    if header.scale == "GLO":  # UTC, whatever its name
        seconds = gps_from_unix(seconds + GPS_EPOCH_S)
    elif header.scale == "BDT":
        seconds = seconds + BEIDOU_LATE_S
    good &= is_possible_time(unix_from_gps(seconds))

    def tell(epoch: int) -> str:
        line = int(rows.epoch_line[epoch])
        return say("place.line_text", n=line + 1, text=lines.line(line)[:30].strip())

    good = notes.sift((("epochs at no possible time", ~good),), tell, position=True)
    good_s = seconds[good]
    backwards = int(np.count_nonzero(np.diff(good_s) < 0))
    repeated = len(good_s) - len(np.unique(good_s)) if len(good_s) else 0
    if backwards:
        notes.repaired["epochs out of order"] += backwards
        notes.warn(say("rinex.backwards", n=backwards))
    if repeated:
        notes.repaired["epochs given twice"] += repeated
        notes.warn(say("rinex.repeated", n=repeated))
    return seconds, good


def _count_rows(lines: Lines, rows: _Rows, satellite: Ints, values: Floats, notes: Notes) -> None:
    def example(r: int) -> str:
        name = lines.text[rows.name[r] : rows.name[r] + 3].tobytes().decode("ascii", "replace")
        return say("place.line_text", n=rows.line[r] + 1, text=name)

    faults = (
        ("satellites of systems that are not read", satellite == -1),
        ("rows without the name of a satellite", satellite == -2),
    )
    named = notes.sift(faults, example)
    # satellites without L1 are usual; they are counted, and no warning
    notes.sift((("rows without a pseudorange on the L1 band", named & np.isnan(values[:, 0])),))


def _say_of_channels(signals: Signals, notes: Notes) -> None:
    unknown = np.isnan(signals.frequency_hz)
    if unknown.any():
        slots = ", ".join(f"R{k:02d}" for k in np.unique(signals.number[unknown]))
        notes.warn(say("rinex.channels", slots=slots))


def _power_failures(
    lines: Lines, header: Header, rows: _Rows, gps_s: Floats, good: NDArray[np.bool_], notes: Notes
) -> Floats:
    flag = lines.column(rows.epoch_line, _FLAG_AT[3 if header.version >= 3 else 2])
    failed = np.flatnonzero((flag == ord("1")) & good)
    failed = failed[failed > 0]  # that the receiver was off before the first epoch is no gap
    if len(failed):
        notes.repaired["power failures between epochs"] += len(failed)
        notes.warn(say("rinex.power", n=len(failed)))
    return unix_from_gps(gps_s[failed])
