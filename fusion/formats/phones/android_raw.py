"""Pseudoranges from the raw measurements of Android's location interface (GnssClock and GnssMeasurement).

Source: the documentation of android.location.GnssMeasurement, and "Using GNSS raw measurements on Android devices"
(EUSPA 2018), section 2.4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import Notes, is_possible_time, positive
from fusion.formats.phones.log_lines import WHOLE, Table
from fusion.formats.tables.cells import ABSENT
from fusion.messages import say
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    CARRIER_HZ,
    GALILEO,
    GLONASS,
    GLONASS_AHEAD_S,
    GPS,
    GPS_EPOCH_S,
    LIGHT_MPS,
    QZSS,
    SBAS,
    WEEK_S,
    Signals,
    unix_from_gps,
)
from fusion.types import Bools, Floats, Ints

_Columns = dict[str, NDArray[Any]]
MEASURED = (
    "TimeNanos", "FullBiasNanos", "BiasNanos", "TimeOffsetNanos", "HardwareClockDiscontinuityCount", "Svid", "State",
    "ReceivedSvTimeNanos", "ReceivedSvTimeUncertaintyNanos", "Cn0DbHz", "PseudorangeRateMetersPerSecond",
    "CarrierFrequencyHz", "ConstellationType",
)  # fmt: skip
_NEEDED = ("TimeNanos", "FullBiasNanos", "ReceivedSvTimeNanos", "State", "Svid", "ConstellationType")

# GnssMeasurement.STATE_...
_CODE_LOCK, _TOW_DECODED, _MSEC_AMBIGUOUS, _GLO_TOD_DECODED = 1 << 0, 1 << 3, 1 << 4, 1 << 7
_E1BC_LOCK, _E1C_LOCK, _TOW_KNOWN, _GLO_TOD_KNOWN = 1 << 10, 1 << 11, 1 << 14, 1 << 15
_LOCKED = _CODE_LOCK | _E1BC_LOCK | _E1C_LOCK

_SYSTEM_OF = np.array([-1, GPS, SBAS, GLONASS, QZSS, BEIDOU, GALILEO, -1])
"""By GnssStatus.CONSTELLATION_...; 0 is unknown, 7 IRNSS."""
_LESS = {SBAS: 100, QZSS: 192}
"""What Android's numbers of satellites are above those of RINEX."""
_MOST_SATELLITES = 63
_L1_HZ = (1.559e9, 1.611e9)
"""The band of B1, E1, L1 and G1 (ITU: 1559 to 1610 MHz, and GLONASS's channels)."""
_B1I_BELOW_HZ = 1.57e9
_SHORTEST_M, _LONGEST_M = 1e7, 1e8
"""Satellites are 19 000 to 42 000 km away; the phone's clock is known to some ms beside."""

_NANO = 1_000_000_000
_HUGE = 1 << 62
_DAY_NS, _WEEK_NS = 86_400 * _NANO, int(WEEK_S) * _NANO


def measured(table: Table, notes: Notes) -> Signals:
    """The measurements on the L1 band whose time of transmission is known without ambiguity; the others are counted.

    Epochs lie on the scale that the phone's own clock gives with its offset from GPS time, which is taken once for each
    run of the clock: its offset changes from epoch to epoch by more than pseudoranges err.
    """
    absent = [name for name in _NEEDED if name not in table.columns]
    if absent:
        notes.warn(say("phone.raw_header", names=", ".join(absent)))
        return Signals.empty()
    col = {name: _column(table, name) for name in MEASURED}
    system, number = _satellites(col)
    keep = _usable(col, system, number, table, notes)
    col, system, number = {name: column[keep] for name, column in col.items()}, system[keep], number[keep]
    received_ns, part_ns = _received(col, notes)
    sent_ns, period_ns = _sent(col, system, received_ns)
    flight_ns = (received_ns - sent_ns + period_ns // 2) % period_ns - period_ns // 2
    pseudorange_m = (flight_ns + part_ns) * 1e-9 * LIGHT_MPS
    gps_s = np.floor_divide(received_ns, _NANO) + (received_ns % _NANO + part_ns) * 1e-9
    sane = (pseudorange_m > _SHORTEST_M) & (pseudorange_m < _LONGEST_M)
    sane &= is_possible_time(unix_from_gps(gps_s))
    notes.skip("raw measurements whose pseudorange or time cannot be", int((~sane).sum()))
    # phones that do not state the carrier have one band only
    stated = positive(col["CarrierFrequencyHz"])
    carrier = np.where(np.isfinite(stated), stated, np.where(system == GLONASS, np.nan, CARRIER_HZ[system]))
    # of two signals of one satellite the first is taken: B1I before B1C
    order = np.argsort((system == BEIDOU) & (carrier > _B1I_BELOW_HZ), kind="stable")
    order = order[sane[order]]
    return Signals.assemble(
        gps_s[order], system[order], number[order], pseudorange_m=pseudorange_m[order],
        range_rate_mps=col["PseudorangeRateMetersPerSecond"][order], cn0_dbhz=col["Cn0DbHz"][order],
        sigma_m=positive(col["ReceivedSvTimeUncertaintyNanos"])[order] * 1e-9 * LIGHT_MPS, frequency_hz=carrier[order],
    )  # fmt: skip


def _column(table: Table, name: str) -> NDArray[Any]:
    """A column; ``ABSENT`` among whole numbers, else NaN, where there is none."""
    if name in WHOLE:
        return table.columns.get(name, np.full(len(table), ABSENT))
    column = table.columns.get(name, np.full(len(table), np.nan))
    return np.where(np.isfinite(column), column, np.nan)


def _satellites(col: _Columns) -> tuple[Ints, Ints]:
    """System (-1 of those that are not read) and number as RINEX has it."""
    kind = col["ConstellationType"]
    system = np.where((kind >= 0) & (kind < len(_SYSTEM_OF)), _SYSTEM_OF[np.clip(kind, 0, 7)], -1)
    number = col["Svid"].copy()
    for one_system, less in _LESS.items():
        number[(system == one_system) & (number > less)] -= less
    return system, number


def _usable(col: _Columns, system: Ints, number: Ints, table: Table, notes: Notes) -> Bools:
    state = col["State"]
    complete = np.all([(col[name] > -_HUGE) & (col[name] < _HUGE) for name in _NEEDED], axis=0)
    time_decoded = np.where(system == GLONASS, _GLO_TOD_DECODED | _GLO_TOD_KNOWN, _TOW_DECODED | _TOW_KNOWN)
    carrier = positive(col["CarrierFrequencyHz"])
    elsewhere = (carrier < _L1_HZ[0]) | (carrier > _L1_HZ[1])
    faults = (
        ("raw measurements with numbers missing", ~complete),
        ("raw measurements on other bands than L1", elsewhere),
        ("raw measurements of other systems, or GLONASS ones without a slot",
         (system < 0) | (number < 1) | (number > _MOST_SATELLITES)),
        ("raw measurements without code lock", (state & _LOCKED) == 0),
        ("raw measurements whose time of transmission is not known",
         ((state & time_decoded) == 0) | ((state & _MSEC_AMBIGUOUS) != 0)),
    )  # fmt: skip
    good = notes.sift(faults)
    if len(table) and not good.any():
        nothing = say("phone.no_raw", place=table.place(0))
        notes.first_offender = notes.first_offender or nothing
    return good


def _received(col: _Columns, notes: Notes) -> tuple[Ints, Floats]:
    """When measurements were received: GPS nanoseconds, whole ones and the part of one beside them."""
    clock_ns, bias_ns = col["TimeNanos"], col["FullBiasNanos"]
    small_ns = np.nan_to_num(col["BiasNanos"])
    run = col["HardwareClockDiscontinuityCount"]
    _, which, count = np.unique(run, return_inverse=True, return_counts=True)
    if len(count) > 1:
        notes.repaired["restarts of the phone's clock"] += len(count) - 1
    by_run = np.lexsort((bias_ns, which))
    middle = by_run[np.cumsum(count) - count + count // 2][which]
    offset_ns = np.nan_to_num(col["TimeOffsetNanos"])
    return clock_ns - bias_ns[middle], offset_ns - small_ns[middle]


def _sent(col: _Columns, system: Ints, received_ns: Ints) -> tuple[Ints, Ints]:
    """When they were sent, on the GPS scale but for whole periods, and that period: a day or a week, nanoseconds."""
    sent = col["ReceivedSvTimeNanos"].copy()
    sent[system == BEIDOU] += int(BEIDOU_LATE_S) * _NANO
    gps_s = received_ns / _NANO
    leap_s = np.round(gps_s + GPS_EPOCH_S - unix_from_gps(gps_s)).astype(np.int64)
    sent[system == GLONASS] += (leap_s[system == GLONASS] - int(GLONASS_AHEAD_S)) * _NANO
    return sent, np.where(system == GLONASS, _DAY_NS, _WEEK_NS)
